"""Percent of ground classified correctly: the utility of an image for mapping cover.

Every scored cell of the data base counts, so an image whose pixels straddle field borders pays for them. Pixels are
trained on and tested in disjoint pieces of ground.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.errors import Problem, SceneError
from seqrsm.rng import generator
from seqrsm.score.kernels_classify import count_classes

if TYPE_CHECKING:
    from seqrsm.scene.scene import Scene
    from seqrsm.simulate.radar.result import RadarImage

TILE_M = 250.0
"""Side of a tile [m]: about the size of a farm's block of fields."""

TRAINING_PURITY = 0.8
"""Least share of one class in a pixel that trains it: training fields are chosen inside fields, not across borders."""

ENOUGH_PIXELS = 10.0
"""A class with fewer pure pixels than this is taught by all pixels that hold it."""


@dataclass(frozen=True, slots=True, eq=False)
class UtilityScore:
    """One value of a utility measure.

    Attributes
    ----------
    value : float
        In the unit of the utility, such as percent of scored cells classified correctly.
    se : float
        Standard error of `value` over pieces of ground within this run, the same unit; nan with fewer than two tiles, 0
        where the measure tells none. The spread between runs is larger: it also holds the occasion.
    n_cells : int
        Scored cells.
    n_clusters : int
        Tiles with scored cells.
    confusion : int64 array (n_classes, n_classes)
        Cells of class (row) that were given class (column); empty where the measure names no classes.
    details : dict
        What else is known, by name. Of a classification ``not_predicted``: classes that no training half could teach;
        ``per_class_percent``: share correct by class.
    """

    value: float
    se: float = 0.0
    n_cells: int = 0
    n_clusters: int = 0
    confusion: IntArray = field(default_factory=lambda: np.zeros((0, 0), dtype=np.int64))
    details: dict[str, object] = field(default_factory=dict)


def percent_correct(
    image: RadarImage,
    scene: Scene,
    *,
    seed: int,
    run_id: int,
    tile_m: float = TILE_M,
) -> UtilityScore:
    """Percent of scored cells that a maximum likelihood classifier names rightly.

    The classifier sees decibels of the calibrated image (range dependence of flat ground removed, noise left in) in all
    channels together. Tiles of ground are split at random into two halves; each half is classified by what the other
    taught, so all ground is tested once. A class is taught by the pixels that it fills to `TRAINING_PURITY`, or where
    they are fewer than ten by all pixels that hold it; a pixel's weight is its cells. A class absent from the teaching
    half cannot be named in the other. Neighbouring tiles may share a field, so fields never seen would score lower.

    Priors are equal: a classifier with the area's priors can score well by naming the commonest class
    everywhere, which tells little about the sensor.

    Parameters
    ----------
    image : RadarImage
    scene : Scene
        The scene the image was made of.
    seed, run_id : int
        Key of the split into halves: the sample of training fields is part of the run's randomness.
    tile_m : float
        Side of a tile [m], > 0. A pixel belongs to the tile of its centre.

    Returns
    -------
    UtilityScore

    Raises
    ------
    SceneError
        No scored cell lies in the image.
    """
    n_classes = len(scene.categories)
    _, n_range, n_azimuth = image.intensity.shape
    counts = count_classes(image.pixel_of_cell, scene.cover, scene.scored, n_range * n_azimuth, n_classes)
    used = np.flatnonzero(counts.any(axis=1))
    if used.size == 0:
        raise SceneError(
            Problem("no scored cell lies in the image", "Give cells with a known category", field="scored")
        )
    if used.size < len(counts):
        counts = counts[used]
    row, column = np.divmod(used, n_azimuth)
    across, along = image.place_m(row, column)
    ground = image.ground_range_m
    if image.radar.scan == "slar":
        across, extent = (
            across - ground[0],
            (float(ground[-1] - ground[0]), (n_azimuth - 0.5) * image.azimuth_spacing_m),
        )
    else:
        reach = float(ground[-1])
        across, along, extent = across + reach, along + reach, (2.0 * reach, 2.0 * reach)
    tile, keys = tiles(across, along, extent, tile_m, seed=seed, run_id=run_id)
    power = image.apparent_sigma0().reshape(len(image.intensity), -1)[:, used].T.astype(np.float64)
    return with_names(score_pixels(power, counts, tile, seed=seed, run_id=run_id, tile_keys=keys), scene.categories)


