"""Intervals of means and of future runs, F tests, and the analysis of variance with pure error and lack of fit.

The order of the analysis of variance is that of R's ``rsm``: blocks, first order (FO), categories, interactions (TWI),
squares (PQ), residual, and the residual split into lack of fit and pure error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import qr
from scipy.special import fdtrc, stdtrit

from seqrsm.arrays import AnyArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Interval:
    """Lower and upper end, arrays of one shape; nan where the interval is not defined."""

    low: FloatArray
    high: FloatArray

    @property
    def half_width(self) -> FloatArray:
        """Half of ``high - low``."""
        return 0.5 * (self.high - self.low)


@dataclass(frozen=True, slots=True)
class Prediction:
    """Estimated response with both intervals at m points.

    Attributes
    ----------
    mean : ndarray (m,)
        Estimated mean response; nan where it is not estimable.
    confidence : Interval
        Of the mean response (RSL TR 380-1 eq. 2-17).
    prediction : Interval
        Of the mean of ``replicates`` future runs (eq. 2-23 with the factor S that is missing in print).
    se_mean, se_prediction : ndarray (m,)
        Standard errors behind the two intervals.
    """

    mean: FloatArray
    confidence: Interval
    prediction: Interval
    se_mean: FloatArray
    se_prediction: FloatArray


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


def t_quantile(df: ArrayLike, level: ArrayLike) -> FloatArray:
    """Two-sided quantile of Student's t.

    Parameters
    ----------
    df : array_like
        Degrees of freedom; inf gives the normal quantile, values <= 0 give nan.
    level : array_like
        Two-sided probability, in (0, 1).

    Returns
    -------
    ndarray, broadcast shape of ``df`` and ``level``
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
    if not np.all((level > 0.0) & (level < 1.0)):
        raise ValueError(f"level must lie between 0 and 1, got {level}")
    # stdtrit has no limit at infinity; at 1e12 the difference from the normal quantile is below 1e-12.
    safe = np.clip(np.where(degrees > 0.0, degrees, 1.0), None, 1e12)
    quantile: FloatArray = np.where(degrees > 0.0, stdtrit(safe, 0.5 + 0.5 * level), np.nan)
    return quantile


def f_ratio(ss: float, df: int, sse: float, df_residual: int) -> tuple[float, float, str]:
    """F = (ss / df) / (sse / df_residual), its p value, and the reason where they are nan."""
    nan = float("nan")
    if df_residual == 0:
        return nan, nan, "no residual degrees of freedom"
    if sse == 0.0:
        return nan, nan, "the model reproduces every score exactly, so there is no error to test against"
    f = (ss / df) / (sse / df_residual)
    return f, float(fdtrc(df, df_residual, f)), ""


_GROUPS = (
    ("block", "blocks"),
    ("linear", "first order"),
    ("category", "categories"),
    ("interaction", "interactions"),
    ("square", "squares"),
)
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


def group_index(ids: Sequence[object] | AnyArray | None, n: int) -> IntArray | None:
    """Integer label (n,) of each distinct id in order of appearance; None for None."""
    if ids is None:
        return None
    values = list(ids)
    if len(values) != n:
        raise ValueError(f"{len(values)} ids for {n} runs")
    seen: dict[object, int] = {}
    return np.array([seen.setdefault(value, len(seen)) for value in values], dtype=np.int64)


def sequential_ss(groups: Sequence[FloatArray], y: FloatArray) -> list[tuple[int, float]]:
    """Rank and sum of squares that each group of columns adds to those before it.

    Parameters
    ----------
    groups : sequence of ndarray (n, p_g)
        Weighted model columns.
    y : ndarray (n,)
        Weighted scores.

    Returns
    -------
    list of (df, ss)
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


def lack_of_fit(
    y: FloatArray,
    weights: FloatArray,
    sse: float,
    rank: int,
    setting_ids: IntArray | None,
    block_ids: IntArray | None,
    df_residual: int,
) -> LackOfFit | str:
    """Test lack of fit; a sentence instead when the runs do not allow it."""
    if df_residual == 0:
        return "no residual degrees of freedom: as many terms as runs"
    if setting_ids is None:
        return "which runs repeat a setting is not known"
    df_pe, ss_pe, n_groups = pure_error(y, weights, setting_ids, block_ids)
    df_lof = n_groups - rank
    if df_pe == 0:
        twice = len(np.unique(setting_ids)) < len(setting_ids)
        where = "no setting was run twice" if not twice else "no setting was run twice in one block"
        return f"{where}, so there is no pure error to test against"
    if df_lof <= 0:
        return "no more distinct settings than terms, so the model passes through all means of repeats"
    if ss_pe == 0.0:
        return "all repeated runs gave the same score: pure error is zero and F is undefined"
    ss_lof = max(sse - ss_pe, 0.0)
    f = (ss_lof / df_lof) / (ss_pe / df_pe)
    return LackOfFit(df_lof, df_pe, ss_lof, ss_pe, f, float(fdtrc(df_lof, df_pe, f)))


def anova_table(
    Z: FloatArray,
    y: FloatArray,
    weights: FloatArray,
    kinds: Sequence[str],
    sse: float,
    df_residual: int,
    lof: LackOfFit | str,
) -> tuple[AnovaRow, ...]:
    """Rows of the sequential analysis of variance; groups that the model does not hold are left out."""
    root = np.sqrt(weights)
    X, nan = Z * root[:, None], float("nan")
    kind = np.array(kinds)
    held = [(name, key) for key, name in _GROUPS if np.any(kind == key)]
    scores = y - y[0] if np.any(kind == "intercept") and np.ptp(y) == 0.0 else y  # equal scores leave no rounding dust
    parts = sequential_ss([X[:, kind == "intercept"], *(X[:, kind == key] for _, key in held)], scores * root)
    ms_error = sse / df_residual if df_residual > 0 else nan
    rows = []
    for (name, _), (df, ss) in zip(held, parts[1:], strict=True):
        f = (ss / df) / ms_error if df > 0 and ms_error > 0.0 else nan
        p = float(fdtrc(df, df_residual, f)) if f == f else nan
        rows.append(AnovaRow(name, df, ss, ss / df if df > 0 else nan, f, p))
    rows.append(AnovaRow("residual", df_residual, sse, ms_error, nan, nan))
    if isinstance(lof, LackOfFit):
        rows.append(AnovaRow("lack of fit", lof.df_lof, lof.ss_lof, lof.ss_lof / lof.df_lof, lof.f, lof.p))
        rows.append(AnovaRow("pure error", lof.df_pe, lof.ss_pe, lof.ss_pe / lof.df_pe, nan, nan))
    df_total = y.shape[0] - parts[0][0]
    rows.append(AnovaRow("total", df_total, total_ss(y, weights, bool(np.any(kind == "intercept"))), nan, nan, nan))
    return tuple(rows)


def total_ss(y: FloatArray, weights: FloatArray, about_mean: bool) -> float:
    """Weighted total sum of squares, about the weighted mean or about zero."""
    if not about_mean:
        return float(np.sum(weights * np.square(y)))
    shifted = y - y[0]
    mean = float(np.sum(weights * shifted) / np.sum(weights))
    return float(np.sum(weights * np.square(shifted - mean)))
