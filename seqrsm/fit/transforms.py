"""The logit of percent scores, the way back, and on which scale scores obey the model: profiles of power transforms.

A percent score is bounded, and its scatter shrinks towards 0 and 100. On the logit scale a quadratic cannot leave the
bounds, and the optimum stays where it was, since the logit is monotone.

Powers of positive scores: Box and Cox (1964), ``(y^lambda - 1) / lambda``; 1 is no transform, 0 the logarithm. Percent:
the symmetric family of Aranda-Ordaz (1981), ``(2 / lambda) tanh(lambda logit(p) / 2)``; 1 is no transform, 0 the logit.

Coefficients and sigma are integrated out, which counts the residual degrees of freedom and not the runs (Box and Cox's
own posterior, their section 4): an interval from the plain profile is too short with many terms. The interval holds
every lambda whose log likelihood is within half a chi-squared quantile of the largest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import chdtri, expit

from seqrsm.arrays import FloatArray
from seqrsm.errors import FitError, Problem
from seqrsm.fit import linear_system
from seqrsm.fit.linear_system import check_runs

NOMINAL_COUNT = 200.0  # a score of unknown count is clipped to 0.25 % ... 99.75 %


@dataclass(frozen=True, slots=True)
class LogitScores:
    """Scores on the logit scale.

    Attributes
    ----------
    value : ndarray (n,)
        Logits, always finite.
    weight : ndarray (n,)
        Inverse relative variances, mean 1.
    variance_unit : float
        Logit variance that weight 1 stands for; a run expected at ``percent`` has
        weight ``variance_unit / logit_variance(percent, ...)``.
    """

    value: FloatArray
    weight: FloatArray
    variance_unit: float


def logit_scores(percent: FloatArray, *, counts: FloatArray | None = None) -> LogitScores:
    """Logit of percent scores and delta-method weights.

    Parameters
    ----------
    percent : ndarray (n,)
        Scores [%], 0 ... 100, both ends included.
    counts : ndarray (n,), optional
        Independent trials behind each score, > 0; nan where unknown. The empirical logit
        log((c + 1/2) / (m - c + 1/2)) with variance 1 / (c + 1/2) + 1 / (m - c + 1/2) is used for them.

    Returns
    -------
    LogitScores
        Scores without a count have equal variance on the percent scale, (1 point)^2: 0.01^2 / (p (1 - p))^2 here. They
        are clipped to 0.5 / n from the ends, n = 200, so that 0 and 100 have finite logits and small weights.

    Raises
    ------
    FitError
        Scores outside 0 ... 100; the runs are named.
    """
    percent = np.asarray(percent, dtype=np.float64)
    bad = ~((percent >= 0.0) & (percent <= 100.0))
    if np.any(bad):
        runs = ", ".join(str(i + 1) for i in np.flatnonzero(bad))
        message = f"run {runs} (counted from 1) has a score outside 0 to 100 percent"
        raise FitError(Problem(message, 'use response = "identity" or correct the scores'))
    m = _or_nan(counts, percent)
    counted = np.isfinite(m)
    correct = percent / 100.0 * np.where(counted, m, NOMINAL_COUNT)
    wrong = np.where(counted, m, NOMINAL_COUNT) - correct
    p = clip_percent(percent) / 100.0
    value = np.where(counted, np.log((correct + 0.5) / (wrong + 0.5)), np.log(p / (1.0 - p)))
    variance = np.where(counted, 1.0 / (correct + 0.5) + 1.0 / (wrong + 0.5), np.square(0.01 / (p * (1.0 - p))))
    unit = float(1.0 / np.mean(1.0 / variance))
    return LogitScores(value, unit / variance, unit)


def logit_variance(percent: FloatArray, *, count: float | None = None) -> FloatArray:
    """Delta-method variance of the logit of a score expected at ``percent`` [%], by count or of 1 point."""
    p = clip_percent(percent) / 100.0
    if count is not None:
        return np.asarray(1.0 / (count * p + 0.5) + 1.0 / (count * (1.0 - p) + 0.5))
    return np.asarray(np.square(0.01 / (p * (1.0 - p))))


def clip_percent(percent: FloatArray) -> FloatArray:
    """Scores [%] kept half a trial in ``NOMINAL_COUNT`` away from 0 and 100."""
    edge = 50.0 / NOMINAL_COUNT
    return np.clip(np.asarray(percent, dtype=np.float64), edge, 100.0 - edge)


def logit_to_percent(logit: FloatArray) -> FloatArray:
    """Back-transform [%]: of an estimate it is the median response, of an interval's end the end."""
    return np.asarray(100.0 * expit(logit), dtype=np.float64)


def _or_nan(values: FloatArray | None, like: FloatArray) -> FloatArray:
    """Positive values kept, everything else nan."""
    if values is None:
        return np.full(like.shape, np.nan)
    values = np.asarray(values, dtype=np.float64)
    return np.where(values > 0.0, values, np.nan)


@dataclass(frozen=True, slots=True)
class PowerProfile:
    """Profile likelihood of the power of a transform.

    Attributes
    ----------
    family : "box-cox" or "logit"
    best : float
        Maximum-likelihood power.
    low, high : float
        Interval of ``level``; -inf or inf where the likelihood does not fall far enough within the powers tried.
    level : float
    powers, log_likelihood : ndarray (m,)
        The curve, 0 at its highest point.
    identity_inside, zero_inside : bool
        Whether the interval holds 1 (scores as they are) and 0 (logarithm, or logit).
    """

    family: str
    best: float
    low: float
    high: float
    level: float
    powers: FloatArray
    log_likelihood: FloatArray
    identity_inside: bool
    zero_inside: bool