def with_names(score: UtilityScore, categories: Sequence[str]) -> UtilityScore:
    """The score with classes by name in its details, where `score_pixels` has numbers."""
    missing, shares = score.details["not_predicted"], score.details["per_class_percent"]
    assert isinstance(missing, tuple)
    assert isinstance(shares, dict)
    named = {
        "not_predicted": tuple(categories[k] for k in missing),
        "per_class_percent": {categories[k]: value for k, value in shares.items()},
    }
    return replace(score, details={**score.details, **named})


def score_pixels(
    power: FloatArray,
    counts: AnyArray,
    tile: IntArray,
    *,
    seed: int,
    run_id: int,
    scale: Literal["decibel", "linear"] = "decibel",
    covariates: FloatArray | None = None,
    tile_keys: FloatArray | None = None,
) -> UtilityScore:
    """`percent_correct` on bare arrays: pixels with the cells of each class in them.

    Parameters
    ----------
    power : float64 array (n_pixels, n_channels)
        Linear power, >= 0.
    counts : int array (n_pixels, n_classes)
        Scored cells of each class.
    tile : int64 array (n_pixels,)
        Tile number, 0 .. n_tiles - 1 without gaps.
    seed, run_id
        As in `percent_correct`.
    scale : {"decibel", "linear"}
        What the Gaussian law sees of `power`: its decibels, or the numbers as they are (brightness in kelvin).
    covariates : float64 array (n_pixels, n_covariates), optional
        Known for each pixel and no evidence of its class, such as the look angle: the Gaussian law of each class is
        conditional on them, its mean a straight line in each.
    tile_keys : float64 array (n_tiles,), optional
        The half of the tiles with the smaller keys is one half; drawn if not given.

    Returns
    -------
    UtilityScore
        Classes by number in `details`.
    """
    n_classes = counts.shape[1]
    n_tiles = int(tile.max()) + 1
    if tile_keys is None:
        order = generator(seed, run_id, "training tiles").permutation(n_tiles)
        tile_keys = np.argsort(order).astype(np.float64)
    half = halves(tile_keys)[tile]
    named = np.zeros(len(tile), dtype=np.int64)
    taught = np.zeros(n_classes, dtype=bool)
    features = power if scale == "linear" else decibels(power)
    # A conditional Gaussian is the joint one over that of the covariates alone.
    joint = features if covariates is None else np.column_stack([features, covariates])
    for tested in (0, 1):
        test = half == tested
        # With a single tile there is no other ground to learn from.
        train = test if n_tiles == 1 else ~test
        if not test.any():
            continue
        weights = _training_weights(counts[train], TRAINING_PURITY)
        known = weights.any(axis=0)
        taught |= known
        log_likelihood = _gaussian_log_likelihood(joint[train], weights, joint[test])
        if covariates is not None:
            log_likelihood -= _gaussian_log_likelihood(covariates[train], weights, covariates[test])
        log_likelihood[:, ~known] = -np.inf
        named[test] = np.argmax(log_likelihood, axis=1)
        del weights, log_likelihood  # of a large image they fill as much memory as all the rest
    correct = counts[np.arange(len(tile)), named]
    value, se = cluster_ratio(correct, counts.sum(axis=1), tile)
    confusion = np.zeros((n_classes, n_classes), dtype=np.int64)
    for k in range(n_classes):
        confusion[:, k] = counts[named == k].sum(axis=0)
    details = class_details(confusion, taught)
    return UtilityScore(100.0 * value, 100.0 * se, int(confusion.sum()), n_tiles, confusion, details)


