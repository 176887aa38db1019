"""Scores of a radiometer's image: classification in kelvin, standard errors."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "physics"))

from prm_cases import Table, image, radiometer, scene
from shorthands import percent_correct
from test_cover_measures import IMAGE, KEY, SCENE

from seqrsm.score.cover import score_evidence
from seqrsm.score.evidence import Evidence, evidence_of
from seqrsm.score.pixels import finest, pixels_of, seen_pixels, tile_m
from seqrsm.score.utilities import Asked
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


def score_pixels(features, counts, tile, keys, covariates=0):
    return score_evidence(
        Evidence(features, counts, tile, keys, covariates, counts),
        "abcdef"[: counts.shape[1]],
        Asked("percent_correct"),
    )


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


@pytest.mark.parametrize(("cell_m", "side_m"), [(2.0, 160.0), (10.0, 250.0), (16.0, 250.0), (40.0, 600.0)])
def test_tiles_hold_whole_fields_and_many_of_them_lie_across_a_large_scene(cell_m, side_m):
    """Half the longer side of a tiny scene, 250 m, and an eighth of the shorter side from 2 km on."""
    assert tile_m(land(("class 0", "class 1"), cell_m=cell_m), radar=False) == pytest.approx(side_m)


def test_fields_of_a_small_scene_are_not_taught_where_they_are_tested():
    """Fields of 160 m and of one cover that go by two names: with tiles of 80 m its own parts told 67 %."""
    field = np.kron(np.arange(16).reshape(4, 4), np.ones((16, 16), dtype=int))
    one = scene(np.zeros(field.shape), 10.0, 0 * field, field, ("Wheat", "Corn"))
    scores, r = [], radiometer(**{**FINE, "channels": ("H", "V")})
    for run in range(12):
        names = np.random.default_rng(run).permutation(np.arange(16) % 2).astype(np.uint8)
        found = simulate_radiometer(one, r, Table((0.9,), field_sd=0.02), seed=3, run_id=run)
        scores.append(percent_correct([found], replace(one, cover=names[field]), by="field", seed=3, run_id=run).value)
    assert np.mean(scores) < 58.0


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


def test_coarse_beams_pay_for_mixed_ground_and_gaps_for_what_they_miss():
    s = land(("class 0", "class 1"))
    table = Table((0.5, 0.9))

    def score(**changes):
        found = image(s, radiometer(**{**FINE, **changes}), table)
        return percent_correct([found], s, seed=1, run_id=1).value

    assert score() > score(resolution_m=80.0) + 3.0
    assert score() > score(scan_period_s=4.0, integration_time_ms=4.0) + 10.0


def test_the_look_angle_is_no_evidence_but_is_accounted_for():
    # Emission falls with the angle by more than the classes differ.
    s = land(("class 0", "class 1"))
    steep = Table((lambda t: 0.9 - 1.5e-4 * t**2, lambda t: 0.85 - 1.5e-4 * t**2))
    found = image(s, radiometer(altitude_m=700.0, **FINE), steep)
    with_angle = percent_correct([found], s, seed=1, run_id=1).value
    rng = np.random.default_rng(0)
    n = 4000
    label = rng.integers(0, 2, n)
    angle = rng.uniform(0.0, 1.0, (n, 1))
    x = label + 20.0 * angle[:, 0] + rng.normal(0.0, 0.1, n)
    counts = np.stack([1 - label, label], axis=1)
    where = (counts, np.arange(n) // 50, rng.random(n // 50 + 1))
    blind = score_pixels(x[None], *where).value
    told = score_pixels(np.vstack([angle[:, 0], x]), *where, covariates=1).value
    assert with_angle > 85.0
    assert blind < 60.0
    assert told > 99.0
    # A covariate that gives the class away is not used as evidence of it.
    given_away = np.vstack([label + rng.normal(0.0, 0.3, n), rng.normal(size=n)])
    useless = score_pixels(given_away, *where, covariates=1).value
    assert useless < 60.0


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


def test_a_look_angle_that_tells_nothing_costs_little_however_far_it_reaches():
    """Ten fields a class: slopes of each class's own cost 5 points, but none where all angles lay within a degree."""
    rng, n_classes, n_fields, size = np.random.default_rng(1), 6, 60, 25
    field = np.repeat(np.arange(n_fields), size)
    label = field % n_classes
    lost = []
    for _ in range(100):
        x = 2.0 * label + rng.normal(0.0, 1.0, n_fields)[field] + rng.normal(0.0, 0.2, len(field))
        angle = rng.random(n_fields)[field] + rng.normal(0.0, 0.05, len(field))
        where = (np.eye(n_classes, dtype=int)[label], field, rng.permutation(n_fields) / n_fields)
        far, near = (score_pixels(np.vstack([k * angle, x]), *where, covariates=1).value for k in (1.0, 1e-4))
        assert near == pytest.approx(far, abs=1e-9)
        lost.append(score_pixels(x[None], *where).value - far)
    assert np.mean(lost) < 2.0


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
