"""A Gaussian maximum likelihood classifier, taught and tested on disjoint pieces of ground, and what a score is."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.errors import SceneError
from seqrsm.score import kernels_classify
from seqrsm.score.evidence import Evidence, holds_cells

TRAINING_PURITY = 0.8
"""Least share of one class in a pixel that trains it: training fields are chosen inside fields, not across borders."""

ENOUGH_PIXELS = 10.0
"""A class with fewer pure pixels than this is taught by all pixels that hold it."""

TRUSTS: Final = (1.0, 2.0, 4.0, 8.0, 1e4)
"""Powers of what a label says that are weighed, from as much as a map's table tells to more than any image does."""

ENDS: Final = ("guess", "perfect")
"""What is kept with a score under these names: see `UtilityScore`."""


@dataclass(frozen=True, slots=True, eq=False)
class UtilityScore:
    """One value of a utility measure."""

    value: float
    """In the unit of the utility, such as percent of scored cells classified correctly."""
    se: float = 0.0
    """Standard error of `value` over pieces of ground within this run, the same unit; nan with fewer than two tiles, 0
    where the measure tells none. The spread between runs is larger: it also holds the occasion."""
    guess: float = math.nan
    perfect: float = math.nan
    """What a guess that looks at nothing would score, and perfect data, on the same ground; nan where not known."""
    n_cells: int = 0
    """Scored cells."""
    n_clusters: int = 0
    """Tiles with scored cells."""
    confusion: AnyArray = field(default_factory=lambda: np.zeros((0, 0), dtype=np.int64))
    """(n_classes, n_classes): cells of class (row) that were given class (column), on average where names are drawn by
    lot; empty where the measure names no classes."""
    details: dict[str, object] = field(default_factory=dict)
    """What else is known, by name. Of a classification ``per_class_percent``: share correct by class."""


@dataclass(frozen=True, slots=True, eq=False)
class Taught:
    """What the halves of the tiles teach."""

    seen: AnyArray
    """(n_tiles,): tiles that hold scored cells."""
    half: IntArray
    """(n_tiles,)."""
    laws: tuple[FloatArray, FloatArray, FloatArray]
    """Centres, scales and constants of the classes' laws, by the half that they test."""
    trust: tuple[float, float] = (1.0, 1.0)
    """Power of what a label of a map that is there already says, by the half that it tests."""


