"""The radar's chain through `seqrsm image`: receivers, film, calibrations, targets, patterns, masks, refusals."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import tifffile
from commands import call
from PIL import Image
from tiny_campaign import TINY

from seqrsm.campaign.check import combinations_of
from seqrsm.campaign.simulator_checks import not_to_be_used
from seqrsm.scene.file import load_scene, save_scene
from seqrsm.spec.read import load_spec

QUIET = 'fading = "none"\n'


@pytest.fixture
def campaign(tiny):
    """Rewrites [simulator.fixed] of the tiny campaign, by lines that take the place of those of the same key."""

    def write(more: str = "") -> Path:
        keys = {line.split("=")[0].strip() for line in more.splitlines() if "=" in line}
        kept = [line for line in TINY.splitlines() if line.split("=")[0].strip() not in keys or "=" not in line]
        text = "\n".join(kept).replace("[stop]", more + "\n[stop]")
        (tiny / "campaign.toml").write_text(text, encoding="utf-8")
        return tiny

    return write


def arrays(folder: Path, *more: object) -> dict[str, np.ndarray]:
    call("image", folder, "--out", folder / "i.npz", *more)
    return dict(np.load(folder / "i.npz"))


def refused(folder: Path, *words: str, command: str = "image") -> None:
    more = ("--out", folder / "i.npz") if command == "image" else ()
    result = call(command, folder, *more, code=2)
    for word in words:
        assert word in result.stderr, result.stderr


def level_w(plain: dict[str, np.ndarray], folder: Path) -> float:
    """Power of flat ground of sigma0 = 1 at the centre, where at 45 deg the ground range is the height."""
    calibration = plain["noise_power_w"] / plain["noise_equivalent_sigma0"]
    height = 4000.0 - float(load_scene(folder / "scene.npz").elevation_m.mean())
    return float(np.interp(height, plain["ground_range_m"], calibration))


@pytest.mark.parametrize(
    ("receiver", "law"),
    [("square_law", lambda p, a: p**2 / a), ("saturation", np.minimum), ("compression", lambda p, a: p**2 / (p + a))],
)
def test_receivers(campaign, receiver, law):
    folder = campaign(QUIET)
    plain = arrays(folder)
    got = arrays(campaign(QUIET + f'receiver = "{receiver}"\nreceiver_level_db = -14.0\n'))
    expected = law(plain["intensity_w"], level_w(plain, folder) * 10**-1.4)
    np.testing.assert_allclose(got["intensity_w"], expected, rtol=2e-3)
    assert not np.allclose(got["intensity_w"], plain["intensity_w"], rtol=0.05, atol=0.0)


def test_a_saturated_receiver_is_flat_and_scores_nothing_but_chance(campaign):
    folder = campaign('receiver = "saturation"\nreceiver_level_db = -60.0\n')
    result = json.loads(call("image", folder, "--out", folder / "i.npz", "--json").stdout)
    assert np.ptp(np.load(folder / "i.npz")["intensity_w"]) == 0.0
    assert 15.0 < result["scores"]["cover"] < 60.0


def test_automatic_gain_brings_every_line_to_the_level(campaign):
    folder = campaign(QUIET)
    level = level_w(arrays(folder), folder)
    got = arrays(campaign(QUIET + 'receiver = "agc"\nagc_length_m = 1.0\nreceiver_level_db = -3.0\n'))
    np.testing.assert_allclose(got["intensity_w"][0].mean(axis=0), level * 10**-0.3, rtol=2e-3)


def test_a_users_function_is_the_receiver(campaign, tmp_path, monkeypatch):
    (tmp_path / "my_receiver.py").write_text(
        "import numpy as np\n"
        "def root(p): return np.sqrt(p)\n"
        "def wrong(p): return p[..., 1:]\n"
        "def broken(p): return p / nothing\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    folder = campaign(QUIET)
    plain = arrays(folder)
    got = arrays(campaign(QUIET + 'receiver = "my_receiver:root"\n'))
    np.testing.assert_allclose(got["intensity_w"], np.sqrt(plain["intensity_w"].astype(float)), rtol=1e-5)
    refused(campaign('receiver = "my_receiver:wrong"\n'), "my_receiver:wrong", "one finite intensity")
    refused(campaign('receiver = "my_receiver:broken"\n'), "nothing", "NameError")
    refused(campaign('receiver = "my_receiver:none"\n'), "my_receiver:none", command="check")
    refused(campaign('receiver = "magic"\n'), "magic", "square_law")
    got = arrays(campaign(QUIET + 'processing = "my_receiver:root"\nreceiver = "saturation"\n'))
    limit = level_w(plain, folder)
    np.testing.assert_allclose(got["intensity_w"], np.sqrt(np.minimum(plain["intensity_w"], limit)), rtol=2e-3)
    refused(campaign('processing = "my_receiver:none"\n'), "processing", "my_receiver:none", command="check")
    refused(campaign('processing = "square"\n'), "processing", "package.module:function")
    sys.modules.pop("my_receiver", None)


def test_a_users_receiver_may_lie_beside_the_campaign(campaign):
    plain, folder = arrays(campaign(QUIET)), campaign(QUIET + 'receiver = "bent:half"\nprocessing = "bent:root"\n')
    refused(folder, "bent:half", "beside campaign.toml", command="check")
    (folder / "bent.py").write_text("import numpy as np\nhalf = lambda p: 0.5 * p\nroot = np.sqrt\n")
    got = arrays(folder)["intensity_w"]
    np.testing.assert_allclose(got, np.sqrt(0.5 * plain["intensity_w"].astype(float)), rtol=1e-5)
    (folder / "bent.py").write_text("half = 3\n")
    refused(folder, "bent.py", "the module has no function half")
    (folder / "bent.py").write_text("half = abs\n")
    refused(folder, "bent.py", "the module has no function root")


def test_a_wrong_value_is_told_with_its_line(campaign):
    folder = campaign("film_gamma = 0.0\nn_bits = 8.5\nadc_bits = 1.5\n")
    lines = (folder / "campaign.toml").read_text().splitlines()
    for name in ("film_gamma", "n_bits", "adc_bits"):
        place = next(k for k, line in enumerate(lines, start=1) if line.startswith(name))
        refused(folder, f"campaign.toml:{place}: [simulator.fixed] {name}")
    refused(folder, "Give a whole number from 0 to 32")
    folder = campaign("i_c_w = 1e-12\n")  # what is missing stands in no line but that of its table
    place = (folder / "campaign.toml").read_text().splitlines().index("[simulator.fixed]") + 1
    refused(folder, f"campaign.toml:{place}: [simulator.fixed] i_qc")


def test_winds_that_the_table_lacks_are_refused_before_a_run_draws_them(campaign):
    folder = campaign("wind_low_m_s = 2.0\nwind_high_m_s = 14.0\n")
    call("check", folder)  # without water the wind does not matter
    scene = load_scene(folder / "scene.npz")
    save_scene(dataclasses.replace(scene, categories=("Water", *scene.categories[1:])), folder / "scene.npz")
    refused(folder, "Water", "2 to 10 m/s", "wind_high_m_s", command="check")
    # Also a wind that hardly any run would draw.
    text = (
        (folder / "campaign.toml")
        .read_text(encoding="utf-8")
        .replace("wind_high_m_s = 14.0", "wind_high_m_s = 10.0001")
    )
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    refused(folder, "Water", "2 to 10 m/s", "wind_high_m_s", command="check")


def test_film_and_calibrations_make_the_grey_tones_of_the_report(campaign):
    folder = campaign(QUIET)
    plain = arrays(folder)
    power = plain["intensity_w"].astype(float)
    middle = float(np.median(power))
    top = 255.0
    cases = {
        f"i_min_w = {middle / 10}": 255.0 / (10.0**2 - 1.0) * (power / (middle / 10) - 1.0),
        f"i_c_w = {middle}\ni_qc = 40": 255.0 / 99.0 * (power / middle * (40.0 / (255.0 / 99.0) + 1.0) - 1.0),
        f"p_rc_w = {middle}\ng_rc = 100": 100.0 + top / 2.0 * np.log10(power / middle),
        f"p_rc_w = {middle}\ng_rc = 100\nfilm_gamma = 2.0\nfilm_k = 7.0": 100.0 + top * np.log10(power / middle),
        "dynamic_range_db = 10.0": 127.5 + top * np.log10(power / middle),
    }
    for more, expected in cases.items():
        got = arrays(campaign(QUIET + more + "\n"))
        tone = np.clip(expected, 0.0, top)
        np.testing.assert_allclose(got["greytone"], tone, atol=0.51)
        assert np.ptp(tone) > 10.0
        call("image", folder, "--out", folder / "i.png")
        np.testing.assert_array_equal(np.array(Image.open(folder / "i.png")), got["greytone"][0])
        gamma = 2.0 if "film_gamma" in more else 1.0
        density = gamma * np.log10(power) + (np.log10(7.0) if "film_k" in more else 0.0)
        np.testing.assert_allclose(got["film_density"], density, atol=1e-5)


@pytest.mark.parametrize("bits", [1, 2, 12, 16])
def test_words_of_any_length(campaign, bits):
    folder = campaign(QUIET + f"n_bits = {bits}\ndynamic_range_db = 12.0\nadc_bits = {bits}\nadc_range_db = 0.0\n")
    got = arrays(folder)
    assert got["greytone"].max() <= 2**bits - 1
    call("image", folder, "--out", folder / "i.png")
    shown = np.array(Image.open(folder / "i.png"))
    limit = 65535 if bits > 8 else 255
    assert shown.max() <= limit
    np.testing.assert_allclose(shown, got["greytone"][0] * (limit / (2**bits - 1)), atol=0.5)


def test_sets_that_contradict_themselves_are_refused_with_the_numbers(campaign):
    refused(campaign("i_min_w = 1e-12\np_rc_w = 1e-12\ng_rc = 100\n"), "more than one calibration", "i_min_w", "p_rc_w")
    refused(campaign("p_rc_w = 1e-12\n"), "g_rc")
    refused(campaign("n_bits = 0\n"), "n_bits", "1 to 32")
    refused(campaign("looks = 0.5\n"), "looks", "0.5", "1")
    refused(campaign("bandwidth = 1.0\n"), "MHz", "resolve", "resolution")
    refused(campaign("depression_angle = 1.0\naltitude_m = 9000.0\n"), "horizon")
    refused(campaign("film_gamma = -1.0\n"), "film_gamma")
    refused(campaign('scan = "ppi"\n'), "aperture", "real")


def test_a_file_of_cultural_targets(campaign):
    quiet = QUIET + "tree_height_m = 0\n"  # or trees would hide them
    folder = campaign(quiet + 'targets_file = "targets.csv"\n')
    csv = folder / "targets.csv"
    csv.write_text("row,column,cross_section_dbm2,height_m,directions_deg,lobe_deg\n30,40,50,2,,\n30,60,50,,0;90,20\n")
    bright = arrays(folder)
    csv.write_text(csv.read_text().replace("0;90", "0 90").replace(",", ";"))
    np.testing.assert_array_equal(arrays(folder)["mean_power_w"], bright["mean_power_w"])
    plain = arrays(campaign(quiet))
    gain = bright["mean_power_w"][0] / plain["mean_power_w"][0]
    pixel = bright["pixel_of_cell"]
    at = [divmod(int(pixel[30, c]), gain.shape[1]) for c in (40, 60)]
    assert gain[at[0]] > 10.0
    # Flying east the radar looks south: the second target shows it no face but a far lobe.
    assert gain[at[1]] > 10.0
    assert (gain > 1.5).sum() <= 4
    folder = campaign(QUIET + 'targets_file = "targets.csv"\n')
    for text, words in {
        "row,column\n1,2\n": ["its columns", "cross_section_dbm2"],
        "row,column,cross_section_dbm2\n1,2,3\n1,b,3\n": ["targets.csv:3", "1,b,3"],
        "row,column,cross_section_dbm2,lobe_deg\n1,2,3,0\n": ["targets.csv:2", "lobe"],
        "row,column,cross_section_dbm2\n1,2,500\n": ["targets.csv:2", "120 dBm2"],
        "row,column,cross_section_dbm2\n900,2,3\n": ["outside", "900", "[simulator.fixed] targets_file"],
        "row,column,cross_section_dbm2,height_m\n1,2,3,1e200\n": ["targets.csv:2", "1,2,3,1e200", "1000 m of height"],
        "row column cross_section_dbm2\n1 2 3\n": ["targets.csv:1", "its columns"],
        "# ours\n\nrow,row,column,cross_section_dbm2\n1,1,2,3\n": ["targets.csv:3", "its columns"],
        "row,column,cross_section_dbm2\n,,\n1,2,3,4\n": ["targets.csv:3", "not a cultural target", "1,2,3,4"],
        "": ["empty"],
    }.items():
        csv.write_text(text)
        refused(folder, *words)
        refused(folder, *words[:1], command="check")
    csv.unlink()
    refused(folder, "targets.csv")


def test_an_antenna_pattern_by_its_points(campaign):
    pattern = 'elevation_pattern = "table"\npattern_table = "{}"\n'
    beam = arrays(campaign(QUIET + pattern.format("0:-6, 44:-6, 44.5:0, 90:0")))["mean_power_w"][0].mean(axis=1)
    plain = arrays(campaign(QUIET))["mean_power_w"][0].mean(axis=1)
    change = 10.0 * np.log10(beam / plain)
    assert change[:3] == pytest.approx(-12.0, abs=0.6)
    assert change[-3:] == pytest.approx(0.0, abs=0.01)
    refused(campaign(QUIET + pattern.format("9:0, 3:0")), "rising")


def test_masks_are_products(campaign, tmp_path):
    folder = campaign("depression_angle = 4.0\naltitude_m = 200.0\nbandwidth = 80.0\n")
    whole = arrays(folder)
    for name in ("shadow", "layover"):
        result = json.loads(call("image", folder, "--mask", name, "--out", tmp_path / "m.png", "--json").stdout)
        shown = np.array(Image.open(tmp_path / "m.png"))
        np.testing.assert_array_equal(shown == 255, whole[name])
        assert result["mask_share"] == pytest.approx(whole[name].mean())
        call("image", folder, "--mask", name, "--out", tmp_path / "m.tif")
        np.testing.assert_array_equal(tifffile.imread(tmp_path / "m.tif"), shown)
        call("image", folder, "--mask", name, "--out", tmp_path / "m.npz")
        np.testing.assert_array_equal(np.load(tmp_path / "m.npz")[name], whole[name])
    assert whole["shadow"].any()
    result = call("image", folder, "--mask", "clouds", "--out", tmp_path / "m.png", code=2)
    assert "shadow, layover" in result.stderr


def test_a_geotiff_tells_its_bands_what_is_no_data_and_is_compressed(campaign, tmp_path):
    """As GDAL reads them; the numbers by Pillow's reader, which is another than the writer's."""
    folder = campaign()
    call("image", folder, "--set", "polarization=HH+HV", "--out", tmp_path / "i.tif")
    with tifffile.TiffFile(tmp_path / "i.tif") as file:
        tags = {tag.code: tag.value for tag in file.pages[0].tags.values()}
        values = file.asarray()
    assert tags[42113] == "nan"
    items = ElementTree.fromstring(tags[42112]).findall("Item")
    told = [(one.get("sample"), one.get("role"), one.text) for one in items]
    assert told == [
        (band, role, text) for band, name in (("0", "HH"), ("1", "HV"))
        for role, text in (("description", name), ("unittype", "dB"))
    ]  # fmt: skip
    assert tags[259] == 8  # deflate
    assert (tmp_path / "i.tif").stat().st_size < 0.97 * values.nbytes
    call("image", folder, "--set", "polarization=HH", "--out", tmp_path / "one.tif")
    np.testing.assert_array_equal(np.array(Image.open(tmp_path / "one.tif")), tifffile.imread(tmp_path / "one.tif"))
    call("image", folder, "--mask", "shadow", "--out", tmp_path / "m.tif")
    with tifffile.TiffFile(tmp_path / "m.tif") as file:
        assert 42113 not in file.pages[0].tags  # every cell of a mask has a value
        assert ">shadow<" in file.pages[0].tags[42112].value


def test_threads_change_nothing(campaign):
    folder = campaign()
    np.testing.assert_array_equal(arrays(folder)["intensity_w"], arrays(folder, "--threads", 3)["intensity_w"])


def test_a_plan_position_indicator(campaign):
    text = 'scan = "ppi"\naperture = "real"\nazimuth_beamwidth_deg = 2.0\nearth = "flat"\npulse_length_us = 1.0\n'
    folder = campaign(QUIET + text + "antenna_east_m = -900.0\naltitude_m = 1000.0\n")
    got = arrays(folder)
    assert got["intensity_w"].shape[2] == got["azimuth_deg"].size == 180
    assert got["rectangular_intensity_w"].shape[1:] == (25, 33)
    call("image", folder, "--out", folder / "i.png")
    assert np.array(Image.open(folder / "i.png")).shape == (25, 33)
    call("image", folder, "--out", folder / "i.tif")
    assert tifffile.imread(folder / "i.tif").shape == (60, 80)
    refused(campaign(text + "pixel_m = 5.0\n"), "pixel_m")


@pytest.mark.parametrize(
    ("frequency", "words"),
    [
        (0.62, ("0.62", "0.625 to 27.2")),
        (0.626, ()),
        (1.25, ()),
        (27.1, ()),
        (27.3, ("27.3", "27.2")),
        (200.0, ("100 GHz",)),
    ],
)
def test_frequencies_at_and_beyond_the_ends_of_the_table(campaign, frequency, words):
    folder = campaign(f"frequency = {frequency}\n")
    if words:
        refused(folder, "frequency", *words)
    else:
        assert np.isfinite(arrays(folder)["intensity_w"]).all()


def test_powers_from_nothing_to_far_too_much(campaign):
    refused(campaign("peak_power = 0.0\n"), "peak_power", "1e-06")
    refused(campaign("peak_power = nan\n"), "peak_power", "finite")
    faint, strong = (arrays(campaign(f"peak_power = {p}\n")) for p in (1e-6, 1e9))
    np.testing.assert_allclose(faint["intensity_w"].mean() / faint["noise_power_w"].mean(), 1.0, rtol=0.05)
    assert strong["noise_equivalent_sigma0"].max() < 1e-9


def test_scenes_with_holes_and_without_anything(campaign, tiny_scene):
    folder = campaign()
    whole = load_scene(tiny_scene)
    z, cover, scored = whole.elevation_m.copy(), whole.cover.copy(), whole.scored.copy()
    z[10:20] = np.nan
    scored[10:20] = False
    save_scene(dataclasses.replace(whole, elevation_m=z, scored=scored), folder / "scene.npz")
    got = arrays(folder)
    assert np.isfinite(got["intensity_w"]).all()
    assert (got["pixel_of_cell"][10:20] == -1).all()
    assert (got["pixel_of_cell"][:10] >= 0).all()
    call("image", folder, "--out", folder / "i.tif")
    assert np.isnan(tifffile.imread(folder / "i.tif")[10:20]).all()
    nothing = np.zeros_like(scored)
    save_scene(dataclasses.replace(whole, elevation_m=z * np.nan, scored=nothing), folder / "scene.npz")
    refused(folder, "no cell has an elevation")
    empty = np.full_like(cover, 255)
    field = np.zeros_like(whole.field_id)
    save_scene(dataclasses.replace(whole, cover=empty, scored=nothing, field_id=field), folder / "scene.npz")
    told = call("image", folder, "--out", folder / "i.npz")
    assert "no score for cover: no scored cell lies in the image" in told.stdout + told.stderr


@pytest.mark.parametrize("cut", [np.s_[:1, :1], np.s_[:1, :], np.s_[:, :1]])
def test_a_scene_of_one_cell_one_row_or_one_column_has_an_image_in_every_format(campaign, tiny_scene, cut):
    whole = load_scene(tiny_scene)
    _, numbers = np.unique(whole.field_id[cut], return_inverse=True)
    field = numbers.reshape(whole.field_id[cut].shape).astype(np.int32)
    folder = campaign(QUIET)
    small = dataclasses.replace(
        whole,
        elevation_m=np.ascontiguousarray(whole.elevation_m[cut]),
        cover=np.ascontiguousarray(whole.cover[cut]),
        scored=np.ascontiguousarray(whole.scored[cut]),
        field_id=field,
        bounds=None,
    )
    save_scene(small, folder / "scene.npz")
    got = arrays(folder)
    assert np.isfinite(got["intensity_w"]).all()
    assert got["pixel_of_cell"].shape == small.shape
    assert (got["pixel_of_cell"] >= 0).all()
    for kind in ("png", "tif"):
        call("image", folder, "--out", folder / f"i.{kind}")
    call("image", folder, "--out", folder / "m.png", "--mask", "shadow")


def test_a_calibration_beside_the_intensities_and_a_channel_left_out_are_told(campaign):
    folder = campaign("i_min_w = 1e-3\n")
    told = call("image", folder, "--out", folder / "i.png").stderr
    found = arrays(folder)["intensity_w"]
    assert (
        f"every pixel of HH has the grey tone 0: the calibration does not fit intensities of {found.min():.3g}" in told
    )
    both = ("--set", "polarization=HH+HV")
    assert "shown is HH, the .tif" in call("image", campaign(), "--out", folder / "i.png", *both).stderr
    for suffix, more in (("npz", both), ("png", ())):
        quiet = call("image", campaign(), "--out", folder / f"i.{suffix}", *more).stderr
        assert "shown is" not in quiet
        assert "every pixel" not in quiet


def test_pixels_finer_than_the_cells_are_told(campaign):
    folder = campaign()
    cell = load_scene(folder / "scene.npz").cell_m
    save_scene(dataclasses.replace(load_scene(folder / "scene.npz"), cell_m=30.0, bounds=None), folder / "scene.npz")
    notes = json.loads(call("image", folder, "--out", folder / "i.npz", "--json").stdout)["notes"]
    assert any("nothing smaller than its cells of 30 m, so pixels of 24.5 m" in note for note in notes)
    assert "pixels finer than the ground at 4 of 6 settings" in " ".join(call("check", folder).stdout.split())
    assert cell <= 10.0


def test_channels_that_see_nothing_are_told_by_check(campaign):
    def told(more: str) -> str:
        return " ".join(combinations_of(load_spec(campaign(more))))

    assert not told("")
    assert not told("peak_power = 0.1\n")  # some covers are lost in the noise, not all
    weak = told("peak_power = 1e-6\n")
    assert "weaker than the receiver's noise at 6 of 6 settings" in weak
    assert "every cover in HH" in weak
    strong = told('receiver = "saturation"\nreceiver_level_db = -60.0\n')
    assert "the receiver is saturated at 6 of 6 settings" in strong
    assert "the level of -60 dB" in strong
    assert not told("receiver_level_db = -60.0\n")


def test_a_report_warns_of_recommended_settings_at_which_nothing_is_seen(campaign):
    def warnings(more: str) -> tuple[str, ...]:
        spec = load_spec(campaign(more))
        return not_to_be_used(spec, spec.region.decode(spec.region.candidates(n_continuous_levels=3)[:1])[0])

    assert not warnings("")
    (told,) = warnings("peak_power = 1e-6\n")
    assert "At these settings the echo is weaker than the receiver's noise: every cover in HH" in told
