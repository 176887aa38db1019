"""The phase between HH and VV: the law of their fading, the ground's relation, and what a classifier gains by it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from psm_cases import radar, scene
from scipy.stats import ks_2samp
from shorthands import percent_correct

from seqrsm.errors import ConfigurationError, ScatteringDataError
from seqrsm.scattering.coherence import FIELD_SD, MOST, Coherence, _at_frequency, _shipped, coherence
from seqrsm.scattering.emissivity import load_emissivity_table
from seqrsm.scattering.readers import shipped_rows
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scattering.variability import Variability
from seqrsm.scattering.worlds import World
from seqrsm.score.bare_soil import retrieved_fields
from seqrsm.sensor.hardware import data_rate_bit_s
from seqrsm.sensor.named import radar_of, sensors_called
from seqrsm.simulate.radar import occasion
from seqrsm.simulate.radar.fading import fade_together
from seqrsm.simulate.radar.occasion import look_up
from seqrsm.simulate.radar.psm import simulate_radar
from seqrsm.simulate.visits import Visit

TABLE = load_sigma0_table()
FULL = ("HH", "HV", "VV", "phase")
COMPACT = ("RH", "RV", "phase")
HH, VV, NOISE = 2.0, 0.5, 0.1
COVERS = ("Wheat", "Rapeseed", "Bareground")


def faded(relation: complex, looks: float, shape: tuple[int, int] = (100, 6000)) -> np.ndarray:
    """HH, VV, HH + VV and HH + i VV with fading, (4, ...); noise has no phase."""
    rng = np.random.default_rng(5)
    mean = relation * np.sqrt(HH * VV)
    both = np.stack([np.full(shape, 0.5 * (HH + VV) + part) for part in (mean.real, mean.imag)])
    alone = rng.gamma(looks, 1.0 / looks, (2, *shape)) * np.array([HH + NOISE, VV + NOISE])[:, None, None]
    out = np.empty((2, *shape))
    rows = np.full(shape[0], NOISE), np.full(shape[0], looks)
    ground = np.full(shape, HH), np.full(shape, VV), both
    fade_together(*ground, *rows, rng.exponential(size=(2, *shape)), alone[0], alone[1], out)
    return np.concatenate([alone, out]).reshape(4, -1)


def averaged(relation: complex, looks: int, n: int = 600_000) -> np.ndarray:
    """The same by the definition: means over looks of products of complex Gaussian waves."""
    rng = np.random.default_rng(6)
    waves = rng.normal(scale=np.sqrt(0.5), size=(4, looks, n, 2)) @ [1.0, 1.0j]
    hh = np.sqrt(HH) * waves[0] + np.sqrt(NOISE) * waves[2]
    of_hh, own = np.conj(relation) * waves[0], np.sqrt(1.0 - abs(relation) ** 2) * waves[1]
    vv = np.sqrt(VV) * (of_hh + own) + np.sqrt(NOISE) * waves[3]
    powers = [
        np.mean(np.abs(w) ** 2, axis=0) for w in (hh, vv, (hh + vv) / np.sqrt(2.0), (hh + 1j * vv) / np.sqrt(2.0))
    ]
    return np.stack(powers)


@pytest.mark.parametrize("relation", [0.0, 0.6 * np.exp(0.7j), -0.95])
@pytest.mark.parametrize("looks", [1, 2, 5])
def test_the_law_is_that_of_averaged_complex_waves(relation: complex, looks: int) -> None:
    ours, theirs = faded(relation, looks), averaged(relation, looks)
    np.testing.assert_allclose(ours.mean(axis=1), theirs.mean(axis=1), rtol=0.01)
    np.testing.assert_allclose(np.cov(ours), np.cov(theirs), rtol=0.02, atol=0.02 * HH**2 / looks)
    for one, other in zip(ours, theirs, strict=True):
        assert ks_2samp(one[::3], other[::3]).statistic < 0.006  # 1 in 1000 of 200,000 each: 0.0062
    product = [(1.0, 1.0j) @ (x[2:] - 0.5 * (x[0] + x[1])) / np.sqrt(x[0] * x[1]) for x in (ours, theirs)]
    for of in (np.abs, np.angle):  # one look is coherent with itself
        assert ks_2samp(*(np.round(of(z[::3]), 9) for z in product)).statistic < 0.006


def test_between_whole_looks_the_moments_are_those_of_the_wishart_law() -> None:
    """The variance of any power is its square over N, and the covariance of two the square of their mean product."""
    relation, looks = 0.6 * np.exp(0.7j), 2.5
    x = faded(relation, looks)
    np.testing.assert_allclose(np.var(x, axis=1) * looks, np.square(x.mean(axis=1)), rtol=0.015)
    shared = abs(relation) ** 2 * HH * VV / looks
    assert np.cov(x[0], x[1])[0, 1] == pytest.approx(shared, rel=0.03)


def test_each_pixel_is_the_sum_of_a_part_of_hh_and_a_part_of_its_own() -> None:
    """By complex waves, in lines that end anywhere; each row by its own looks and noise."""
    rng, shape, looks = np.random.default_rng(7), (3, 4000), np.array([1.0, 2.5, 40.0])
    hh, vv, own_hh, own_vv = rng.gamma(2.0, 1e-13, (4, *shape))
    relation = 0.9 * np.sqrt(rng.random(shape)) * np.exp(2j * np.pi * rng.random(shape))
    both = np.stack([0.5 * (hh + vv) + part * np.sqrt(hh * vv) for part in (relation.real, relation.imag)])
    free, noise = rng.exponential(size=(2, *shape)), 1e-14 * np.arange(3.0)
    first, second, out_vv, out = hh + noise[:, None], vv + noise[:, None], own_vv.copy(), np.empty((2, *shape))
    fade_together(hh, vv, both, noise, looks, free, own_hh, out_vv, out)
    seen = relation * np.sqrt(hh * vv / (first * second))
    more = (looks - 1.0)[:, None]  # one look has nothing without a phase
    wave, rest = np.sqrt(own_hh / first), np.where(more > 0.0, np.exp(-free[0] / np.maximum(more, 1e-300)), 0.0)
    alone = (1.0 - np.abs(seen) ** 2) * own_vv / second
    of_vv = np.conj(seen) * wave + np.sqrt(alone * (1.0 - rest)) * np.exp(2j * np.pi * np.exp(-free[1]))
    power = second * (np.abs(of_vv) ** 2 + alone * rest)
    np.testing.assert_allclose(out_vv, power, rtol=1e-7)
    product = np.sqrt(first * second) * wave * np.conj(of_vv)
    np.testing.assert_allclose(out[0] - 0.5 * (own_hh + power), product.real, atol=1e-20)
    np.testing.assert_allclose(out[1] - 0.5 * (own_hh + power), product.imag, atol=1e-20)


def test_without_echo_and_noise_there_is_no_product() -> None:
    dark, bright = np.zeros((1, 4)), np.ones((1, 4))
    out_hh, out_vv, both = 0.0 * dark, 2.0 * bright, np.full((2, 1, 4), np.nan)
    mean = dark, bright, np.full((2, 1, 4), 0.5)
    fade_together(*mean, np.zeros(1), np.ones(1), np.ones((2, 1, 4)), out_hh, out_vv, both)
    np.testing.assert_array_equal(both, 1.0)
    np.testing.assert_array_equal(out_vv, 2.0)


@pytest.mark.parametrize(("relation", "looks"), [(1.0, 1.0), (1.0, 1e6), (0.0, 1e6), (1.0j, 3.0)])
def test_extremes_stay_finite_and_not_negative(relation: complex, looks: float) -> None:
    x = faded(relation, looks, (10, 1000))
    assert np.isfinite(x).all()
    assert (x >= -1e-12).all()
    if looks == 1e6:
        np.testing.assert_allclose(x.std(axis=1) / x.mean(axis=1), 1e-3, rtol=0.1)


def test_every_cover_has_a_relation() -> None:
    rows = shipped_rows("coherence.csv")
    assert {row.text("category") for row in rows} == {"", *TABLE.categories}
    size = [abs(complex(float(row.text("real")), float(row.text("imaginary")))) for row in rows]
    assert max(size) <= MOST
    found = coherence(("Trees", "Rapeseed", "Rapeseed", "none such"), 5.4)
    assert found.mean[0] == pytest.approx(1.0 / 3.0, abs=0.01)  # thin dipoles in all directions
    assert found.mean[1] == found.mean[2] == 0.20 - 0.07j
    assert coherence(("Rapeseed",), 40.0).mean[0] == 0.20 - 0.07j
    middle = coherence(("Rapeseed",), np.sqrt(1.25 * 5.4)).mean[0]
    assert middle == pytest.approx(0.46 - 0.135j)
    assert found.status == ("assumed", "measured", "measured", "assumed")


def test_away_from_nodes_less_is_known() -> None:
    """As of a random walk over the octaves, tied at the nodes: two of them 2.11 octaves apart."""
    octaves = np.log2(5.4 / 1.25)
    for ghz, walked in ((1.25, 0.0), (np.sqrt(1.25 * 5.4), octaves / 4.0), (21.6, 2.0), (5.5, np.log2(5.5 / 5.4))):
        _, sd, status, _ = _at_frequency(tuple(_shipped()["Rapeseed"]), ghz)
        assert sd == pytest.approx(np.hypot(0.1, np.sqrt(0.017 * walked)))
        assert status == ("assumed" if ghz == 21.6 else "measured")


@pytest.mark.parametrize(
    ("cover", "classes"),
    [
        ("Grass", ("Grass",)),
        ("Forage", ("Lucerne",)),
        ("Wheat", ("Wheat", "Wheat 2", "Wheat 3")),
        ("Oats", ("Barley",)),
        ("Vegetables", ("Stem beans", "Peas", "Beet", "Potatoes")),
        ("Rapeseed", ("Rapeseed",)),
        ("Trees", ("Forest",)),
        ("Bareground", ("Bare soil",)),
        ("Water", ("Water",)),
        ("Buildings", ("Buildings",)),
    ],
)
def test_in_l_band_covers_are_related_as_the_flight_found(cover: str, classes: tuple[str, ...]) -> None:
    path = Path(__file__).parents[1] / "reference" / "data" / "flevoland_class_sigma0.csv"
    flight = pd.read_csv(path, comment="#", index_col="class").loc[list(classes)]
    relation = flight["hhvv_coherence"] * np.exp(1j * np.deg2rad(flight["hhvv_phase_deg"]))
    assert abs(coherence((cover,), 1.25).mean[0] - relation.mean()) < 0.03


def test_worlds_depart_by_what_is_stated_and_near_bands_by_the_same() -> None:
    drawn = np.array([coherence(("Wheat",), f, World(3, k)).mean[0] for k in range(600) for f in (1.25, 1.4, 5.4)])
    low, near, high = drawn.reshape(600, 3).T
    table = coherence(("Wheat",), 1.25)
    assert abs(low.mean() - table.mean[0]) < 4.0 * 0.1 / np.sqrt(300)
    assert low.real.std() == pytest.approx(0.1, rel=0.12)
    assert low.imag.std() == pytest.approx(0.1, rel=0.12)
    assert np.corrcoef(low.real, near.real)[0, 1] > 0.97
    assert np.corrcoef(low.real, high.real)[0, 1] == pytest.approx(0.3, abs=0.15)
    world = World(3, 1)
    same, moved = (coherence(COVERS, 1.25, one).mean for one in (world, replace(world, elsewhere=("Wheat",))))
    assert same[0] != moved[0]
    np.testing.assert_array_equal(same[1:], moved[1:])


def test_layers_of_the_phase_are_powers_of_hh_and_vv_added() -> None:
    ground = SimpleNamespace(categories=COVERS)
    hh, cross, vv, plus, quarter = look_up(ground, radar(channels=FULL), TABLE, (0.2, 5.0))
    related, theta = coherence(COVERS, 5.3), hh.theta_deg
    apart = np.square(np.sin(np.deg2rad(np.minimum(theta, 40.0))) / np.sin(np.deg2rad(40.0)))
    # At nadir <HH VV*> = <|HH|^2> - 2 <|HV|^2> (azimuthal symmetry).
    nadir = np.clip(1.0 - 2.0 * cross.sigma0[:, :1] / hh.sigma0[:, :1], -0.98, 0.98)
    relation = apart * related.mean[:, None] + (1.0 - apart) * nadir
    for layer, sign in ((plus, 1.0), (quarter, 1j)):
        # |a + s b|^2 / 2 = (|a|^2 + |b|^2) / 2 + Re(conj(s) a conj(b)).
        product = np.conj(sign) * relation * np.sqrt(hh.sigma0 * vv.sigma0)
        np.testing.assert_allclose(layer.sigma0, 0.5 * (hh.sigma0 + vv.sigma0) + product.real, rtol=1e-12)
        assert layer.status == related.status
    assert radar(channels=FULL).layers == ("HH", "HV", "VV", "HH+VV", "HH+iVV")


def test_before_sowing_a_crop_is_related_as_bare_soil_is() -> None:
    ground = SimpleNamespace(categories=("Corn", "Bareground", "Trees"))
    found = {}
    for day in (100.0, 200.0):
        hh, vv, plus, _ = look_up(ground, radar(channels=("HH", "VV", "phase")), TABLE, (0.2, 5.0), day)
        at = [one.sigma0[:, 40] for one in (hh, vv, plus)]
        found[day] = (at[2] - 0.5 * (at[0] + at[1])) / np.sqrt(at[0] * at[1])
    soil, crop = (coherence((name,), 5.3).mean[0].real for name in ("Bareground", "Corn"))
    np.testing.assert_allclose(found[100.0], [soil, soil, found[200.0][2]], rtol=1e-6)
    assert found[200.0][0] == pytest.approx(crop, abs=0.05)


HEADER = "quantity,category,frequency_ghz,polarization,theta_deg,value,unit,status,source,coherence,phase_deg"


def test_soil_between_plants_is_that_of_the_world_and_fields_keep_half_of_their_departure() -> None:
    world, closed = World(4, 7), np.array([0.25])
    mixed, crop, soil = (
        coherence((name,), 1.25, world, share).mean[0]
        for name, share in (("Corn", closed), ("Corn", 1.0), ("Bareground", 1.0))
    )
    assert mixed == pytest.approx(0.25 * crop + 0.75 * soil)
    ground = patches(40, 4)
    offset = [
        simulate_radar(
            ground, radar(channels=FULL, fading="none"), TABLE, seed=1, run_id=1, visit=Visit((180.0, 190.0), date)
        ).occasion.field_offset_db
        for date in (0, 1)
    ]
    known = ground.cover[::4, ::4].ravel() < 2
    of_relation = []
    for one in offset:  # at equal powers the layer departs by the relation alone
        hh, _, vv, plus, _ = (10.0 ** (0.1 * layer[known]) for layer in one)
        of_relation.append(plus - 0.5 * (hh + vv))
    assert 0.3 < np.corrcoef(of_relation)[0, 1] < 0.8


def own_table(
    folder: Path, *cells: str, quantity: str = "sigma0", channels: tuple[str, ...] = ("HH", "HV", "VV")
) -> Path:
    """Soybean at 1.25 and 5 GHz, -10 dB; ``cells``: coherence and phase of the rows of each frequency."""
    unit = "-10,dB" if quantity == "sigma0" else "0.9,1"
    lines = [
        f"{quantity},Soybean,{ghz},{channel},{theta},{unit},measured,ours,{own}"
        for ghz, own in zip(("1.25", "5"), cells, strict=True)
        for channel in channels
        for theta in ("20", "60")
    ]
    path = folder / "own.csv"
    path.write_text("\n".join([HEADER, *lines]) + "\n", encoding="utf-8")
    return path


def test_a_table_of_ones_own_may_tell_the_relation(tmp_path: Path) -> None:
    table = load_sigma0_table(own_table(tmp_path, "0.6,90", "0.4,-60"))
    ground = SimpleNamespace(categories=("Soybean", "Wheat"))
    for ghz, expected in ((1.25, 0.6j), (5.0, 0.4 * np.exp(-1j * np.pi / 3.0)), (2.5, 0.1 + 0.3j - 0.1j * 3**0.5)):
        hh, vv, *both = look_up(ground, radar(channels=("HH", "VV", "phase"), frequency_ghz=ghz), table, (0.2, 5.0))
        own = [(one.sigma0 - 0.5 * (hh.sigma0 + vv.sigma0)) / np.sqrt(hh.sigma0 * vv.sigma0) for one in both]
        np.testing.assert_allclose(own[0][:, 40], [expected.real, coherence(("Wheat",), ghz).mean[0].real], atol=1e-9)
        np.testing.assert_allclose(own[1][0, 40], expected.imag, atol=1e-9)
    assert both[0].status == ("measured", "measured")
    drawn = [coherence(("Soybean",), 1.25, World(1, k), 1.0, table.relations).mean[0].real for k in range(300)]
    assert np.std(drawn) == pytest.approx(0.1, rel=0.2)


@pytest.mark.parametrize(
    ("cells", "quantity", "words"),
    [
        ("1.2,0", "sigma0", "coherence: not a number from 0 to 0.98"),
        ("0.5,400", "sigma0", "phase_deg: not a number from -180 to 180"),
        (",40", "sigma0", "coherence: not a number"),
        ("0.5,40", "emissivity", "coherence: a table by this state is not supported"),
    ],
)
def test_impossible_relations_are_told_with_their_line(tmp_path: Path, cells: str, quantity: str, words: str) -> None:
    channels, read = (
        (("HH", "HV", "VV"), load_sigma0_table) if quantity == "sigma0" else (("H", "V"), load_emissivity_table)
    )
    path = own_table(tmp_path, cells, cells, quantity=quantity, channels=channels)
    with pytest.raises(ScatteringDataError, match=words) as caught:
        read(path)
    assert caught.value.problems[0].line == 2


def patches(n: int = 24, cells: int = 20) -> object:
    cover = np.kron(np.random.default_rng(2).integers(0, len(COVERS), (n, n)), np.ones((cells, cells), dtype=int))
    field = np.kron(np.arange(n * n).reshape(n, n), np.ones((cells, cells), dtype=int))
    return scene(np.zeros(cover.shape), 5.0, cover, field, COVERS)


@pytest.mark.parametrize(
    "more", [{}, {"pixel_m": 10.0}, {"texture_db": 1.0}, {"calibration_sd_db": 1.0}, {"adc_bits": 1}]
)
def test_an_image_has_the_phase_of_its_ground_through_noise_and_fading(more: dict[str, float]) -> None:
    """Mean products of HH and VV over all pixels of a cover are those of its fields, on that date."""
    ground, sensor = patches(), radar(channels=FULL, peak_power_w=0.5, **more)  # as much noise as echo
    image = simulate_radar(ground, sensor, TABLE, seed=1, run_id=1)
    mean, power = image.mean_power, image.intensity
    pixel = image.pixel_of_cell[10::20, 10::20].ravel()
    cover = ground.cover[10::20, 10::20].ravel()
    for k, name in enumerate(COVERS):
        inner = pixel[cover == k]
        for x in (mean, power):
            hh, _, vv, *both = (layer.ravel()[inner] for layer in x)
            own = [layer - 0.5 * (hh + vv) for layer in both]
            true = [layer.ravel()[inner] for layer in mean]
            relation = sum(own[0] + 1j * own[1]) / sum(np.sqrt(true[0] * true[2]))
            error = 3.0 * FIELD_SD / np.sqrt(len(inner)) + (0.05 if x is power else 0.01)
            assert abs(relation - coherence((name,), 5.3).mean[0]) < error + 0.01
            assert (np.hypot(*own) <= np.sqrt(hh * vv) * (1.0 + 1e-4)).all()  # none beyond what waves can be


@pytest.mark.parametrize(
    "more",
    [
        {"looks": 1.0},
        {"looks": 1.0, "depression_angle_deg": 5.0},
        {"depression_angle_deg": 80.0},
        {"pixel_m": 10.0, "cell_shape": "gaussian", "resolution_m": 20.0},
        {"heading_deg": 37.0, "range_format": "slant"},
        {"season": "winter", "snow": "wet"},
        {"scan": "ppi", "aperture": "real", "resolution_m": 30.0},
        {"soil_moisture_field_sd": 0.05, "calibration_sd_db": 2.0, "texture_db": 1.0, "frequency_ghz": 10.0},
        {"channels": COMPACT, "soil_moisture_field_sd": 0.05, "calibration_sd_db": 2.0, "texture_db": 1.0},
        {"channels": COMPACT, "looks": 1.0, "pixel_m": 10.0},
    ],
)
def test_rough_ground_with_holes_has_a_phase_that_waves_can_have(more: dict[str, object]) -> None:
    rng = np.random.default_rng(0)
    elevation = rng.normal(0.0, 3.0, (160, 160)).cumsum(axis=0)
    elevation[5:9, 7:9] = np.nan
    ground = replace(patches(8), elevation_m=elevation.astype(np.float32), scored=np.isfinite(elevation))
    options = {"seed": 3, "run_id": 1, "visit": Visit() if "season" in more else Visit((150.0, 200.0), 1)}
    one, two = (
        simulate_radar(ground, radar(**{"channels": FULL, **more}), TABLE.in_world(World(1, 2)), threads=n, **options)
        for n in (1, 2)
    )
    np.testing.assert_array_equal(one.intensity, two.intensity)
    hh, *_, vv, plus, quarter = one.intensity.astype(np.float64)
    product = np.hypot(*(layer - 0.5 * (hh + vv) for layer in (plus, quarter)))
    assert np.isfinite(product).all()
    assert (product <= np.sqrt(hh * vv) * (1.0 + 1e-3) + 1e-6 * hh.max()).all()


def test_fields_scatter_by_their_own_relation_and_powers_are_as_without_the_phase() -> None:
    ground = patches()
    options = {"seed": 1, "run_id": 1}
    full, plain = (simulate_radar(ground, radar(channels=c, fading="none"), TABLE, **options) for c in (FULL, FULL[:3]))
    np.testing.assert_array_equal(full.mean_power[:3], plain.mean_power)
    pixel = full.pixel_of_cell[10::20, 10::20].ravel()
    hh, _, vv, plus, _ = (layer.ravel()[pixel] for layer in full.mean_power)
    of_fields = (plus - 0.5 * (hh + vv)) / np.sqrt(hh * vv)
    cover = ground.cover[10::20, 10::20].ravel()
    spread = [of_fields[cover == k].std() for k in range(2)]  # relations of bare soil end at 1
    np.testing.assert_allclose(spread, FIELD_SD, rtol=0.2)


def test_covers_of_the_same_powers_are_told_apart_by_the_phase(monkeypatch: pytest.MonkeyPatch) -> None:
    def related(categories: tuple[str, ...], *_: object) -> Coherence:
        mean = np.array([0.6, -0.6, 0.6j])[: len(categories)]
        return Coherence(mean, ("assumed",) * 3, ())

    monkeypatch.setattr(occasion, "coherence", related)
    names = ("Wheat", "Oats", "Rapeseed")
    curves = dict(TABLE.curves)
    for name in names:
        curves[name, "spring_summer"] = replace(TABLE.curves["Wheat", "spring_summer"], category=name)
    bare = {key: own for key, own in TABLE.variability.items() if key[0] == "Bareground"}  # of which every table knows
    same = replace(TABLE, curves=curves, variability=bare)
    ground = replace(patches(), categories=names)
    score = {}
    for channels in (FULL, FULL[:3]):
        image = simulate_radar(ground, radar(channels=channels), same, seed=1, run_id=1)
        score[channels] = percent_correct([image], ground, by="field", tile_m=500.0, seed=1, run_id=1).value
    assert score[FULL[:3]] < 45.0  # a third by chance
    assert score[FULL] > 97.0


@pytest.mark.parametrize("ghz", [1.25, 5.4])
def test_a_circular_wave_is_returned_as_the_scattering_matrix_has_it(ghz: float) -> None:
    """By complex waves: a right circular one is (1, -i) in H and V, over the root of 2 (Raney 2007)."""
    ground = SimpleNamespace(categories=COVERS)
    sensor = radar(channels=COMPACT, frequency_ghz=ghz)
    assert sensor.layers == ("RH", "RV", "RH+RV", "RH+iRV")
    seen = [layer.sigma0[:, 40] for layer in look_up(ground, sensor, TABLE, (0.2, 5.0))]
    linear = look_up(ground, radar(channels=FULL[:3], frequency_ghz=ghz), TABLE, (0.2, 5.0))
    rng, relation = np.random.default_rng(9), coherence(COVERS, ghz).mean
    for k, related in enumerate(relation):
        hh, cross, own = rng.normal(scale=np.sqrt(0.5), size=(3, 400_000, 2)) @ [1.0, 1.0j]
        vv = np.conj(related) * hh + np.sqrt(1.0 - abs(related) ** 2) * own
        hh, hv, vv = (np.sqrt(look.sigma0[k, 40]) * w for look, w in zip(linear, (hh, cross, vv), strict=True))
        rh, rv = (hh - 1j * hv) / np.sqrt(2.0), (hv - 1j * vv) / np.sqrt(2.0)
        waves = rh, rv, (rh + rv) / np.sqrt(2.0), (rh + 1j * rv) / np.sqrt(2.0)
        np.testing.assert_allclose([layer[k] for layer in seen], [np.mean(np.abs(w) ** 2) for w in waves], rtol=0.015)


def test_an_image_of_circular_waves_has_the_phase_of_its_fields() -> None:
    """Field by field that of HH and VV less the power of HV, where fields do not differ in power."""
    alike = {
        ("Bareground", channel): Variability((0.0, 0.0), 0.0, "") for channel in ("HH", "HV", "VV")
    }  # no roughness
    ground, even = patches(), replace(TABLE, variability=alike, channel_correlation=1.0)
    images = []
    for channels in (FULL, COMPACT):
        sensor = radar(channels=channels, fading="none", texture_db=0.0)
        images.append(simulate_radar(ground, sensor, even, seed=1, run_id=1))
    pixel = images[0].pixel_of_cell[10::20, 10::20].ravel()
    (hh, hv, vv, *both), (rh, rv, *turned) = (
        [layer.ravel()[pixel].astype(np.float64) for layer in image.mean_power] for image in images
    )
    # Offsets of fields are the same in all channels here, so each is a factor of its field's powers.
    product = (1.0, 1.0j) @ (np.stack(both) - 0.5 * (hh + vv))
    expected = 0.5j * (product - hv)
    np.testing.assert_allclose(rh, 0.5 * (hh + hv), rtol=1e-4)
    np.testing.assert_allclose(rv, 0.5 * (vv + hv), rtol=1e-4)
    np.testing.assert_allclose((1.0, 1.0j) @ (np.stack(turned) - 0.5 * (rh + rv)), expected, atol=3e-3 * rh.max())


@pytest.mark.parametrize(
    ("channels", "pair"), [(("HH", "VV"), "HH and VV"), (("RH", "RV"), "RH and RV"), (("HH",), ""), (("HV", "VV"), "")]
)
def test_a_phase_that_would_add_is_told_where_both_channels_are_there(channels: tuple[str, ...], pair: str) -> None:
    image = simulate_radar(patches(4), radar(channels=channels), TABLE, seed=1, run_id=1)
    told = [note for note in image.notes if "channel 'phase' would add" in note]
    assert told == [f"{pair} are used by their powers; channel 'phase' would add the phase between them"] * bool(pair)


def test_soil_moisture_rests_on_powers_alone() -> None:
    ground = patches(8)
    found = []
    for channels in (FULL, FULL[:3]):
        sensor = radar(channels=channels, frequency_ghz=1.25, soil_moisture_field_sd=0.04, fading="none")
        image = simulate_radar(ground, sensor, TABLE, seed=1, run_id=1)
        found.append(retrieved_fields([image], ground, seed=1, run_id=1)[0])
    np.testing.assert_array_equal(*found)


def test_a_phase_costs_no_pulses_and_no_data() -> None:
    plain, full = radar(channels=FULL[:3]), radar(channels=FULL)
    assert full.n_transmit == plain.n_transmit == 2
    assert data_rate_bit_s(full, 4000.0, 8000.0) == data_rate_bit_s(plain, 4000.0, 8000.0)
    (named,) = sensors_called("RADARSAT-2 Fine Quad SLC")
    both = [radar_of(named, channels, 35.0) for channels in named.channels]
    assert [one.channels[-1] for one in both] == ["phase", "VV"]
    assert both[0].prf_hz == both[1].prf_hz


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"channels": ("HH", "HV", "phase")}, "the phase is that between HH and VV .*Use HH.VV.phase"),
        ({"channels": ("RV", "phase")}, "the phase is that between RH and RV .*Use RH.RV.phase"),
        ({"channels": ("RH", "phase")}, "the phase is that between RH and RV .*Use RH.RV.phase"),
        ({"channels": FULL, "receiver": "saturation"}, "phases need a linear receiver"),
    ],
)
def test_a_phase_needs_both_channels_and_a_linear_receiver(changes: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        radar(**changes)


def test_at_nadir_a_field_is_related_by_its_own_cross_polarized_power(monkeypatch) -> None:
    """<HH VV*> = <|HH|^2> - 2 <|HV|^2> of ground that is the same from all sides: its phase tells nothing more."""
    drawn: list[np.ndarray] = []
    monkeypatch.setattr(occasion, "limited", lambda relation: drawn.append(relation) or relation)
    steep = {"depression_angle_deg": 88.0, "resolution_m": 100.0, "altitude_m": 60_000.0, "earth": "flat"}
    ground, sensor = patches(), radar(channels=FULL, texture_db=0.0, **steep)
    looks = look_up(ground, sensor, TABLE, (0.2, 5.0))
    met = occasion.met_occasion(ground, sensor, TABLE, looks, (0.2, 5.0), Visit(), seed=1, run_id=1)
    kind = ground.cover[10::20, 10::20].ravel()
    departed = (met.class_offset_db[:, kind] + met.field_offset_db)[:2]
    hh, hv = (look.sigma0[kind, 0] * 10.0 ** (0.1 * of) for look, of in zip(looks, departed, strict=False))
    np.testing.assert_allclose(drawn[-1], np.minimum(1.0 - 2.0 * hv / hh, MOST), atol=5e-3)  # two degrees off
    assert np.ptp(hv / hh) > 0.05
    # Layers of the phase are those powers added, by that relation.
    vv = looks[2].sigma0[kind, 2] * 10.0 ** (0.1 * (met.class_offset_db[2, kind] + met.field_offset_db[2]))
    here = looks[0].sigma0[kind, 2] * 10.0 ** (0.1 * departed[0])
    sums = [look.sigma0[kind, 2] for look in looks[-2:]] * 10.0 ** (
        0.1 * (met.class_offset_db[-2:, kind] + met.field_offset_db[-2:])
    )
    relation = drawn[-1]
    expected = [0.5 * (here + vv) + np.sqrt(here * vv) * part for part in (relation.real, relation.imag)]
    np.testing.assert_allclose(sums, expected, rtol=2e-3)
    # What the radar has wrong of its power is no property of the ground.
    wrong = replace(sensor, calibration_sd_db=3.0)
    of_ground = drawn[-1]
    occasion.met_occasion(ground, wrong, TABLE, looks, (0.2, 5.0), Visit(), seed=1, run_id=1)
    np.testing.assert_array_equal(drawn[-1], of_ground)


def test_parts_of_fields_differ_between_hh_and_vv_by_the_angle_as_fields_do() -> None:
    """By the square of the sine below 40 degrees, where nothing but texture makes ground depart."""
    still = {(name, channel): Variability((0.0, 0.0), 0.0, "") for name in COVERS for channel in ("HH", "VV")}
    ground, even, differs = patches(), replace(TABLE, variability=TABLE.variability | still), []
    for angle in (10.0, 40.0, 60.0):
        steep = {"depression_angle_deg": 90.0 - angle, "resolution_m": 100.0, "altitude_m": 60_000.0, "earth": "flat"}
        sensor = radar(channels=("HH", "VV"), texture_db=1.0, **steep)
        looks = look_up(ground, sensor, even, (0.2, 5.0))
        met = occasion.met_occasion(ground, sensor, even, looks, (0.2, 5.0), Visit(), seed=1, run_id=1)
        differs.append(float(np.std(met.field_offset_db[0] - met.field_offset_db[1])))
    share = (np.sin(np.deg2rad(10.0)) / np.sin(np.deg2rad(40.0))) ** 2
    assert differs[0] == pytest.approx(share * differs[1], rel=0.15)
    assert differs[2] == pytest.approx(differs[1], rel=0.15)
