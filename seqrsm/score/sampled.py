"""The utilities of `classification` and `retrieval` for a sample of an image's pixels (`seqrsm.simulate.sample`).

The same measure, taught and tested in the same halves of the ground; the pixels stand for those that were not looked
at, and each draw of fading or receiver noise for a part of a pixel.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seqrsm.errors import Problem, SceneError
from seqrsm.score.classification import (
    TILE_M,
    UtilityScore,
    cluster_ratio,
    score_pixels,
    systematic_se,
    tiles,
    with_names,
)
from seqrsm.score.retrieval import polynomial_terms, retrieve, tile_side_m
from seqrsm.simulate.kernels import count_classes

if TYPE_CHECKING:
    from seqrsm.scene.scene import Scene
    from seqrsm.simulate.sample import Sample


def percent_correct_radar(sample: Sample, scene: Scene, *, seed: int, run_id: int) -> UtilityScore:
    """`seqrsm.score.classification.percent_correct` of a sample of a radar's image."""
    return _percent_correct(sample, scene, TILE_M, linear=False, seed=seed, run_id=run_id)


def percent_correct_radiometer(sample: Sample, scene: Scene, *, seed: int, run_id: int) -> UtilityScore:
    """`seqrsm.score.retrieval.percent_correct_radiometer` of a sample of a radiometer's image."""
    return _percent_correct(sample, scene, tile_side_m(scene), linear=True, seed=seed, run_id=run_id)


def _percent_correct(
    sample: Sample, scene: Scene, tile_m: float, *, linear: bool, seed: int, run_id: int
) -> UtilityScore:
    n_draws, _, n_pixels = sample.values.shape
    counts = count_classes(sample.pixel_of_cell, sample.cover, sample.scored, n_pixels, len(scene.categories))
    used = np.flatnonzero(counts.any(axis=1) & np.isfinite(sample.values[0]).all(axis=0))
    if used.size == 0:
        text = "no scored cell lies in the pixels that were looked at"
        raise SceneError(Problem(text, 'Set [simulator] fidelity = "F4"', field="scored"))
    across, along = sample.across_m[used], sample.along_m[used]
    tile, keys = tiles(across, along, sample.extent_m, tile_m, seed=seed, run_id=run_id)
    values = sample.values[:, :, used].transpose(0, 2, 1).reshape(n_draws * used.size, -1)
    group = np.unique(sample.column[used], return_inverse=True)[1].ravel()
    score = score_pixels(
        values,
        np.tile(sample.looks[used], n_draws),
        np.tile(counts[used], (n_draws, 1)),
        np.tile(tile, n_draws),
        seed=seed,
        run_id=run_id,
        scale="linear" if linear else "decibel",
        covariates=None if sample.covariates is None else np.tile(sample.covariates[used], (n_draws, 1)),
        tile_keys=keys,
        pixels_each=1.0 / (sample.share * n_draws),
        group=np.tile(group, n_draws),
    )
    spread = score.details["sampling_se"]
    assert isinstance(spread, float)
    finite = math.sqrt(1.0 - sample.share)
    score = replace(score, details={**score.details, "sampling_se": finite * spread}, n_cells=int(counts[used].sum()))
    return with_names(score, scene.categories)


def soil_moisture_error(sample: Sample, scene: Scene, *, seed: int, run_id: int) -> UtilityScore:
    """`seqrsm.score.retrieval.soil_moisture_error` of a sample of a radiometer's image."""
    n_draws, n_channels, _ = sample.values.shape
    seen = np.append(np.isfinite(sample.values[0]).all(axis=0), False)
    known = sample.scored & (sample.cover < len(scene.categories)) & seen[sample.pixel_of_cell]
    moist = np.zeros(0, dtype=bool) if sample.moist is None else sample.moist
    asked = known & np.append(moist, False)[np.where(known, sample.cover.astype(np.int64), -1)]
    if not asked.any():
        text = "no scored cell tells of soil_moisture"
        raise SceneError(Problem(text, "Choose another utility", field="utility"))
    value = 100.0 * sample.occasion.field_moisture[sample.field[asked]]
    used, index = np.unique(sample.pixel_of_cell[asked], return_inverse=True)
    cells = np.bincount(index).astype(np.float64)
    mean = np.bincount(index, weights=value) / cells
    across, along = sample.across_m[used], sample.along_m[used]
    tile, keys = tiles(across, along, sample.extent_m, tile_side_m(scene), seed=seed, run_id=run_id)
    assert sample.covariates is not None
    angle = np.tile(sample.covariates[used, 0], n_draws)
    brightness = sample.values[:, :, used].transpose(0, 2, 1).reshape(n_draws * used.size, n_channels)
    targets, weights, where = np.tile(mean, n_draws), np.tile(cells, n_draws), np.tile(tile, n_draws)
    found = retrieve(brightness, angle, targets, weights, where, keys).reshape(n_draws, used.size)
    error = np.clip(found, mean.min(), mean.max())[:, index] - value
    # Few footprints teach the polynomial worse than all would, by 1 + 2 q / n: no property of the sensor.
    taught = 2.0 * polynomial_terms(n_channels) / used.size
    square = np.square(error).mean(axis=0) * (1.0 + taught * sample.share) / (1.0 + taught)
    share, se = cluster_ratio(square, np.ones(square.size), tile[index])
    rmse = math.sqrt(share)
    column = np.unique(sample.column[used], return_inverse=True)[1].ravel()
    spread = systematic_se(np.bincount(index, weights=square), cells, column)
    details: dict[str, object] = {
        "quantity": "soil_moisture",
        "bias": float(error.mean()),
        "truth_sd": float(value.std()),
        "sampling_se": math.sqrt(1.0 - sample.share) * spread / (2.0 * rmse) if rmse > 0.0 else 0.0,
    }
    half = 2.0 * rmse if rmse > 0.0 else 1.0
    return UtilityScore(rmse, se / half, int(cells.sum()), len(keys), np.zeros((0, 0), dtype=np.int64), details)