def box_cox_profile(
    Z: FloatArray, y: FloatArray, *, weights: FloatArray | None = None, level: float = 0.95
) -> PowerProfile:
    """Profile likelihood of the Box-Cox power, -3 ... 5, of positive scores.

    Parameters
    ----------
    Z : ndarray (n, p)
        Model matrix, n above its rank.
    y : ndarray (n,)
        Scores, all > 0.
    weights : ndarray (n,), optional
        Inverse relative variances on the transformed scale.
    level : float

    Raises
    ------
    FitError
        A score that is not positive, no residual degrees of freedom, or scores that do not vary about the model.
    """
    y = np.asarray(y, dtype=np.float64)
    _require(y > 0.0, "a score that is not positive", "powers need positive scores: shift the scores or keep the scale")
    log_y = np.log(y) - np.mean(np.log(y))  # about the geometric mean: the Jacobian is then 1 for every power

    def transform(power: float) -> tuple[FloatArray, float]:
        return (np.expm1(power * log_y) / power if abs(power) > 1e-9 else log_y), 0.0

    return _profile("box-cox", Z, y, weights, level, transform, np.linspace(-3.0, 5.0, 161))


def logit_profile(
    Z: FloatArray, percent: FloatArray, *, weights: FloatArray | None = None, level: float = 0.95
) -> PowerProfile:
    """Profile likelihood of the Aranda-Ordaz power, 0 ... 3, of percent scores; arguments as for Box and Cox.

    Scores of 0 and 100 are kept a quarter of a point from the end. The likelihood is symmetric in the power, so the
    lower end of the interval is 0 where 0 belongs to it.
    """
    percent = np.asarray(percent, dtype=np.float64)
    inside = (percent >= 0.0) & (percent <= 100.0)
    _require(inside, "a score outside 0 to 100 percent", "correct the scores")
    p = clip_percent(percent) / 100.0
    logit = np.log(p) - np.log1p(-p)

    def transform(power: float) -> tuple[FloatArray, float]:
        half = 0.5 * power * logit
        log_cosh = np.abs(half) + np.log1p(np.exp(-2.0 * np.abs(half))) - np.log(2.0)
        return (np.tanh(half) * 2.0 / power if power > 1e-9 else logit), -2.0 * float(np.sum(log_cosh))

    return _profile("logit", Z, percent, weights, level, transform, np.linspace(0.0, 3.0, 121))


def _profile(
    family: str,
    Z: FloatArray,
    y: FloatArray,
    weights: FloatArray | None,
    level: float,
    transform: Callable[[float], tuple[FloatArray, float]],
    powers: FloatArray,
) -> PowerProfile:
    Z = np.asarray(Z, dtype=np.float64)
    w = np.ones(y.shape[0]) if weights is None else np.asarray(weights, dtype=np.float64)
    check_runs(Z, y, w, Z.shape[1])
    root = np.sqrt(w)
    factors = linear_system.factorise(Z * root[:, None])
    if factors.rank >= y.size:
        raise FitError(Problem("as many terms as runs, so no residuals to choose a transformation", "Add runs."))
    Q = factors.Q

    def log_likelihood(power: float) -> float:
        t, log_jacobian = transform(float(power))
        t = t * root
        r = t - Q @ (Q.T @ t)
        sse = float(r @ r)
        if sse <= (1e-13 * float(np.linalg.norm(t))) ** 2:
            raise FitError(
                Problem("the model reproduces every score exactly, so every transformation fits equally well")
            )
        df = y.size - factors.rank
        return -0.5 * df * float(np.log(sse)) + df / y.size * log_jacobian

    curve = np.array([log_likelihood(power) for power in powers])
    peak = int(np.argmax(curve))
    around = (float(powers[max(peak - 1, 0)]), float(powers[min(peak + 1, len(powers) - 1)]))
    found = minimize_scalar(lambda v: -log_likelihood(v), bounds=around, method="bounded", options={"xatol": 1e-9})
    best, top = float(found.x), -float(found.fun)
    if curve[peak] >= top:
        best, top = float(powers[peak]), float(curve[peak])
    limit = top - 0.5 * float(chdtri(1, 1.0 - level))
    low = _crossing(log_likelihood, powers[powers < best][::-1], best, limit)
    high = _crossing(log_likelihood, powers[powers > best], best, limit)
    low = 0.0 if family == "logit" and np.isinf(low) else low
    return PowerProfile(family, best, low, high, level, powers, curve - top, low <= 1.0 <= high, low <= 0.0 <= high)


def _crossing(f: Callable[[float], float], outward: FloatArray, best: float, limit: float) -> float:
    """First power outwards from the best at which the likelihood falls to the limit; -inf or inf where it does not."""
    inner = best
    for power in outward.tolist():
        if f(power) < limit:
            return float(brentq(lambda v: f(v) - limit, inner, power, xtol=1e-10))
        inner = power
    return float(np.inf if outward.size and outward[-1] > best else -np.inf)


def _require(good: np.ndarray[tuple[int, ...], np.dtype[np.bool_]], what: str, remedy: str) -> None:
    if not np.all(good):
        runs = ", ".join(str(i + 1) for i in np.flatnonzero(~good))
        raise FitError(Problem(f"run {runs} (counted from 1) has {what}", remedy))
