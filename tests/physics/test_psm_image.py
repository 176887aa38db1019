"""Phase two and whole images: conservation, ripple, layover, registration, headings, precision, reproducibility."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest
from psm_cases import Table, lut_of, mapped, radar, scene, small_score
from shorthands import percent_correct

from seqrsm.errors import ConfigurationError, SceneError
from seqrsm.scene.layers import fill_gaps
from seqrsm.sensor.swath import ground_ranges_m
from seqrsm.simulate.pictures import grey_scales, picture_of
from seqrsm.simulate.radar import kernels
from seqrsm.simulate.radar.echo import echo_sums
from seqrsm.simulate.radar.frame import make_frame
from seqrsm.simulate.radar.psm import simulate_radar
from seqrsm.simulate.runner import run_many


def rough(n, m, step, seed=0):
    z = np.random.default_rng(seed).normal(0.0, step, (n, m)).cumsum(axis=0)
    return z - z.mean()


def binned(p, r, first=-400, n_bins=3000):
    grid = dataclasses.replace(p.grid, first=first, n_bins=n_bins)
    return echo_sums(r, grid, lut_of(lambda theta: 0.0 * theta + 0.1), np.ones((1, 1)))


def quiet(s, r, table=None, **options):
    return simulate_radar(s, r, table or Table((-10.0,)), seed=1, run_id=1, **options)


@pytest.mark.parametrize(("looks", "says"), [(1.0, "1 look;"), (3.0, "3 looks;"), (None, " to ")])
def test_equal_looks_everywhere_are_no_range(looks, says):
    image = quiet(scene(np.zeros((60, 20)), 10.0), radar(resolution_m=30.0, looks=looks))
    assert says in picture_of(image).remark
    assert "12300 looks;" in picture_of(replace(image, looks=np.full_like(image.looks, 12345.0))).remark


@pytest.mark.parametrize(("side_m", "told"), [(3000.0, False), (6000.0, True)])
def test_what_a_classifier_is_not_given_of_a_wide_swath_is_told(side_m, told):
    image = quiet(scene(np.zeros((round(side_m / 50.0), 20)), 50.0), radar(resolution_m=100.0, looks=None))
    # Of flat ground about 45 deg, at rows half a cell from the edges.
    away = image.radar.altitude_m + (0.5 * side_m - 50.0) * np.array([-1.0, 1.0])
    spans = np.degrees(np.arctan(away / image.radar.altitude_m))
    assert np.ptp(image.incidence_angle_deg) == pytest.approx(np.ptp(spans), abs=0.5)
    assert (np.ptp(spans) > 20.0) == told
    assert any("do not know the incidence angle" in note for note in image.notes) == told


def test_grey_tones_are_those_of_the_ground_and_not_of_noise_around_it():
    """A strong radar's noise lies 40 dB under the ground; where the scene has none the picture is black."""
    cover = np.zeros((120, 120), dtype=np.uint8)
    cover[:, 60:] = 255
    image = quiet(scene(np.zeros(cover.shape), 10.0, cover), radar(resolution_m=30.0, noise_figure_db=1.0))
    picture = picture_of(image)
    assert np.quantile(picture.told(), 0.2) < -40.0
    (scale,) = grey_scales([picture]).values()
    assert -16.0 < 10.0 * np.log10(scale.black) < -10.0 < 10.0 * np.log10(scale.white) < -4.0


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float64, 1e-12), (np.float32, 1e-6)])
@pytest.mark.parametrize("range_format", ["ground", "slant"])
@pytest.mark.parametrize("resolution", [3.1, 13.0])
def test_binning_conserves_power(dtype, tolerance, range_format, resolution):
    # Steep ground, and bins finer than the cells: elements reach over one, two and many bins.
    r = radar(range_format=range_format, resolution_m=resolution, bandwidth_mhz=200.0)
    p = mapped(rough(300, 50, 3.0), 2000.0, 6000.0, 5.0, r, dtype)
    assert p.layover.mean() > 0.02
    assert binned(p, r).sum(dtype=float) == pytest.approx(p.power.sum(dtype=float), rel=tolerance)