def class_details(confusion: IntArray, taught: AnyArray) -> dict[str, object]:
    """Share correct by class, and the classes that nothing taught, by number."""
    total = confusion.sum(axis=1)
    return {
        "not_predicted": tuple(int(k) for k in np.flatnonzero(~taught & (total > 0))),
        "per_class_percent": {k: 100.0 * float(confusion[k, k]) / float(n) for k, n in enumerate(total) if n},
    }


def cluster_ratio(correct: AnyArray, cells: AnyArray, cluster: IntArray) -> tuple[float, float]:
    """Share of correct cells and its standard error over clusters.

    Ratio estimator of cluster sampling: Cochran (1977), Sampling Techniques, 3rd ed., eq. (6.13) without finite
    population correction. Cells of one cluster err together, so a binomial error over cells would be far too small.

    Parameters
    ----------
    correct, cells : int array (n,)
        Correct and all cells of each unit.
    cluster : int64 array (n,)
        Cluster of each unit, numbered without gaps.

    Returns
    -------
    tuple of float
        Share in [0, 1]; standard error, nan with fewer than two clusters.
    """
    right = np.bincount(cluster, weights=correct)
    size = np.bincount(cluster, weights=cells)
    n = len(size)
    share = float(right.sum() / size.sum())
    if n < 2:
        return share, math.nan
    residual = right - share * size
    return share, math.sqrt(n / (n - 1.0) * float(residual @ residual)) / float(size.sum())


def systematic_se(correct: AnyArray, cells: AnyArray, group: IntArray) -> float:
    """Standard error of the share of correct cells in a systematic sample of groups, such as every tenth column.

    Successive differences of the groups' residuals, eq. (8.3) of Wolter (2007), Introduction to Variance Estimation,
    2nd ed.; without finite population correction; nan with fewer than two groups.
    """
    right, size = np.bincount(group, weights=correct), np.bincount(group, weights=cells)
    n = len(size)
    if n < 2:
        return math.nan
    residual = right - float(right.sum() / size.sum()) * size
    return math.sqrt(n / (2.0 * (n - 1.0)) * float(np.square(np.diff(residual)).sum())) / float(size.sum())


def tiles(
    across_m: FloatArray,
    along_m: FloatArray,
    extent_m: tuple[float, float],
    tile_m: float,
    *,
    seed: int,
    run_id: int,
    sample: bool = False,
) -> tuple[IntArray, FloatArray]:
    """Square tile of ground that each pixel belongs to, and the key by which the tiles are split into halves.

    The keys are those of all tiles of the image, whichever are asked for: a part of an image is split as the whole. For
    that the narrow tiles at the far edges count, too, which a sample may pass over: without them the middle key is
    another, and tiles change sides.

    Parameters
    ----------
    across_m, along_m : float64 array (n_pixels,)
        Centre of each pixel [m].
    extent_m : tuple of float
        Largest value of either in the whole image [m].
    tile_m : float
        Side of a tile [m].
    seed, run_id : int
    sample : bool
        The pixels are some in equal steps of all that the tiles hold.

    Returns
    -------
    tile : int64 array (n_pixels,)
        Numbered without gaps, but for tiles that a sample passes over.
    keys : float64 array (n_tiles,)
    """
    wide, long = (max(math.floor(size / tile_m), 0) + 1 for size in extent_m)
    away = np.clip(np.floor(across_m / tile_m).astype(np.int64), 0, wide - 1)
    ahead = np.clip(np.floor(along_m / tile_m).astype(np.int64), 0, long - 1)
    code = away * long + ahead
    seen = np.bincount(code, minlength=wide * long).reshape(wide, long) > 0
    for lines in (seen, seen.T) if sample else ():
        # Where there are five lines, both halves keep tiles with pixels.
        if len(lines) >= 5 and not lines[-1].any():
            lines[-1] = lines[-2]
    keys = generator(seed, run_id, "training tiles").random(wide * long)
    return (np.cumsum(seen) - 1)[code], keys[seen.ravel()]


