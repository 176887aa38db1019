"""Plan-position indicator: rings, rotation, power, shadow, targets, the way there and back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from psm_cases import Table, quiet, radar, scene
from shorthands import percent_correct

from seqrsm.errors import ConfigurationError
from seqrsm.scene.scene import NO_COVER
from seqrsm.score.pixels import pixels_of
from seqrsm.simulate.radar.frame import bilinear, polar_layers
from seqrsm.simulate.radar.psm import simulate_radar
from seqrsm.simulate.radar.result import rectangular, rectangular_pixels
from seqrsm.simulate.radar.targets import CulturalTarget


def ppi(**changes):
    given = {
        "scan": "ppi",
        "aperture": "real",
        "azimuth_beamwidth_deg": 3.0,
        "altitude_m": 800.0,
        "resolution_m": 15.0,
        "bandwidth_mhz": 50.0,
        "depression_angle_deg": 45.0,
        "fading": "none",
        "earth": "flat",
        "pulse_length_us": 0.5,
    }
    return radar(**{**given, **changes})


def flat(n=160, cell=10.0, **layers):
    return scene(np.zeros((n, n)), cell, **layers)


def test_flat_ground_is_as_bright_as_the_radar_equation_says_at_every_bearing():
    image = quiet(flat(), ppi(), precision="float64")
    # Nearer to nadir the pulse is wider than a pixel, and ground of other ranges and angles mixes in.
    inner = (image.ground_range_m < 760.0) & (image.ground_range_m > 200.0)
    theta = np.deg2rad(image.incidence_angle_deg)
    expected = 0.1 * image.radar.received_power_w(theta, image.slant_range_m, theta)
    ratio = image.mean_power[0][inner] / expected[inner, None]
    assert image.mean_power.shape[2] == 120
    assert np.abs(ratio - 1.0).max() < 5e-3
    assert np.ptp(ratio, axis=1).max() < 1e-10


def test_a_ring_of_bright_ground_is_a_row_of_the_image():
    n, cell = 200, 5.0
    i, j = np.mgrid[0:n, 0:n]
    distance = np.hypot(i - 0.5 * (n - 1), j - 0.5 * (n - 1)) * cell
    cover = ((distance > 300.0) & (distance < 330.0)).astype(int)
    image = quiet(flat(n, cell, cover=cover), ppi(resolution_m=10.0), Table((-30.0, 0.0)))
    apparent = image.apparent_sigma0()[0]
    rows = image.ground_range_m
    inside, outside = (
        (rows > 310.0) & (rows < 320.0),
        (rows > 100.0) & ((rows < 280.0) | (rows > 350.0)) & (rows < 450.0),
    )
    assert np.abs(apparent[inside] - 1.0).max() < 0.15
    assert apparent[outside].max() < 0.01
    # Nearest cells draw the ring ragged: its light varies round about, but its mean holds the area of the ring.
    weight = rows[:, None] * 10.0 / (30.0 * 315.0)
    total = (apparent * weight)[(rows > 280.0) & (rows < 350.0)].sum(axis=0).mean()
    assert total == pytest.approx(1.0, abs=0.03)


def test_turning_the_ground_turns_the_image():
    rng = np.random.default_rng(3)
    z = rng.normal(0, 0.4, (120, 120)).cumsum(axis=0).cumsum(axis=1) * 0.05
    cover = np.kron(rng.integers(0, 3, (12, 12)), np.ones((10, 10), dtype=int))
    table = Table((-8.0, -12.0, -16.0), 0.1)
    here = quiet(scene(z, 5.0, cover), ppi(), table, precision="float64").mean_power[0]
    s = scene(np.rot90(z, -1).copy(), 5.0, np.rot90(cover, -1))
    turned = quiet(s, ppi(), table, precision="float64").mean_power[0]
    expected = np.roll(here, here.shape[1] // 4, axis=1)
    # The nearest cell of a tie may be another one after the turn: a few pixels differ a little.
    error = np.abs(expected - turned) / turned.mean(axis=1, keepdims=True)
    assert np.quantile(error, 0.95) < 1e-9
    assert error.max() < 0.2


def test_power_is_that_of_the_ground():
    # Sum of pixels by area over the single-look cell: the echo of all ground, element by element.
    n, cell = 120, 5.0
    rng = np.random.default_rng(4)
    cover = np.kron(rng.integers(0, 2, (12, 12)), np.ones((10, 10), dtype=int))
    i, j = np.mgrid[0:n, 0:n]
    distance = np.hypot(i - 0.5 * (n - 1), j - 0.5 * (n - 1)) * cell
    r = ppi(near_incidence_deg=10.0, far_incidence_deg=18.0)
    image = quiet(flat(n, cell, cover=cover), r, Table((-8.0, -14.0)), precision="float64")
    theta = np.arctan2(distance, 800.0)
    swath = (np.rad2deg(theta) >= 10.0) & (np.rad2deg(theta) <= 18.0)
    sigma0 = 10.0 ** np.where(cover == 0, -0.8, -1.4)
    direct = r.radar_constant_w_m2() * (sigma0 * cell**2 / (distance**2 + 800.0**2) ** 2)[swath].sum()
    single = r.ground_resolution_m(np.deg2rad(image.incidence_angle_deg)) * image.slant_range_m * math.radians(3.0)
    pixel = image.ground_range_m * 15.0 * 2.0 * math.pi / image.mean_power.shape[2]
    inside = (image.ground_range_m > 800.0 * math.tan(math.radians(10.0))) & (
        image.ground_range_m < 800.0 * math.tan(math.radians(18.0))
    )
    got = (image.mean_power[0] * (pixel / single)[:, None])[inside].sum()
    assert got == pytest.approx(direct, rel=0.05)


def test_walls_throw_their_shadows_away_from_the_antenna():
    z = np.zeros((161, 161))
    for k, m in ((80, 120), (80, 40), (40, 80), (120, 80)):
        z[k - 2 : k + 3, m - 2 : m + 3] = 30.0
    image = quiet(scene(z, 5.0), ppi(altitude_m=300.0, pulse_length_us=0.1))
    rows, cols = np.nonzero(image.shadow)
    out = np.maximum(np.abs(rows - 80), np.abs(cols - 80))
    assert len(rows) > 40
    assert out.min() >= 38
    assert image.shadow[80, 124:127].all()
    assert image.shadow[34:37, 80].all()
    assert not image.shadow[80, 100:117].any()


def test_rows_of_slant_range_are_the_same_ground():
    s = flat(cover=np.kron(np.eye(4, dtype=int), np.ones((40, 40), dtype=int)))
    table = Table((-15.0, -5.0))
    images = [quiet(s, ppi(range_format=form), table) for form in ("ground", "slant")]
    for image in images:
        pixels = rectangular_pixels(image)
        shown = rectangular(image.apparent_sigma0(), pixels)[0]
        assert shown.shape == (107, 107)
        truth = np.repeat(np.repeat(np.kron(np.eye(4), np.ones((40, 40))), 2, axis=0), 2, axis=1)
        at = (np.arange(107) + 0.5) * 3.0
        bright = truth[np.ix_(at.astype(int), at.astype(int))] == 1
        far = np.hypot(*np.meshgrid(np.arange(107) - 53, np.arange(107) - 53)) > 25
        assert 10 * np.log10(shown[bright & far].mean() / shown[~bright & far].mean()) == pytest.approx(10.0, abs=1.5)
    assert images[1].range_spacing_m < images[0].range_spacing_m


def test_an_antenna_beside_the_scene_sees_a_sector():
    image = quiet(flat(), ppi(antenna_east_m=-1500.0, altitude_m=1500.0))
    seen = image.mean_power[0].sum(axis=0) > 0.0
    bearing = (np.arange(seen.size) + 0.5) * 360.0 / seen.size
    assert seen[(bearing > 60) & (bearing < 120)].all()
    assert not seen[(bearing > 230) & (bearing < 310)].any()


def test_a_target_stands_at_its_bearing_and_range():
    s = flat()
    for row, column in ((80, 130), (20, 79), (20, 80), (110, 50)):
        target = CulturalTarget(row, column, 60.0)
        image = quiet(s, ppi(), Table((-80.0,)), targets=[target])
        brightest = np.unravel_index(int(np.argmax(image.mean_power[0])), image.mean_power[0].shape)
        assert int(image.pixel_of_cell[row, column]) == brightest[0] * image.mean_power.shape[2] + brightest[1]
        # As strong as a point target's echo spread over the beam and the pixel, both a box of 3 degrees.
        r = image.radar
        distance2 = ((row - 79.5) ** 2 + (column - 79.5) ** 2) * 100.0 + 800.0**2
        theta = math.acos(800.0 / math.sqrt(distance2))
        single = r.ground_resolution_m(theta) * math.sqrt(distance2) * math.radians(3.0)
        pixel = 15.0 * 800.0 * math.tan(theta) * math.radians(3.0)
        total = image.mean_power[0].sum() * pixel / single
        assert total == pytest.approx(r.radar_constant_w_m2() * 1e6 / distance2**2, rel=0.05)


def test_a_specular_target_answers_only_towards_the_antenna():
    s = flat()
    # It stands in the east: the antenna lies to its west, 270 degrees from true north.
    towards = quiet(s, ppi(), Table((-80.0,)), targets=[CulturalTarget(80, 130, 60.0, directions_deg=(270.0,))])
    away = quiet(s, ppi(), Table((-80.0,)), targets=[CulturalTarget(80, 130, 60.0, directions_deg=(90.0,))])
    assert towards.mean_power.max() > 1e3 * away.mean_power.max()


def test_the_polar_grid_holds_the_heights_and_comes_back():
    i, j = np.mgrid[0:90, 0:70]
    z = 3.0 + 0.2 * i - 0.1 * j
    s = scene(z, 4.0, (i // 30))
    polar = polar_layers(s, 12.0, -8.0, math.radians(2.0), "float64")
    back = polar.elevation_m.ravel()[polar.cell_of_scene] + polar.mean_m
    # A plane is exact between cells; the nearest ring and column are up to half a cell off in range and in bearing.
    assert np.abs(back - s.elevation_m).max() < 0.5 * math.hypot(0.2, 0.1) * 1.5
    kinds = polar.cover.ravel()[polar.cell_of_scene]
    assert (kinds == s.cover).mean() > 0.97
    # Beyond north to either side the first and last bearings come again.
    wide, known = polar.wrapped, np.where(polar.cover == NO_COVER, np.nan, polar.elevation_m)
    np.testing.assert_allclose(known[:, :wide], known[:, -2 * wide : -wide], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(known[:, -wide:], known[:, wide : 2 * wide], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(bilinear(z, np.array([[1.25]]), np.array([[2.5]])), 3.0 + 0.25 - 0.25)


def test_an_antenna_beyond_all_measure_is_refused_before_memory_is():
    with pytest.raises(ConfigurationError, match="Move the antenna closer"):
        quiet(flat(), ppi(antenna_east_m=900_000.0, altitude_m=90_000.0))


def test_tiles_of_a_ring_shaped_image_are_squares_of_250_m():
    s = flat()
    image = quiet(s, ppi())
    pixels = pixels_of([image], s, seed=1, run_id=1)
    row, column = np.nonzero(pixels.pixel >= 0)
    tile = pixels.tile[pixels.pixel[row, column]]
    longest = 15.0 + float(image.ground_range_m[-1]) * math.radians(3.0)  # of a pixel, whose centre tells its tile
    for one in np.unique(tile):
        assert max(np.ptp(row[tile == one]), np.ptp(column[tile == one])) * 10.0 < 250.0 + longest
    assert 1600**2 / 250**2 < len(np.unique(tile)) <= 64


def test_classes_are_told_apart_in_polar_pixels():
    rng = np.random.default_rng(1)
    cover = np.kron(rng.integers(0, 2, (8, 8)), np.ones((20, 20), dtype=int))
    s = flat(cover=cover)
    image = simulate_radar(s, ppi(fading="gamma"), Table((-5.0, -25.0)), seed=1, run_id=1)
    score = percent_correct([image], s, seed=1, run_id=1, tile_m=200.0)
    assert 85.0 < score.value <= 100.0


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"aperture": "synthetic"}, "aperture"),
        ({"pixel_m": 5.0}, "pixel_m"),
        ({"scan": "slar", "antenna_east_m": 10.0}, "antenna_east_m"),
        ({"scan": "spiral"}, "scan"),
        ({"looks": 9.0}, "looks"),
    ],
)
def test_contradictions_are_refused(changes, field):
    with pytest.raises(ConfigurationError) as caught:
        ppi(**changes)
    assert field in {problem.field for problem in caught.value.problems}
