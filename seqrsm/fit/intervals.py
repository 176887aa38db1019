"""Intervals of means and of future runs, F tests, and the parts of an analysis of variance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import qr
from scipy.special import stdtrit

from seqrsm.arrays import AnyArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Interval:
    """Lower and upper end, arrays of one shape; nan where the interval is not defined."""

    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, slots=True)
class Prediction:
    """Estimated response with both intervals at m points."""

    mean: FloatArray
    """(m,): estimated mean response."""
    confidence: Interval
    """Of the mean response (RSL TR 380-1 eq. 2-17)."""
    prediction: Interval
    """Of the mean of ``replicates`` future runs (eq. 2-23 with the factor S that is missing in print)."""
    se_mean: FloatArray
    """(m,): standard error of the mean response."""


@dataclass(frozen=True, slots=True)
class FTest:
    """Partial F test of a group of terms (RSL TR 380-1 eq. 2-14).

    ``df`` is the rank of the group given the other terms, ``ss`` the extra sum of squares, ``ms = ss / df``;
    ``f`` and ``p`` are nan, with ``reason``, where no test exists.
    """

    df: int
    ss: float
    ms: float
    f: float
    p: float
    reason: str = ""


def known(value: float, uncertainty: float) -> str:
    """``value`` with the digits that its uncertainty supports: down to the second of the uncertainty's own."""
    if not (math.isfinite(value) and math.isfinite(uncertainty)) or value == 0.0 or uncertainty == 0.0:
        return f"{value:.4g}"
    places = min(1 - math.floor(math.log10(abs(uncertainty))), 15)
    return f"{round(value, places) + 0.0:.{max(places, 0)}f}"  # no -0.0


def t_quantile(df: ArrayLike, level: ArrayLike) -> FloatArray:
    """Two-sided quantile of Student's t, of the broadcast shape of ``df`` and ``level``, a probability in (0, 1).

    Infinite degrees of freedom give the normal quantile, values <= 0 give nan.
    """
    degrees, probability = np.asarray(df, dtype=np.float64), np.asarray(level, dtype=np.float64)
    if degrees.ndim == probability.ndim == 0:
        return np.asarray(_one_quantile(float(degrees), float(probability)))
    return _quantiles(degrees, probability)


@lru_cache(maxsize=4096)
def _one_quantile(df: float, level: float) -> float:
    """Of one number: the same few are asked for again and again, and stdtrit is slow."""
    return float(_quantiles(np.asarray(df), np.asarray(level)))


def _quantiles(degrees: FloatArray, level: FloatArray) -> FloatArray:
    # stdtrit has no limit at infinity; at 1e12 the difference from the normal quantile is below 1e-12.
    safe = np.clip(np.where(degrees > 0.0, degrees, 1.0), None, 1e12)
    quantile: FloatArray = np.where(degrees > 0.0, stdtrit(safe, 0.5 + 0.5 * level), np.nan)
    return quantile


_RANK_TOLERANCE = 1e-11  # of a column's length: what is left of it beside the earlier columns counts as zero below


@dataclass(frozen=True, slots=True)
class AnovaRow:
    """One line of the table; ``f`` and ``p`` are nan where no test exists."""

    source: str
    df: int
    ss: float
    ms: float
    f: float
    p: float


@dataclass(frozen=True, slots=True)
class LackOfFit:
    """F test of what the model leaves unexplained against the scatter of repeated runs."""

    df_lof: int
    df_pe: int
    ss_lof: float
    ss_pe: float
    f: float
    p: float


MIN_DF_PURE_ERROR = 4
"""Degrees of freedom of pure error from which that test says something."""


def group_index(ids: Sequence[object] | AnyArray | None) -> IntArray | None:
    """Integer label of each distinct id in order of appearance; None for None."""
    if ids is None:
        return None
    seen: dict[object, int] = {}
    return np.array([seen.setdefault(value, len(seen)) for value in ids], dtype=np.int64)


def sequential_ss(groups: Sequence[FloatArray], y: FloatArray) -> list[tuple[int, float]]:
    """Rank and sum of squares that each group of columns (n, p_g) adds to those before it; all weighted like ``y``.

    Each column is projected off the earlier groups twice, so that the bases stay orthogonal to rounding.
    """
    basis = np.zeros((y.shape[0], 0))
    left = y.copy()
    result = []
    for columns in groups:
        norms = np.linalg.norm(columns, axis=0)
        rest = columns / np.where(norms > 0.0, norms, 1.0)
        for _ in range(2):
            rest = rest - basis @ (basis.T @ rest)
        rest = rest[:, norms > 0.0]
        df, ss = 0, 0.0
        if rest.size:
            Q, R, _ = qr(rest, mode="economic", pivoting=True, check_finite=False)
            df = int(np.count_nonzero(np.abs(np.diagonal(R)) > _RANK_TOLERANCE))
            # Columns nearly parallel to the earlier ones lose orthogonality in the division by R: once more.
            Q = Q[:, :df] - basis @ (basis.T @ Q[:, :df])
            Q = np.linalg.qr(Q)[0]
            effect = Q.T @ left
            left = left - Q @ effect
            basis = np.hstack([basis, Q])
            ss = float(effect @ effect)
        result.append((df, ss))
    return result


def pure_error(
    y: FloatArray, weights: FloatArray, setting_ids: IntArray, block_ids: IntArray | None
) -> tuple[int, float, int]:
    """Degrees of freedom and sum of squares within repeated settings, and how many means they leave to the model.

    A setting repeated in two blocks counts as two settings: the difference of blocks is no pure error.
    """
    label = setting_ids if block_ids is None else setting_ids * (int(block_ids.max()) + 1) + block_ids
    _, group = np.unique(label, return_inverse=True)
    n_groups = int(group.max()) + 1
    # Centre on one run of the group first: repeats that agree exactly then leave exactly zero.
    first = np.zeros(n_groups)
    first[group[::-1]] = y[::-1]
    deviation = y - first[group]
    mean = np.bincount(group, weights * deviation) / np.bincount(group, weights)
    ss = float(np.sum(weights * np.square(deviation - mean[group])))
    return y.shape[0] - n_groups, ss, n_groups