def taught(evidence: Evidence) -> Taught:
    """The laws by which each half of the tiles is named, as the other half teaches them.

    Tiles are split at random into two halves; each half is classified by what the other taught, so all ground is tested
    once. The law of a class is Gaussian; its mean goes with covariates by a straight line, of one slope for all
    classes: slopes of their own, told by a few fields each, cost more than they gain. A class is taught by
    the units that it fills to `TRAINING_PURITY`, or where they are fewer than ten by all units that hold it. A class
    absent from the teaching half cannot be named in the other. Priors are equal: a classifier with the area's priors
    can score well by naming the commonest class everywhere, which tells little about the sensor. The evidence is finite
    where a unit has scored cells.

    Raises
    ------
    SceneError
        No unit holds a scored cell.
    """
    seen, half = _halves_of(evidence)
    features, c = evidence.features, evidence.covariates
    n_classes, d = evidence.teaching.shape[1], len(features)
    sums = np.zeros((2, 2, n_classes, 2 + d + d * (d + 1) // 2))
    kernels_classify.teach(features, evidence.teaching, evidence.tile, half, TRAINING_PURITY, sums, np.empty(d))
    row, column = np.tril_indices(d)
    centre, scale = np.zeros((2, n_classes, d)), np.zeros((2, n_classes, d, d))
    constant = np.full((2, n_classes), -np.inf)
    for tested in (0, 1):
        # With a single tile there is no other ground to learn from.
        pure, mixed = sums[tested if int(seen.sum()) == 1 else 1 - tested]
        few = _effective_pixels(*pure[:, :2].T) < ENOUGH_PIXELS
        total = pure + np.where(few[:, None], mixed, 0.0)
        cells, effective = total[:, 0], _effective_pixels(*total[:, :2].T)
        if not cells.any():
            continue
        moments = total[:, 2:] / np.where(cells > 0.0, cells, 1.0)[:, None]
        first, square = moments[:, :d], np.empty((n_classes, d, d))
        square[:, row, column] = square[:, column, row] = moments[:, d:]
        covariance = square - first[:, :, None] * first[:, None, :]
        within = np.tensordot(cells, covariance, axes=1) / cells.sum()
        slopes = within[c:, :c] @ np.linalg.pinv(within[:c, :c], rcond=1e-9, hermitian=True)
        turn = np.hstack([-slopes, np.eye(d - c)])
        roots = _covariance_roots(turn @ covariance @ turn.T, turn @ within @ turn.T, effective)
        centre[tested], scale[tested, :, c:] = first, np.linalg.inv(roots) @ turn
        constant[tested] = -np.log(np.diagonal(roots, axis1=1, axis2=2)).sum(axis=1)
        constant[tested, cells == 0.0] = -np.inf
    return Taught(seen, half, (centre, scale, constant))


def trusting(evidence: Evidence, by: Taught, worth: Callable[[IntArray], float]) -> Taught:
    """With labels trusted in one half as far as serves best in the other, by the ``worth`` of its confusion matrix.

    A Gaussian law of pixels is too sure of itself: without this, images would take from a map that is better than they.
    """
    half = by.half[by.seen]
    found = []
    for trust in TRUSTS:
        by_tile = named(evidence, replace(by, trust=(trust, trust)))
        found.append([worth(by_tile[half != tested].sum(axis=0)) for tested in (0, 1)])
    first, second = (TRUSTS[k] for k in np.array(found).argmax(axis=0))
    return replace(by, trust=(first, second))


def named(evidence: Evidence, by: Taught, favoured: Sequence[int] = (), bonus: float = 0.0) -> IntArray:
    """Cells of class (row) that are given class (column) by the laws that were taught, int64 (n_tiles, n, n).

    Of each tile that holds scored cells; the log likelihood of ``favoured`` classes is raised by ``bonus``.
    """
    centre, scale, constant = by.laws
    constant = constant.copy()
    constant[:, list(favoured)] += bonus
    n = evidence.counts.shape[1]
    confusion = np.zeros((len(by.half), n, n), dtype=np.int64)
    for label, said in enumerate(evidence.log_share):
        features, counts, tile = evidence.features, evidence.counts, evidence.tile
        if evidence.label is not None:
            mine = np.flatnonzero(evidence.label == label)
            features, counts, tile = np.take(features, mine, axis=1), counts[mine], tile[mine]
        laws = (centre, scale, constant + np.outer(by.trust, said))
        lines = kernels_classify.work_lines(len(features))
        kernels_classify.name_classes(features, counts, tile, by.half, *laws, confusion, *lines)
    return confusion[by.seen]


def knowing_areas(by: Taught, areas: IntArray) -> Taught:
    """The same laws with the ground of each class as its prior.

    ``areas``: cells (n_classes,), or by the half that is tested (2, n_classes).
    """
    centre, scale, constant = by.laws
    return replace(by, laws=(centre, scale, constant + np.log(np.maximum(areas, 0.5))))


def areas_taught(evidence: Evidence, by: Taught) -> IntArray:
    """Cells (2, n_classes) of the half that teaches each half's laws.

    By equal priors noise maps as much of a rare class as of any: the weaker the signal, the better its area might be.
    """
    held = by.half[evidence.tile]
    return np.stack([evidence.counts[held != tested].sum(axis=0) for tested in (0, 1)])


def by_map_alone(evidence: Evidence) -> Taught:
    """Laws under which what images show tells nothing, so that the map that is there already names the ground."""
    seen, half = _halves_of(evidence)
    (d, _), (_, n) = evidence.features.shape, evidence.counts.shape
    return Taught(seen, half, (np.zeros((2, n, d)), np.zeros((2, n, d, d)), np.zeros((2, n))))


def _halves_of(evidence: Evidence) -> tuple[AnyArray, IntArray]:
    """Tiles (n_tiles,) that hold scored cells, and the half that each belongs to."""
    seen = evidence.seen
    if seen is None:
        seen = np.bincount(evidence.tile[holds_cells(evidence.counts)], minlength=len(evidence.keys)) > 0
    if not seen.any():
        raise SceneError("no scored cell lies in the image", "Give cells with a known category", field="scored")
    half = np.zeros(len(evidence.keys), dtype=np.int64)
    half[seen] = halves(evidence.keys[seen])
    return seen, half


def cluster_ratio(correct: AnyArray, cells: AnyArray) -> tuple[float, float]:
    """Share of correct cells in [0, 1] and its standard error over clusters, nan with fewer than two clusters.

    Ratio estimator of cluster sampling: Cochran (1977), Sampling Techniques, 3rd ed., eq. (6.13) without finite
    population correction. Cells of one cluster err together, so a binomial error over cells would be far too small.
    ``correct`` and ``cells`` (n,) are counts of each cluster.
    """
    right, size = np.asarray(correct, dtype=np.float64), np.asarray(cells, dtype=np.float64)
    n = len(size)
    share = float(right.sum() / size.sum())
    if n < 2:
        return share, math.nan
    residual = right - share * size
    return share, math.sqrt(n / (n - 1.0) * float(residual @ residual)) / float(size.sum())


def halves(tile_keys: FloatArray) -> IntArray:
    """Half that each tile belongs to, 0 or 1: of those whose keys have one whole number that with the smaller is 1."""
    half = np.zeros(len(tile_keys), dtype=np.int64)
    group = np.floor(tile_keys)
    for alike in (np.flatnonzero(group == one) for one in np.unique(group)):
        half[alike[np.argsort(tile_keys[alike])[: len(alike) // 2]]] = 1
    return half


def _effective_pixels(total: FloatArray, squares: FloatArray) -> FloatArray:
    """Number of equally weighted pixels that carry as much, from the sums of the weights and of their squares."""
    return np.asarray(total**2 / np.where(squares > 0.0, squares, 1.0))


def _covariance_roots(covariance: FloatArray, pooled: FloatArray, pixels: FloatArray) -> FloatArray:
    """Cholesky roots (n_classes, d, d) of the covariances of classes, of the same shape; ``pixels`` (n_classes,).

    A covariance from few pixels is drawn towards the pooled one (d, d), as if that rested on 2 (d + 1) pixels, d being
    the number of features.
    """
    d = len(pooled)
    prior_pixels, own_pixels = 2.0 * (d + 1), pixels[:, None, None]
    prior = prior_pixels * (pooled + 1e-6 * np.eye(d))
    return np.asarray(np.linalg.cholesky((own_pixels * covariance + prior) / (own_pixels + prior_pixels)))
