"""Scores of a radiometer's image: classification in kelvin, standard errors."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "physics"))

from prm_cases import Table, image, radiometer, scene
from shorthands import percent_correct
from test_cover_measures import IMAGE, KEY, SCENE

from seqrsm.score.evidence import evidence_of
from seqrsm.score.pixels import finest, pixels_of, seen_pixels, tile_m
from seqrsm.simulate.radiometer.prm import simulate_radiometer

PATCH = np.kron(np.random.default_rng(9).integers(0, 2, (12, 16)), np.ones((10, 10), dtype=int))
FIELD = np.kron(np.arange(12 * 16).reshape(12, 16), np.ones((10, 10), dtype=int))
FINE = {
    "resolution_m": 20.0,
    "scan_period_s": 0.3,
    "speed_m_s": 100.0,
    "integration_time_ms": 0.3,
    "bandwidth_mhz": 1e3,
}


def land(categories, cover=PATCH, cell_m=10.0):
    return scene(np.zeros(cover.shape), cell_m, cover, FIELD, categories)


def test_plain_ground_is_classified_and_alike_ground_is_not():
    s = land(("class 0", "class 1"))
    good = percent_correct([image(s, radiometer(**FINE), Table((0.5, 0.9)))], s, seed=1, run_id=1)
    assert good.value > 88.0
    # Emissivities alike: equal priors leave chance.
    noise = percent_correct([image(s, radiometer(**FINE), Table((0.7, 0.7)))], s, seed=1, run_id=1)
    assert noise.value == pytest.approx(50.0, abs=8.0)
    assert good.n_cells == PATCH.size
    assert good.confusion.sum() == PATCH.size
    assert set(good.details["per_class_percent"]) == {"class 0", "class 1"}


@pytest.mark.parametrize(
    ("cell_m", "side_m", "of_radar_m"),
    [(2.0, 160.0, 160.0), (10.0, 250.0, 250.0), (16.0, 250.0, 250.0), (40.0, 600.0, 250.0)],
)
def test_tiles_hold_whole_fields_and_many_of_them_lie_across_a_large_scene(cell_m, side_m, of_radar_m):
    """Half the longer side of a tiny scene, 250 m, and for radiometers an eighth of the shorter side from 2 km on."""
    ground = land(("class 0", "class 1"), cell_m=cell_m)
    assert [tile_m(ground, radar=radar) for radar in (False, True)] == pytest.approx([side_m, of_radar_m])


def test_tiles_are_squares_and_blind_footprints_hold_no_cells():
    s = land(("class 0", "class 1"))
    found = image(s, radiometer(**FINE), Table((0.5, 0.9)))
    pixels = pixels_of([found], s, seed=1, run_id=1)
    row, column = np.nonzero(pixels.pixel >= 0)
    tile = pixels.tile[pixels.pixel[row, column]]
    # All fields here are smaller than a tile, 250 m, and wholly in one: its cells lie no farther apart than both.
    for one in np.unique(tile):
        assert max(np.ptp(row[tile == one]), np.ptp(column[tile == one])) * 10.0 < 250.0 + 2 * 100.0
    assert len(np.unique(tile)) == 5 * 7
    blind = [0, 7]
    found.brightness_k.reshape(found.brightness_k.shape[0], -1)[:, blind] = math.nan
    wanted = np.where(np.isin(found.pixel_of_cell, blind), -1, found.pixel_of_cell)
    np.testing.assert_array_equal(seen_pixels(found), wanted)
    assert (wanted != found.pixel_of_cell).any()


def test_what_falls_with_the_look_angle_is_told_apart():
    """Emission falls with the angle by more than the classes differ."""
    s = land(("class 0", "class 1"))
    steep = Table((lambda t: 0.9 - 1.5e-4 * t**2, lambda t: 0.85 - 1.5e-4 * t**2))
    found = image(s, radiometer(altitude_m=700.0, **FINE), steep)
    assert percent_correct([found], s, seed=1, run_id=1).value > 85.0


@pytest.mark.parametrize("radar_first", [True, False])
def test_squares_of_look_angles_come_before_what_all_images_show(radar_first):
    """Of images in their order; a coarser image's values are means over the cells of each pixel."""
    seen = image(SCENE, radiometer(**{**FINE, "channels": ("H", "V")}), Table((0.5, 0.6, 0.7, 0.8)))
    images = (IMAGE, seen) if radar_first else (seen, IMAGE)
    found, base = evidence_of(images, SCENE, **KEY), images[0]
    assert (finest(images), found.covariates) == (base, 1)

    def met(image, layer):
        at, own = base.pixel_of_cell.ravel(), image.pixel_of_cell.ravel()
        known = (at >= 0) & (own >= 0)
        n = found.features.shape[1]
        with np.errstate(invalid="ignore"):
            return np.bincount(at[known], layer.ravel()[own[known]], n) / np.bincount(at[known], minlength=n)

    power = [10.0 * np.log10(met(IMAGE, layer)) for layer in IMAGE.apparent_sigma0().astype(np.float64)]
    angle = np.repeat(seen.scan.look_rad**2, seen.brightness_k.shape[2])
    kelvin = [met(seen, layer) for layer in seen.brightness_k]
    wanted = [met(seen, angle), *(power + kelvin if radar_first else kelvin + power)]
    held = found.counts.any(axis=1)
    for row, layer in zip(found.features, wanted, strict=True):
        own = held & np.isfinite(layer)
        assert np.count_nonzero(own) > 0.9 * np.count_nonzero(held)
        np.testing.assert_allclose(row[own], layer[own], rtol=1e-5)


def test_standard_error_covers_the_spread_over_scenes():
    # The se over tiles stands for another piece of ground: compare with the spread over drawn scenes.
    table = Table((0.78, 0.82), field_sd=0.03)
    values, errors = [], []
    for k in range(12):
        cover = np.kron(np.random.default_rng(k).integers(0, 2, (12, 16)), np.ones((10, 10), dtype=int))
        s = land(("class 0", "class 1"), cover)
        found = simulate_radiometer(s, radiometer(**FINE), table, seed=k, run_id=1)
        score = percent_correct([found], s, seed=k, run_id=1, tile_m=100.0)
        values.append(score.value)
        errors.append(score.se)
    ratio = float(np.std(values, ddof=1)) / math.sqrt(float(np.mean(np.square(errors))))
    assert 0.5 < ratio < 1.9
