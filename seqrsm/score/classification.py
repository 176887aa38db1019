"""Percent of ground classified correctly: the utility of an image for mapping cover.

Every scored cell of the data base counts, so an image whose pixels straddle field borders pays for them. Pixels are
trained on and tested in disjoint pieces of ground.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.errors import Problem, SceneError
from seqrsm.rng import generator
from seqrsm.score import kernels_classify

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
    _, counts, tile, keys = pixels_of_radar(image, scene, seed=seed, run_id=run_id, tile_m=tile_m)
    features = decibels(image.apparent_sigma0().reshape(len(image.intensity), -1), counts)
    return with_names(score_pixels(features, counts, tile, keys), scene.categories)


def pixels_of_radar(
    image: RadarImage, scene: Scene, *, seed: int, run_id: int, tile_m: float = TILE_M
) -> tuple[AnyArray, AnyArray, IntArray, FloatArray]:
    """Pixel of each cell, scored cells of each class in each pixel, and tiles with their keys; see `score_pixels`."""
    _, n_range, n_azimuth = image.intensity.shape
    pixel = image.pixel_of_cell
    counts = count_classes(pixel, scene, n_range * n_azimuth)
    ground = image.ground_range_m
    # Rows and columns of a strip are straight lines on the ground, so their places are not spread over the image.
    across, along = image.place_m(*np.indices((n_range, n_azimuth), sparse=True))
    if image.radar.scan == "slar":
        across = across - ground[0]
        extent = (float(ground[-1] - ground[0]), (n_azimuth - 0.5) * image.azimuth_spacing_m)
    else:
        reach = float(ground[-1])
        across, along, extent = across + reach, along + reach, (2.0 * reach, 2.0 * reach)
    return pixel, counts, *tiles(across, along, extent, tile_m, seed=seed, run_id=run_id)


def count_classes(pixel: AnyArray, scene: Scene, n_pixels: int) -> AnyArray:
    """Scored cells of each class in each pixel, int32 (n_pixels, n_classes).

    ``pixel``: of each cell of the scene, -1 for none.
    """
    # Made here and not in the kernel: numpy asks for large pages, which a large image fills far sooner.
    out = np.zeros((n_pixels, len(scene.categories)), dtype=np.int32)
    kernels_classify.add_cells(pixel, scene.cover, scene.scored, out)
    return out


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
    features: FloatArray, counts: AnyArray, tile: IntArray, keys: FloatArray, covariates: int = 0
) -> UtilityScore:
    """`percent_correct` on bare arrays: pixels with the cells of each class in them.

    Parameters
    ----------
    features : float64 array (d, n_pixels)
        What the Gaussian law of a class is about: decibels, brightness; finite where a pixel has cells.
    counts : int array (n_pixels, n_classes)
        Scored cells of each class; a pixel without any counts for nothing.
    tile : int64 array (n_pixels,)
        Tile of each pixel.
    keys : float64 array (n_tiles,)
        The half of the tiles with the smaller keys is one half, among those that hold scored cells.
    covariates : int
        So many of the last features are known for each pixel and no evidence of its class, such as the look angle: the
        law of each class is conditional on them, its mean a straight line in each.

    Returns
    -------
    UtilityScore
        Classes by number in `details`.

    Raises
    ------
    SceneError
        No pixel holds a scored cell.
    """
    cells = kernels_classify.cells_of_tiles(counts, tile, len(keys))
    seen = cells > 0
    n_tiles = int(seen.sum())
    if n_tiles == 0:
        raise SceneError(
            Problem("no scored cell lies in the image", "Give cells with a known category", field="scored")
        )
    half = np.zeros(len(keys), dtype=np.int64)
    half[seen] = halves(keys[seen])
    # With a single tile there is no other ground to learn from.
    laws, taught = _laws(features, counts, tile, half, covariates, alone=n_tiles == 1)
    correct, confusion = kernels_classify.name_classes(features, counts, tile, half, *laws)
    value, se = cluster_ratio(correct[seen], cells[seen], np.arange(n_tiles))
    total = confusion.sum(axis=1)
    details: dict[str, object] = {
        "not_predicted": tuple(int(k) for k in np.flatnonzero(~taught & (total > 0))),
        "per_class_percent": {k: 100.0 * float(confusion[k, k]) / float(n) for k, n in enumerate(total) if n},
    }
    return UtilityScore(100.0 * value, 100.0 * se, int(total.sum()), n_tiles, confusion, details)


def _laws(
    features: FloatArray, counts: AnyArray, tile: IntArray, half: IntArray, covariates: int, *, alone: bool
) -> tuple[tuple[FloatArray, FloatArray, FloatArray, FloatArray], AnyArray]:
    """The classes' laws by the half that they test, for `kernels_classify.name_classes`, and which are taught at all.

    ``alone``: a single tile teaches itself.
    """
    sums = kernels_classify.teach(features, counts, tile, half, TRAINING_PURITY)
    n_classes, d = sums.shape[2], len(features)
    row, column = np.tril_indices(d)
    centre, scale = np.zeros((2, n_classes, d)), np.zeros((2, n_classes, d, d))
    known_scale, constant = np.zeros((2, n_classes, covariates, covariates)), np.full((2, n_classes), -np.inf)
    for tested in (0, 1):
        taught_by = tested if alone else 1 - tested
        pure, mixed = sums[taught_by]
        few = _effective_pixels(*pure[:, :2].T) < ENOUGH_PIXELS
        total = pure + np.where(few[:, None], mixed, 0.0)
        cells, effective = total[:, 0], _effective_pixels(*total[:, :2].T)
        if not cells.any():
            continue
        moments = total[:, 2:] / np.where(cells > 0.0, cells, 1.0)[:, None]
        first, square = moments[:, :d], np.empty((n_classes, d, d))
        square[:, row, column] = square[:, column, row] = moments[:, d:]
        roots = _covariance_roots(cells, first, square, effective)
        centre[tested], scale[tested] = first, np.linalg.inv(roots)
        constant[tested] = -np.log(np.diagonal(roots, axis1=1, axis2=2)).sum(axis=1)
        if covariates:
            own = slice(d - covariates, None)
            roots = _covariance_roots(cells, first[:, own], square[:, own, own], effective)
            known_scale[tested] = np.linalg.inv(roots)
            constant[tested] += np.log(np.diagonal(roots, axis1=1, axis2=2)).sum(axis=1)
        constant[tested, cells == 0.0] = -np.inf
    return (centre, scale, known_scale, constant), np.isfinite(constant).any(axis=0)


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


def tiles(
    across_m: FloatArray, along_m: FloatArray, extent_m: tuple[float, float], tile_m: float, *, seed: int, run_id: int
) -> tuple[IntArray, FloatArray]:
    """Square tile of ground that each pixel belongs to, and the key by which the tiles are split into halves.

    Parameters
    ----------
    across_m, along_m : float64 arrays that broadcast to (rows, columns)
        Centres of the pixels [m].
    extent_m : tuple of float
        Largest value of either in the whole image [m].
    tile_m : float
        Side of a tile [m].
    seed, run_id : int

    Returns
    -------
    tile : int64 array (rows * columns,)
    keys : float64 array (n_tiles,)
    """
    wide, long = (max(math.floor(size / tile_m), 0) + 1 for size in extent_m)
    away = np.clip(np.floor(across_m / tile_m).astype(np.int64), 0, wide - 1)
    ahead = np.clip(np.floor(along_m / tile_m).astype(np.int64), 0, long - 1)
    return np.ravel(away * long + ahead), generator(seed, run_id, "training tiles").random(wide * long)


def halves(tile_keys: FloatArray) -> IntArray:
    """Half that each tile belongs to, 0 or 1: that with the smaller keys is half 1."""
    half = np.zeros(len(tile_keys), dtype=np.int64)
    half[np.argsort(tile_keys)[: len(tile_keys) // 2]] = 1
    return half


def _effective_pixels(total: FloatArray, squares: FloatArray) -> FloatArray:
    """Number of equally weighted pixels that carry as much, from the sums of the weights and of their squares."""
    return np.asarray(total**2 / np.where(squares > 0.0, squares, 1.0))


def decibels(power: FloatArray, counts: AnyArray) -> FloatArray:
    """Decibels of linear power (n_channels, n_pixels), in place; zeros, of a noiseless radar only, are the darkest.

    They take the least positive value of their channel among the pixels that hold cells: ``counts`` (n_pixels, n).
    """
    if not power.min(initial=1.0) > 0.0:
        floor = np.min(power, axis=1, keepdims=True, where=(power > 0.0) & counts.any(axis=1), initial=np.inf)
        np.maximum(power, np.where(np.isfinite(floor), floor, 1.0), out=power)
    np.log10(power, out=power)
    power *= 10.0
    return power


def _covariance_roots(total: FloatArray, mean: FloatArray, second: FloatArray, pixels: FloatArray) -> FloatArray:
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