@pytest.mark.parametrize("ratio", [1.3, 2.0, 3.3, 5.0, 10.3])
@pytest.mark.parametrize("range_format", ["ground", "slant"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_flat_ground_shows_no_ripple(ratio, range_format, precision):
    cell = 1.0
    r = radar(resolution_m=ratio * cell, bandwidth_mhz=300.0, range_format=range_format, altitude_m=20e3, prf_hz=500.0)
    image = quiet(scene(np.zeros((300, 40)), cell), r, precision=precision)
    apparent = (image.mean_power[0] / image.calibration_w[:, None]).astype(float)
    ripple = np.abs(apparent / 0.1 - 1.0)
    inner = ripple[2:-2] if range_format == "slant" else ripple
    assert inner.max() < 1e-3


def test_flat_image_is_the_sum_of_its_elements():
    r = radar(resolution_m=20.0, earth="flat")
    image = quiet(scene(np.zeros((80, 40)), 5.0), r, precision="float64")
    y, _ = ground_ranges_m(r, 80, 5.0, 0.0, 0.0)
    element = r.radar_constant_w_m2() * 0.1 * 25.0 / (y**2 + 6000.0**2) ** 2
    looks_in_cell = 20.0 / np.asarray(r.ground_resolution_m(np.arctan2(image.ground_range_m, 6000.0))) * 20.0 / 1.0
    expected = 4 * element.reshape(-1, 4).sum(axis=1) / looks_in_cell
    np.testing.assert_allclose(image.mean_power[0], np.repeat(expected[:, None], 10, axis=1), rtol=1e-12)


def test_a_steep_ridge_lays_over_towards_the_radar():
    # 60 m high, foreslope 60 deg against an incidence near 35 deg: top comes before foot.
    n, cell, height = 200, 1.0, 6000.0
    z = np.zeros(n)
    z[100:136] = np.minimum(np.arange(36) * math.tan(math.radians(60.0)), 60.0)
    z[136:] = 60.0 - np.arange(n - 136) * 0.9
    z = np.maximum(z, 0.0)[:, None] * np.ones((1, 3))
    y0 = 4200.0
    r = radar(resolution_m=2.0, bandwidth_mhz=300.0)
    p = mapped(z, y0, height, cell, r)
    row = binned(p, r)[0, :, 1]
    top = 135
    y_top = y0 + top * cell
    expected = (math.sqrt(y_top**2 - 60.0 * (2 * height - 60.0)) - (y0 - 0.5)) / 2.0 + 400
    assert expected - 400 < (100 * cell) / 2.0 - 10
    flat = row[405:420].mean()
    bright = np.flatnonzero(row > 2.0 * flat)
    assert abs(bright[0] - expected) <= 2.0
    shadowless = p.power[0, :, 1] > 0
    assert row.sum() == pytest.approx(p.power[0, shadowless, 1].sum(), rel=1e-12)


def test_register_cells_points_to_the_pixel_that_holds_the_echo():
    # One lit cell on a hill: all its power must be where the registration says.
    rng = np.random.default_rng(1)
    z = np.cumsum(rng.normal(0, 0.4, (120, 60)), axis=0)
    cover = np.full(z.shape, 255, dtype=np.uint8)
    cover[61, 33] = 0
    s = scene(z, 5.0, cover)
    image = quiet(s, radar(resolution_m=10.0, bandwidth_mhz=100.0), precision="float64")
    total = image.mean_power[0]
    k = image.pixel_of_cell[61, 33]
    row, column = divmod(int(k), total.shape[1])
    assert (image.pixel_of_cell[cover == 255] == -1).all()
    np.testing.assert_allclose(total[row - 1 : row + 2, column].sum(), total.sum())
    assert total[row, column] >= 0.45 * total.sum()


@pytest.mark.parametrize("heading", [0.0, 90.0, 180.0, 270.0])
def test_the_radar_looks_to_the_right_of_its_heading(heading):
    z = np.zeros((40, 60))
    north, east = {0.0: (0, 1), 90.0: (-1, 0), 180.0: (0, -1), 270.0: (1, 0)}[heading]
    # A wall throws its shadow away from the radar: to the east (heading 0), south, west, north.
    z[18:22, 28:32] = 40.0
    image = quiet(scene(z, 5.0), radar(heading_deg=heading, resolution_m=10.0))
    rows, cols = np.nonzero(image.shadow)
    assert image.shadow.shape == z.shape
    away = (19.5 - rows.mean()) * north + (cols.mean() - 29.5) * east
    across = abs((cols.mean() - 29.5) * north) + abs((rows.mean() - 19.5) * east)
    assert away > 3.0
    assert across < 0.01
    up = np.rot90(image.mean_power, -image.quarter_turns, axes=(-2, -1))
    assert up.shape[1:] == (20, 30) or abs(up.shape[1] - 20) + abs(up.shape[2] - 30) < 12


def test_heading_equals_a_turned_scene():
    rng = np.random.default_rng(2)
    z = rng.normal(0, 1, (40, 60)).cumsum(axis=0).cumsum(axis=1) * 0.02
    cover = rng.integers(0, 3, z.shape)
    field = 3 * rng.integers(0, 50, z.shape) + cover
    table = Table((-8.0, -12.0, -16.0), 0.1)
    for heading, turns in ((0.0, -1), (180.0, 1), (270.0, 2)):
        here = quiet(scene(z, 5.0, cover, field), radar(heading_deg=heading), table)
        turned = quiet(
            scene(*(np.rot90(a, turns).copy() if i != 1 else a for i, a in enumerate((z, 5.0, cover, field)))),
            radar(heading_deg=90.0),
            table,
        )
        np.testing.assert_array_equal(here.intensity, turned.intensity)
        np.testing.assert_array_equal(np.rot90(here.pixel_of_cell, turns), turned.pixel_of_cell)


@pytest.mark.parametrize("heading", [0.0, 90.0, 180.0, 270.0])
def test_frames_are_row_major_copies(heading):
    s = scene(rough(40, 60, 0.2))
    before = s.elevation_m.copy()
    f = make_frame(s, radar(heading_deg=heading), "float32")
    for layer in (f.elevation_m, f.cover, f.field):
        assert layer.flags.c_contiguous
        assert layer.shape == f.elevation_m.shape
    assert len(f.source) == len(f.ground_range_m) >= f.n_rows
    np.testing.assert_array_equal(s.elevation_m, before)


def test_real_aperture_spreads_a_point_over_its_beam():
    cover = np.full((60, 200), 255, dtype=np.uint8)
    cover[30, 100] = 0
    r = radar(aperture="real", antenna_length_m=5.0, altitude_m=1000.0, resolution_m=25.0, bandwidth_mhz=50.0)
    wide = quiet(scene(np.zeros(cover.shape), 5.0, cover), r, precision="float64")
    row = int(np.argmax(wide.mean_power[0].sum(axis=1)))
    beam_m = wide.slant_range_m[row] * r.wavelength_m / 5.0
    assert 14.0 < beam_m < 25.0
    line = wide.mean_power[0, row]
    centre = 100.5 * 5.0
    lo, hi = centre - beam_m / 2, centre + beam_m / 2
    edges = np.arange(len(line) + 1) * 25.0
    share = np.clip(np.minimum(edges[1:], hi) - np.maximum(edges[:-1], lo), 0, None) / beam_m
    # The box is evaluated at cell centres: a cell of 5 m against a beam of some 16 m.
    np.testing.assert_allclose(line / line.sum(), share, atol=0.08)


def test_running_box_is_exact_over_a_wide_dynamic_range():
    rng = np.random.default_rng(6)
    sums = (10.0 ** rng.uniform(-6, 6, (1, 2, 500))).astype(np.float32)
    beam = np.array([7.0, 13.5])
    out = np.empty((1, 2, 500), dtype=np.float64)
    kernels.average_azimuth(sums, beam, 1.0, np.ones(2), out, np.empty(501), np.empty(500))
    line = sums[0, 0].astype(float)
    expected = np.convolve(line, np.ones(7) / 7, mode="same")[3:-3]
    np.testing.assert_allclose(out[0, 0, 3:-3], expected, rtol=1e-4)
    line = sums[0, 1].astype(float)
    taps = np.concatenate(([0.25], np.ones(13), [0.25])) / 13.5
    np.testing.assert_allclose(out[0, 1, 7:-7], np.convolve(line, taps, mode="valid"), rtol=1e-4)


def test_holes_in_the_elevation_neither_return_nor_spread():
    z = rough(80, 60, 0.3)
    holed = z.copy()
    holed[30:33, 20:25] = np.nan
    holed[50] = np.nan
    r = radar()
    whole, image = quiet(scene(z), r), quiet(scene(holed), r)
    assert np.isfinite(image.intensity).all()
    assert (image.intensity > 0).all()
    assert (image.pixel_of_cell[np.isnan(holed)] == -1).all()
    assert (image.pixel_of_cell[~np.isnan(holed)] >= 0).all()
    assert image.mean_power.sum() < whole.mean_power.sum()
    lost = 1.0 - image.mean_power.sum(dtype=float) / whole.mean_power.sum(dtype=float)
    assert lost == pytest.approx(np.isnan(holed).mean(), rel=0.3)


def test_gaps_take_the_nearest_height_of_their_row():
    z = np.array([[np.nan, 1.0, np.nan, np.nan, np.nan, 5.0], [np.nan] * 6, [2.0] * 6])
    fill_gaps(z)
    np.testing.assert_array_equal(z[0], [1.0, 1.0, 1.0, 1.0, 5.0, 5.0])
    np.testing.assert_array_equal(z[1], z[0])


def test_a_scene_without_heights_is_refused():
    with pytest.raises(SceneError):
        make_frame(scene(np.full((4, 4), np.nan)), radar(), "float32")


def test_flight_below_the_ground_is_refused():
    with pytest.raises(ConfigurationError, match="above the ground"):
        quiet(scene(np.full((40, 40), 7000.0)), radar())


def test_the_same_run_has_the_same_bits_and_another_run_has_others():
    s = scene(rough(80, 60, 0.3), cover=np.random.default_rng(0).integers(0, 3, (80, 60)))
    table = Table((-8.0, -12.0, -16.0), 0.1, field_sd_db=1.0, date_sd_db=0.5)
    r = radar(channels=("HH", "HV"))
    a, b, c = (simulate_radar(s, r, table, seed=5, run_id=k) for k in (7, 7, 8))
    np.testing.assert_array_equal(a.intensity, b.intensity)
    assert a.occasion.soil_moisture == b.occasion.soil_moisture != c.occasion.soil_moisture
    assert (a.intensity != c.intensity).mean() > 0.99
    assert not np.array_equal(a.mean_power, c.mean_power)


def test_occasions_that_share_a_geometry_score_as_each_alone():
    """Runs one after another share what lies in their pixels; another scene, mask or radar between makes it anew."""
    rng = np.random.default_rng(3)
    s = scene(rough(80, 60, 0.3), cover=rng.integers(0, 3, (80, 60)))
    masked = dataclasses.replace(s, scored=rng.random((80, 60)) < 0.5)
    table = Table((-8.0, -12.0, -16.0), 0.1, field_sd_db=1.0)
    fine, coarse = radar(), radar(resolution_m=13.0)

    def score(s, r, k):
        return percent_correct([simulate_radar(s, r, table, seed=5, run_id=k)], s, seed=5, run_id=k)

    cases = [(s, fine, 1), (s, fine, 2), (masked, fine, 2), (s, coarse, 2), (s, coarse, 3)]
    lasting = [score(*case) for case in cases]
    alone = []
    for case in cases:
        score(scene(rough(80, 60, 0.5), cover=np.indices((80, 60))[0] // 40), fine, 9)
        alone.append(score(*case))
    for one, other in zip(lasting, alone, strict=True):
        np.testing.assert_array_equal(one.confusion, other.confusion)
        assert (one.value, one.se, one.n_cells) == (other.value, other.se, other.n_cells)
    image = simulate_radar(s, fine, table, seed=5, run_id=2)
    assert percent_correct([image], masked, seed=5, run_id=2).value == lasting[2].value


def test_scores_do_not_depend_on_the_number_of_workers():
    serial = [small_score(k) for k in range(4)]
    assert dict(run_many(small_score, range(4), workers=2)) == dict(enumerate(serial))
    assert len(set(serial)) == 4
    assert all(40.0 < value < 100.0 for value in serial)


def test_single_precision_differs_from_double_by_rounding_only():
    rng = np.random.default_rng(8)
    z = rough(300, 200, 0.5)
    s = scene(z, cover=rng.integers(0, 3, z.shape))
    table = Table((-8.0, -12.0, -16.0), 0.15)
    single = quiet(s, radar(resolution_m=15.0), table)
    double = quiet(s, radar(resolution_m=15.0), table, precision="float64")
    assert single.intensity.dtype == np.float32
    assert double.intensity.dtype == np.float64
    error = np.abs(single.mean_power / double.mean_power - 1.0)
    assert np.median(error) <= 2e-6
    assert np.quantile(error, 0.99) <= 2e-5
    np.testing.assert_allclose(single.mean_power.sum(dtype=float), double.mean_power.sum(), rtol=1e-6)
    assert np.mean(single.pixel_of_cell != double.pixel_of_cell) < 1e-3


def test_noise_alone_fills_a_scene_that_returns_nothing():
    image = simulate_radar(scene(np.zeros((100, 100))), radar(resolution_m=5.0), Table((-300.0,)), seed=1, run_id=1)
    ratio = image.intensity[0] / image.noise_power_w[:, None]
    se = 1.0 / math.sqrt(ratio.size * image.looks.min())
    assert ratio.mean() == pytest.approx(1.0, abs=4 * se)
    np.testing.assert_allclose(image.noise_equivalent_sigma0 * image.calibration_w, image.noise_power_w, rtol=1e-12)


def test_rim_pixels_are_as_bright_as_the_inner_ones():
    # Raised ground is displaced towards the radar; mirrored ground fills what would be missing.
    z = np.full((100, 40), 30.0)
    z[::2] += 0.02
    z[50, 20] = -300.0
    image = quiet(scene(z, 5.0), radar(resolution_m=25.0, depression_angle_deg=60.0))
    apparent = np.delete(image.mean_power[0], slice(2, 7), axis=1) / image.calibration_w[:, None]
    assert np.abs(apparent / 0.1 - 1.0).max() < 0.02


def test_coarse_bandwidth_spreads_the_near_range():
    cover = np.full((400, 20), 255, dtype=np.uint8)
    cover[8] = 0
    r = radar(resolution_m=30.0, bandwidth_mhz=8.0, depression_angle_deg=50.0, altitude_m=1500.0)
    image = quiet(scene(np.zeros(cover.shape), 5.0, cover), r, precision="float64")
    width = r.ground_resolution_m(float(np.arctan2(image.ground_range_m[1], 1500.0))) / 30.0
    assert width > 1.05
    assert np.count_nonzero(image.mean_power[0, :, 0]) >= 3
    assert any("range response" in note for note in image.notes)
