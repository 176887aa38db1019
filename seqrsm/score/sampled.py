"""The utilities of `classification` and `retrieval` for a sample of an image's pixels (`seqrsm.simulate.sample`).

The same measure, taught and tested in the same halves of the ground; the pixels stand for those that were not looked
at, and each draw of fading or receiver noise for a part of a pixel.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.errors import Problem, SceneError
from seqrsm.score import kernels_classify
from seqrsm.score.classification import (
    ENOUGH_PIXELS,
    TILE_M,
    TRAINING_PURITY,
    UtilityScore,
    class_details,
    cluster_ratio,
    covariance_roots,
    decibels,
    effective_pixels,
    halves,
    systematic_se,
    tiles,
    with_names,
)
from seqrsm.score.kernels_classify import count_classes
from seqrsm.score.retrieval import polynomial_terms, retrieve, tile_side_m

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
    cells = kernels_classify.cells_of_pixels(counts, sample.values)
    used = np.flatnonzero(cells)
    if used.size == 0:
        text = "no scored cell lies in the pixels that were looked at"
        raise SceneError(Problem(text, 'Set [simulator] fidelity = "F4"', field="scored"))
    place = (sample.across_m[used], sample.along_m[used], sample.extent_m)
    tile, keys = tiles(*place, tile_m, seed=seed, run_id=run_id, sample=True)
    half = np.zeros(n_pixels, dtype=np.int64)
    half[used] = halves(keys)[tile]
    features = sample.values if linear else decibels(sample.values, (0, 2), used)
    known = np.empty((n_pixels, 0)) if sample.covariates is None else sample.covariates
    pixels = (features, known, counts, cells, half)
    laws, taught = _laws(pixels, pixels_each=1.0 / (sample.share * n_draws), alone=len(keys) == 1)
    correct, confusion = kernels_classify.name_classes(*pixels, *laws)
    size = n_draws * cells[used]
    value, se = cluster_ratio(correct[used], size, tile)
    spread = systematic_se(correct[used], size, _numbered(sample.column[used]))
    details = class_details(confusion, taught)
    details["sampling_se"] = 100.0 * math.sqrt(1.0 - sample.share) * spread
    score = UtilityScore(100.0 * value, 100.0 * se, int(cells.sum()), len(keys), confusion, details)
    return with_names(score, scene.categories)


def _numbered(code: IntArray) -> IntArray:
    """Place of each among the numbers >= 0 that occur, in their order: `numpy.unique` without a sort."""
    return np.asarray((np.cumsum(np.bincount(code) > 0) - 1)[code])


def _laws(
    pixels: tuple[FloatArray, FloatArray, AnyArray, FloatArray, IntArray], *, pixels_each: float, alone: bool
) -> tuple[tuple[FloatArray, FloatArray, FloatArray, FloatArray], AnyArray]:
    """The classes' laws by the half that they test, for `kernels_classify.name_classes`, and which are taught at all.

    ``pixels_each``: of the full image that each draw of a pixel stands for; ``alone``: a single tile teaches itself.
    """
    weight, mean, second = kernels_classify.teach(*pixels, TRAINING_PURITY)
    d, n_more, n_classes = mean.shape[3], pixels[1].shape[1], mean.shape[2]
    centre, scale = np.zeros((2, n_classes, d)), np.zeros((2, n_classes, d, d))
    known_scale, constant = np.zeros((2, n_classes, n_more, n_more)), np.full((2, n_classes), -np.inf)
    for tested in (0, 1):
        taught_by = tested if alone else 1 - tested
        few = pixels_each * effective_pixels(*weight[taught_by, 0].T) < ENOUGH_PIXELS
        total, first, square = (
            a[taught_by, 0] + np.where(few.reshape(-1, *[1] * (a.ndim - 3)), a[taught_by, 1], 0.0)
            for a in (weight, mean, second)
        )
        cells = total[:, 0]
        if not cells.any():
            continue
        safe = np.where(cells > 0.0, cells, 1.0)
        first, square, effective = (
            first / safe[:, None],
            square / safe[:, None, None],
            pixels_each * effective_pixels(*total.T),
        )
        roots = covariance_roots(cells, first, square, effective)
        centre[tested], scale[tested] = first, np.linalg.inv(roots)
        constant[tested] = -np.log(np.diagonal(roots, axis1=1, axis2=2)).sum(axis=1)
        if n_more:
            # A conditional Gaussian is the joint one over that of the covariates alone.
            own = slice(d - n_more, None)
            roots = covariance_roots(cells, first[:, own], square[:, own, own], effective)
            known_scale[tested] = np.linalg.inv(roots)
            constant[tested] += np.log(np.diagonal(roots, axis1=1, axis2=2)).sum(axis=1)
        constant[tested, cells == 0.0] = -np.inf
    return (centre, scale, known_scale, constant), np.isfinite(constant).any(axis=0)


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
    place = (sample.across_m[used], sample.along_m[used], sample.extent_m)
    tile, keys = tiles(*place, tile_side_m(scene), seed=seed, run_id=run_id, sample=True)
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
    spread = systematic_se(np.bincount(index, weights=square), cells, _numbered(sample.column[used]))
    details: dict[str, object] = {
        "quantity": "soil_moisture",
        "bias": float(error.mean()),
        "truth_sd": float(value.std()),
        "sampling_se": math.sqrt(1.0 - sample.share) * spread / (2.0 * rmse) if rmse > 0.0 else 0.0,
    }
    half = 2.0 * rmse if rmse > 0.0 else 1.0
    return UtilityScore(rmse, se / half, int(cells.sum()), len(keys), details=details)
