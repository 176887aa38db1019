"""Program SIMULATE against closed forms: footprints, coverage, beams, smear, noise, gaps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from prm_cases import Table, footprint_across_m, footprint_along_m, image, radiometer, scene, small_score

from seqrsm.errors import ConfigurationError
from seqrsm.scattering.emissivity import load_emissivity_table
from seqrsm.sensor.scan import BEAM_STEPS_A_WIDTH, beam_integral, scan_geometry, smeared
from seqrsm.simulate.radiometer.frame import make_radiometer_frame
from seqrsm.simulate.radiometer.prm import lookups_of, simulate_radiometer
from seqrsm.simulate.runner import run_many

FLAT = scene(np.zeros((200, 240)), 5.0)


def test_footprint_at_nadir_is_the_square_of_the_resolution():
    for height in (300.0, 1000.0, 8e5):
        r = radiometer(altitude_m=height, resolution_m=0.03 * height)
        scan = scan_geometry(r, height, 2.0 * height, 3.0 * height)
        middle = len(scan.look_rad) // 2
        assert scan.look_rad[middle] == 0.0
        assert footprint_across_m(scan)[middle] * footprint_along_m(scan)[middle] == pytest.approx(
            r.resolution_m**2, rel=1e-12
        )


def test_neighbours_of_one_line_touch_and_do_not_overlap():
    scan = scan_geometry(radiometer(), 1000.0, 2000.0, 1000.0)
    half = 0.5 * scan.beamwidth_rad
    edges = np.tan(scan.look_rad + half)[:-1], np.tan(scan.look_rad - half)[1:]
    np.testing.assert_allclose(*edges, atol=1e-12)


def test_coverage_sums_to_the_area_of_all_footprints():
    r = radiometer(beam="box", integration_time_ms=0.01, altitude_m=2000.0, resolution_m=60.0, speed_m_s=120.0)
    found = image(FLAT, r, Table((0.9,)))
    scan = found.scan
    # Footprints of the middle third of each line lie inside the scene whatever the line.
    inner = np.abs(scan.look_rad) < np.arctan(300.0 / 2000.0)
    area = float((footprint_across_m(scan) * footprint_along_m(scan))[inner].sum()) * scan.n_lines
    reach = 2000.0 * np.tan(np.abs(scan.look_rad[inner]).max() + 0.5 * scan.beamwidth_rad)
    y = (np.arange(200) - 99.5) * 5.0
    counted = found.coverage[np.abs(y) < reach].sum() * 25.0
    assert counted == pytest.approx(area, rel=0.03)
    assert found.coverage.max() <= 3


def test_every_cell_belongs_to_the_footprint_that_sees_it():
    r = radiometer(beam="box", integration_time_ms=0.01, altitude_m=2000.0, resolution_m=60.0, speed_m_s=60.0)
    found = image(FLAT, r, Table((0.9,)))
    sample, line = np.divmod(found.pixel_of_cell, found.scan.n_lines)
    y = (np.arange(200)[:, None] - 99.5) * 5.0
    phi = np.arctan(y / 2000.0)
    assert (np.abs(found.scan.look_rad[sample] - phi) <= 0.5 * found.scan.beamwidth_rad + 1e-12).all()
    assert (np.diff(line[100]) >= 0).all()
    assert set(np.unique(line)) == set(range(found.scan.n_lines))


def brute_force(found, emitted, beam):
    """Footprints by a straightforward double sum over cells."""
    scan = found.scan
    n, m = emitted.shape
    y = (np.arange(n) - 0.5 * (n - 1)) * 5.0
    phi = np.arctan(y / scan.height_m)
    d_phi = 5.0 * scan.height_m / (scan.height_m**2 + y**2)
    x = (np.arange(m) + 0.5) * 5.0
    out = np.empty((len(scan.look_rad), scan.n_lines))
    part = 0.5 + 0.5 * phi / scan.half_angle_rad
    width = found.radiometer.resolution_m / np.cos(phi)
    for s, look in enumerate(scan.look_rad):
        across = beam((phi - look) / scan.beamwidth_rad) * d_phi
        for line in range(scan.n_lines):
            centre = scan.advance_m * (line + (part if line % 2 == 0 else 1.0 - part))
            along = beam((x - centre[:, None]) / width[:, None]) / width[:, None]
            weight = across[:, None] * along
            out[s, line] = (weight * emitted).sum() / weight.sum()
    return out


@pytest.mark.parametrize(("name", "beam", "tolerance"), [
    ("gaussian", lambda u: np.where(np.abs(u) <= 1.75, np.exp(-4.0 * math.log(2.0) * u**2), 0.0), 0.02),
    ("box", lambda u: np.clip(5.5 - 10.0 * np.abs(u), 0.0, 1.0), 0.05),  # cells are a tenth of a beam wide
    ("sidelobes", lambda u: np.where(np.abs(u) <= 8.0, np.sinc(0.8858929 * u) ** 2, 0.0), 0.05),
])  # fmt: skip
def test_footprints_are_the_beam_weighted_means(name, beam, tolerance):
    layer = np.random.default_rng(3).uniform(250.0, 330.0, (100, 120))
    s = scene(np.zeros((100, 120)), 5.0)
    r = radiometer(beam=name, integration_time_ms=1e-3, altitude_m=800.0, scan_period_s=0.8, noise_temperature_k=0.0)
    found = image(s, r, Table((1.0,)), temperature_k=layer)
    np.testing.assert_allclose(found.mean_k[0], brute_force(found, layer, beam), atol=tolerance)


def test_beam_smaller_than_a_cell_and_larger_than_the_scene():
    cover = np.arange(600).reshape(20, 30) % 2
    s = scene(np.zeros((20, 30)), 50.0, cover)
    fine = image(
        s, radiometer(resolution_m=2.0, speed_m_s=40.0, scan_period_s=0.1, integration_time_ms=0.01), Table((0.3, 0.9))
    )
    levels = np.unique(np.round(np.ravel(fine.mean_k), 6))
    low, high = 0.3 * 300 + 0.7 * 2.72548, 0.9 * 300 + 0.1 * 2.72548
    assert levels[0] == pytest.approx(low)
    assert levels[-1] == pytest.approx(high)
    assert np.isin(np.round(fine.mean_k, 3), np.round([low, high], 3)).mean() > 0.8
    wide = image(s, radiometer(resolution_m=1e6, integration_time_ms=1.0), Table((0.3, 0.9)))
    assert wide.mean_k.shape[1] == 1
    np.testing.assert_allclose(wide.mean_k, 0.5 * (low + high), rtol=2e-3)
    assert (wide.pixel_of_cell >= 0).all()


def test_one_line_and_one_cell_row():
    s = scene(np.zeros((40, 60)), 5.0)
    one = image(s, radiometer(speed_m_s=60.0, scan_period_s=10.0), Table((0.9,)))
    assert one.scan.n_lines == 1
    assert np.isfinite(one.mean_k).all()
    # A craft that is past the scene before the sweep ends records nothing there.
    fast = image(s, radiometer(speed_m_s=1000.0, scan_period_s=10.0), Table((0.9,)))
    assert np.isfinite(fast.mean_k[0, 0, 0])
    assert np.isnan(fast.mean_k[0, -1, 0])
    thin = image(scene(np.zeros((2, 60)), 5.0), radiometer(), Table((0.9,)))
    assert np.isfinite(thin.mean_k).all()


def test_smear_is_the_beam_averaged_over_its_way():
    box = beam_integral(radiometer(beam="box"))
    got = smeared(box, 2.0)
    u = (np.arange(len(got)) - 0.5 * (len(got) - 1)) / BEAM_STEPS_A_WIDTH
    # A box of 1 over a way of 2 is a trapezium: flat at 1/2 within 1/2 of the axis, zero beyond 3/2.
    density = np.gradient(got, u)
    np.testing.assert_allclose(density[np.abs(u) < 0.48], 0.5, atol=1e-9)
    np.testing.assert_allclose(got[u <= -1.5], 0.0, atol=1e-12)
    assert got[-1] == pytest.approx(1.0)
    assert np.interp(-1.0, u, got) == pytest.approx(0.0625, abs=1e-4)
    np.testing.assert_array_equal(smeared(box, 0.0), box)


def test_long_integration_smears_across_and_spaces_footprints():
    r = radiometer(altitude_m=2000.0, integration_time_ms=100.0)
    scan = scan_geometry(r, 2000.0, 1000.0, 1000.0)
    assert scan.smear == pytest.approx(100.0 / scan.dwell_ms)
    assert scan.step_rad == pytest.approx(scan.beamwidth_rad * scan.smear)
    assert any("exceeds the dwell" in note for note in scan.notes)


def test_gaps_are_recorded_or_refused_and_told():
    r = radiometer(scan_period_s=4.0, integration_time_ms=1.0)
    found = image(FLAT, r, Table((0.9,)))
    assert any("gaps at nadir" in note and "25 %" in note for note in found.scan.notes)
    middle = found.coverage[95:105]
    assert (middle > 0).mean() == pytest.approx(0.25, abs=0.05)
    assert (found.pixel_of_cell >= 0).all()
    with pytest.raises(ConfigurationError, match=r"gaps at nadir.*at most 1 s"):
        image(FLAT, radiometer(scan_period_s=4.0, gaps="refuse"), Table((0.9,)))


def test_time_that_is_not_used_is_told():
    """A sweep of 0.5 s over 1 km from 1 km: 2 atan(0.5) in all, of which a beam is 2 atan(0.025)."""
    notes = scan_geometry(radiometer(integration_time_ms=4.0), 1000.0, 1000.0, 1000.0).notes
    dwell_ms = 500.0 * math.atan(0.025) / math.atan(0.5)
    idle = 100.0 * (1.0 - 4.0 / dwell_ms)
    assert notes == (f"idle time: {idle:.0f} % of the dwell of {dwell_ms:.4g} ms is not integrated",)


def test_what_is_kept_with_a_score_is_in_its_units():
    """Two thirds of the ground emit 150 K, the rest 270 K; the receiver adds 500 K and takes 1e7 samples."""
    cover = np.zeros((200, 240), dtype=np.uint8)
    cover[:, 160:] = 1
    r = radiometer(scan_period_s=4.0, temperature_low_k=300.0, temperature_high_k=300.0)
    found = image(scene(np.zeros(cover.shape), 5.0, cover), r, Table((0.5, 0.9)))
    kept = found.record(("class 0", "class 1"))
    sky = 2.725
    assert kept["nedt_k"] == [pytest.approx((0.5 * 300.0 + 0.5 * sky + 500.0) / math.sqrt(1e9 * 0.01), abs=2e-4)]
    assert kept["beamwidth_deg"] == pytest.approx(math.degrees(2.0 * math.atan(25.0 / 1000.0)), abs=1e-5)
    assert kept["covered_percent"] == pytest.approx(100.0 * np.count_nonzero(found.coverage) / cover.size, abs=1e-3)
    assert 20.0 < kept["covered_percent"] < 30.0
    assert kept["blocked_percent"] == 0.0


def test_edges_too_far_from_nadir_are_told():
    across_m = 2.0 * 1500.0 * math.tan(math.radians(80.0))
    told = [scan_geometry(radiometer(), 1500.0, side, 1000.0).notes for side in (0.6 * across_m, across_m)]
    assert not any("wide sweep" in note for note in told[0])
    assert any("the scene ends 80 deg from nadir, where footprints are 33.2 times" in note for note in told[1])


def test_no_dwell_and_too_large_an_antenna_are_refused_with_numbers():
    with pytest.raises(ConfigurationError, match=r"exceeds a sweep of 500 ms"):
        scan_geometry(radiometer(integration_time_ms=600.0), 1000.0, 1000.0, 1000.0)
    with pytest.raises(ConfigurationError, match=r"resolution of at least 36.57 m"):
        scan_geometry(radiometer(resolution_m=36.5, antenna_limit_m=1.0), 1000.0, 1000.0, 1000.0)
    scan_geometry(radiometer(resolution_m=36.6, antenna_limit_m=1.0), 1000.0, 1000.0, 1000.0)
    # Sweeps side by side, and 20 ms of a dwell of 27 ms: nothing to note.
    assert scan_geometry(radiometer(integration_time_ms=20.0), 1000.0, 1000.0, 1000.0).notes == ()
    with pytest.raises(ConfigurationError, match="not above the ground"):
        image(scene(np.full((5, 5), 1200.0)), radiometer(), Table((0.9,)))


@pytest.mark.parametrize(("resolution_m", "told"), [(18.2, True), (18.4, False)])
def test_an_antenna_above_two_metres_is_large(resolution_m: float, told: bool) -> None:
    """1.22 x 3 cm over the beam of 18.3 m from 1000 m."""
    notes = scan_geometry(radiometer(resolution_m=resolution_m), 1000.0, 1000.0, 1000.0).notes
    assert any(note.startswith("the beam needs a large antenna: 2.01 m") for note in notes) == told


@pytest.mark.parametrize("cone", [{}, {"conical_incidence_deg": 55.0}])
def test_a_large_antenna_is_told_where_no_limit_is_given(cone):
    """1.22 wavelengths an antenna is the half-power beam: at 1 GHz from 5700 m 26 m for a footprint of 80 m."""
    given = {"frequency_ghz": 1.0, "bandwidth_mhz": 25.0, "resolution_m": 80.0, "integration_time_ms": 1.0, **cone}
    # On a cone the beam goes 1 / cos as far, and its narrow side is the resolution times the root of cos.
    cos = math.cos(math.radians(cone.get("conical_incidence_deg", 0.0)))
    (told,) = (n for n in scan_geometry(radiometer(**given), 5700.0, 1e3, 1e3).notes if "antenna" in n)
    needs = 1.22 * 0.299792458 * 5700.0 / 80.0 / cos**1.5
    assert float(told.partition("antenna: ")[2].split()[0]) == pytest.approx(needs, rel=0.01)
    limited = radiometer(**given, antenna_limit_m=100.0)
    assert not any("antenna" in note for note in scan_geometry(limited, 5700.0, 1e3, 1e3).notes)


@pytest.mark.parametrize("receiver", ["total_power", "dicke", "correlation"])
def test_radiometric_resolution_by_monte_carlo(receiver):
    # The receiver on white Gaussian noise: 2 B tau samples to an estimate of T_A, many estimates.
    rng = np.random.default_rng(11)
    antenna, receiver_k, load, n, repeats = 250.0, 400.0, 310.0, 400, 4000
    r = radiometer(receiver=receiver, noise_temperature_k=receiver_k, reference_temperature_k=load,
                   bandwidth_mhz=0.2, integration_time_ms=1.0)  # fmt: skip
    assert 2.0 * r.bandwidth_mhz * 1e3 * r.integration_time_ms == n
    if receiver == "total_power":
        estimate = (rng.normal(0.0, math.sqrt(antenna + receiver_k), (repeats, n)) ** 2).mean(axis=1) - receiver_k
    elif receiver == "dicke":
        a = rng.normal(0.0, math.sqrt(antenna + receiver_k), (repeats, n // 2)) ** 2
        b = rng.normal(0.0, math.sqrt(load + receiver_k), (repeats, n // 2)) ** 2
        estimate = a.mean(axis=1) - b.mean(axis=1) + load
    else:
        a, b = (rng.normal(0.0, math.sqrt(0.5 * t), (repeats, n)) for t in (antenna, load))
        one = a + b + rng.normal(0.0, math.sqrt(receiver_k), (repeats, n))
        two = a - b + rng.normal(0.0, math.sqrt(receiver_k), (repeats, n))
        estimate = 2.0 * (one * two).mean(axis=1) + load
    assert estimate.mean() == pytest.approx(antenna, abs=5.0 * float(r.nedt_k(antenna)) / math.sqrt(repeats))
    # The standard deviation of a standard deviation is 1 / sqrt(2 n).
    assert estimate.std() == pytest.approx(float(r.nedt_k(antenna)), rel=4.0 / math.sqrt(2.0 * repeats))


def test_radiometric_resolution_of_balanced_receivers():
    given = {"reference_temperature_k": 300.0, "noise_temperature_k": 700.0, "bandwidth_mhz": 100.0}
    ideal = 1000.0 / math.sqrt(1e8 * 1e-2)
    assert radiometer(**given).nedt_k(300.0) == pytest.approx(ideal)
    assert radiometer(receiver="dicke", **given).nedt_k(300.0) == pytest.approx(2.0 * ideal)
    assert radiometer(receiver="correlation", **given).nedt_k(300.0) == pytest.approx(math.sqrt(2.0) * ideal)
    drifting = radiometer(gain_fluctuation=0.01, **given)
    assert drifting.nedt_k(300.0) == pytest.approx(math.hypot(ideal, 10.0))
    # A balanced comparison does not feel the gain.
    assert radiometer(receiver="dicke", gain_fluctuation=0.01, **given).nedt_k(300.0) == pytest.approx(2.0 * ideal)


def test_noise_of_the_image_has_the_stated_deviation_and_is_white():
    r = radiometer(resolution_m=10.0, integration_time_ms=0.05, scan_period_s=0.1, bandwidth_mhz=200.0)
    found = image(FLAT, r, Table((0.9,)))
    z = ((found.brightness_k - found.mean_k) / found.nedt_k)[0]
    n = z.size
    assert n > 5000
    assert abs(z.mean()) < 4.0 / math.sqrt(n)
    assert z.std() == pytest.approx(1.0, abs=4.0 / math.sqrt(2.0 * n))
    for a, b in ((z[1:], z[:-1]), (z[:, 1:], z[:, :-1])):
        assert abs(float((a * b).mean())) < 4.0 / math.sqrt(n)
    assert float((z**3).mean()) == pytest.approx(0.0, abs=4.0 * math.sqrt(15.0 / n))


def test_same_bits_in_any_thread_and_another_run_differs():
    serial = [small_score(k) for k in (1, 2)]
    parallel = [score for _, score in sorted(run_many(small_score, [1, 2], workers=2))]
    assert serial == parallel
    assert len(set(serial)) == 2


def test_channel_noise_does_not_depend_on_its_company():
    table = load_emissivity_table()
    s = scene(np.zeros((60, 60)), categories=("Trees",))
    one = simulate_radiometer(s, radiometer(channels=("V",)), table, seed=1, run_id=4)
    two = simulate_radiometer(s, radiometer(channels=("H", "V")), table, seed=1, run_id=4)
    np.testing.assert_array_equal(one.brightness_k[0], two.brightness_k[1])


def test_single_and_double_precision_agree():
    rng = np.random.default_rng(8)
    s = scene(rng.normal(0.0, 2.0, (80, 90)).cumsum(axis=0), 10.0, rng.integers(0, 3, (80, 90)))
    table = Table((0.5, 0.7, lambda t: 0.95 - t / 300.0))
    a, b = (image(s, radiometer(), table, precision=p) for p in ("float32", "float64"))
    difference = np.abs(a.mean_k - b.mean_k)
    assert np.median(difference) < 2e-4
    assert np.quantile(difference, 0.99) < 0.1


def test_headings_turn_the_scene():
    rng = np.random.default_rng(8)
    s = scene(rng.normal(0.0, 1.0, (40, 60)).cumsum(axis=0), 10.0, rng.integers(0, 2, (40, 60)))
    table = Table((0.4, 0.9))
    west = image(s, radiometer(heading_deg=270.0), table)
    turned = scene(np.rot90(s.elevation_m, 2), 10.0, np.rot90(s.cover, 2))
    east = image(turned, radiometer(heading_deg=90.0), table)
    np.testing.assert_allclose(east.mean_k, west.mean_k)
    np.testing.assert_array_equal(np.rot90(east.pixel_of_cell, 2), west.pixel_of_cell)


def test_no_data_is_left_out_of_the_sums():
    cover = np.zeros((60, 60), dtype=int)
    cover[20:30, 20:30] = 255
    z = np.zeros((60, 60))
    z[5, 5] = np.nan
    found = image(scene(z, 10.0, cover), radiometer(), Table((0.8,)))
    seen = np.isfinite(found.mean_k)
    np.testing.assert_allclose(found.mean_k[seen], 0.8 * 300.0 + 0.2 * 2.72548, rtol=1e-12)
    assert (found.pixel_of_cell[20:30, 20:30] == -1).all()
    assert found.pixel_of_cell[5, 5] == -1


def test_measured_pattern_is_the_formula_it_was_measured_from(tmp_path):
    u = np.linspace(-1.75, 1.75, 400)
    path = tmp_path / "pattern.csv"
    rows = "\n".join(f"{a:.6f},{math.exp(-4.0 * math.log(2.0) * a * a):.8f}" for a in u)
    path.write_text(f"# made\nangle_beamwidths,gain\n{rows}\n")
    measured = beam_integral(radiometer(beam="measured", beam_file=str(path)))
    np.testing.assert_allclose(measured, beam_integral(radiometer()), atol=1e-4)
    path.write_text(path.read_text().replace(",", ";").replace(".", ","))  # as a spreadsheet of many countries has it
    np.testing.assert_array_equal(beam_integral(radiometer(beam="measured", beam_file=str(path))), measured)
    unclosed = '"' + "0,1\n" * 50_000
    for text in (
        "angle,gain\n0,1",
        *(f"angle_beamwidths,gain\n{rows}\n{x}" for x in ("nan,1", "inf,1", "1e9,1", "2,inf", unclosed)),
    ):
        path.write_text(text)
        with pytest.raises(ConfigurationError, match=r"angle_beamwidths|pattern\.csv:402: not a CSV line"):
            beam_integral(radiometer(beam="measured", beam_file=str(path)))
    for text, place in (
        ("0;1", 2),
        ("0,1,2", 2),
        ("0,1\n0.5", 3),
        ("0,0\n1,-3", 3),
        ("0,1\n\n-1,0", 4),
        ("0,1\n,\n0,1", 4),
    ):
        path.write_text(f"angle_beamwidths,gain\n{text}\n")
        with pytest.raises(ConfigurationError, match=rf"pattern\.csv:{place}: .*not a point .* not dB"):
            beam_integral(radiometer(beam="measured", beam_file=str(path)))
    path.write_text("# mine\nangle,gain\n0,1\n")
    with pytest.raises(ConfigurationError, match=r"pattern\.csv:2: .*no antenna pattern.*'angle,gain'"):
        beam_integral(radiometer(beam="measured", beam_file=str(path)))
    with pytest.raises(ConfigurationError, match="cannot read the pattern"):
        beam_integral(radiometer(beam="measured", beam_file=str(tmp_path / "none.csv")))


def test_a_sweep_is_narrow_by_its_beam_over_the_ground():
    """500 m over ground that is 1500 m high: by the narrower beam from 2000 m the sweep was told to miss the edges."""
    for degrees, narrow in ((39.0, False), (33.0, True)):
        made = radiometer(resolution_m=200.0, altitude_m=2000.0, scan_half_angle_deg=degrees)
        notes = scan_geometry(made, 500.0, 1000.0, 1000.0).notes  # edges at 45 deg, half a beam of 11.3 deg
        assert any("narrow sweep" in note for note in notes) == narrow


@pytest.mark.parametrize(("heading", "half_angle"), [(0.0, 0.0), (90.0, 0.0), (90.0, 28.81)])
def test_h_and_v_have_in_common_what_the_looks_over_a_scene_have_on_average(heading: float, half_angle: float) -> None:
    """All at nadir and nine tenths at grazing, by the square of the sine, at the rows that the scan sees."""
    ground = scene(np.full((40, 200), 50.0), 20.0, np.zeros((40, 200)), categories=("Trees",))
    r = radiometer(heading_deg=heading, scan_half_angle_deg=half_angle, altitude_m=450.0)
    across = make_radiometer_frame(ground, r, "float64").across_m
    sine = np.abs(across) / np.hypot(across, 400.0)
    seen = sine[sine <= math.sin(math.radians(half_angle))] if half_angle else sine
    (look,) = lookups_of(ground, r, load_emissivity_table(), None)
    assert look.channel_correlation[0] == pytest.approx(1.0 - 0.1 * np.mean(seen**2), abs=0.0006)
    assert np.mean(seen**2) > 0.05