def halves(tile_keys: FloatArray) -> IntArray:
    """Half that each tile belongs to, 0 or 1: that with the smaller keys is half 1."""
    half = np.zeros(len(tile_keys), dtype=np.int64)
    half[np.argsort(tile_keys)[: len(tile_keys) // 2]] = 1
    return half


def _training_weights(counts: AnyArray, purity: float) -> FloatArray:
    """Cells with which each pixel teaches each class (n_pixels, n_classes)."""
    cells = counts.astype(np.float64)
    pure = np.where(cells >= purity * cells.sum(axis=1, keepdims=True), cells, 0.0)
    few = _effective_pixels(pure) < ENOUGH_PIXELS
    pure[:, few] = cells[:, few]
    return pure


def _effective_pixels(weights: FloatArray) -> FloatArray:
    """`effective_pixels` of weights (n_pixels, n_classes)."""
    return effective_pixels(weights.sum(axis=0), (weights**2).sum(axis=0))


def effective_pixels(total: FloatArray, squares: FloatArray) -> FloatArray:
    """Number of equally weighted pixels that carry as much, from the sums of the weights and of their squares."""
    return np.asarray(total**2 / np.where(squares > 0.0, squares, 1.0))


def decibels(power: FloatArray, axis: int | tuple[int, ...] = 0, pixels: IntArray | None = None) -> FloatArray:
    """Decibels; exact zeros, which only a noiseless radar has, take the least positive value of their channel.

    ``axis``: all axes but the channels'; ``pixels``: along the last axis, those among which that value is looked for.
    """
    if power.min() > 0.0:
        return np.asarray(10.0 * np.log10(power))
    seen = power if pixels is None else power[..., pixels]
    floor = np.where(seen > 0.0, seen, np.inf).min(axis=axis, keepdims=True)
    return np.asarray(10.0 * np.log10(np.maximum(power, np.where(np.isfinite(floor), floor, 1.0))))


def _gaussian_log_likelihood(train: FloatArray, weights: FloatArray, test: FloatArray) -> FloatArray:
    """Log likelihood (n_test, n_classes) under each class's Gaussian, its moments weighted by cells."""
    n_classes = weights.shape[1]
    total = weights.sum(axis=0)
    safe = np.where(total > 0.0, total, 1.0)
    mean = (weights.T @ train) / safe[:, None]
    second = np.einsum("nk,ni,nj->kij", weights, train, train, optimize=True) / safe[:, None, None]
    roots = covariance_roots(total, mean, second, _effective_pixels(weights))
    out = np.empty((len(test), n_classes))
    for k in range(n_classes):
        scaled = np.linalg.solve(roots[k], (test - mean[k]).T)
        out[:, k] = -0.5 * np.einsum("in,in->n", scaled, scaled) - np.log(np.diag(roots[k])).sum()
    return out


def covariance_roots(total: FloatArray, mean: FloatArray, second: FloatArray, pixels: FloatArray) -> FloatArray:
    """Cholesky roots (n_classes, d, d) of the covariances of classes.

    A covariance from few pixels is drawn towards the pooled one, as if the pooled one rested on 2 (d + 1) pixels, d
    being the number of features.

    Parameters
    ----------
    total : float64 array (n_classes,)
        Weight of each class, not all 0.
    mean, second : float64 arrays (n_classes, d), (n_classes, d, d)
        First and second moments about 0.
    pixels : float64 array (n_classes,)
        That each rests on.
    """
    d = mean.shape[1]
    covariance = second - mean[:, :, None] * mean[:, None, :]
    pooled = np.tensordot(total, covariance, axes=1) / total.sum() + 1e-6 * np.eye(d)
    prior_pixels = 2.0 * (d + 1)
    roots = np.empty_like(covariance)
    for k in range(len(total)):
        own = (pixels[k] * covariance[k] + prior_pixels * pooled) / (pixels[k] + prior_pixels)
        roots[k] = np.linalg.cholesky(own)
    return roots
