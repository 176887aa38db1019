"""On which scale do the scores obey the model: profile likelihoods of power transforms.

Positive scores: Box and Cox (1964), ``(y^lambda - 1) / lambda``; 1 is no transform, 0 the logarithm. Percent: the
symmetric family of Aranda-Ordaz (1981), ``(2 / lambda) tanh(lambda logit(p) / 2)``; 1 is no transform, 0 the logit.

Coefficients and sigma are integrated out, which counts the residual degrees of freedom and not the runs (Box and Cox's
own posterior, their section 4): an interval from the plain profile is too short with many terms. The interval holds
every lambda whose log likelihood is within half a chi-squared quantile of the largest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import chdtri

from seqrsm.arrays import FloatArray
from seqrsm.errors import FitError, Problem
from seqrsm.fit import linear_system
from seqrsm.fit.linear_system import check_runs
from seqrsm.fit.transforms import clip_percent


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
    _require(y > 0.0, "a score that is not positive", "powers of it do not exist: shift the scores or keep the scale")
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
        raise FitError(Problem("as many terms as runs: no residuals to choose a scale by", "Add runs."))
    Q = factors.Q

    def log_likelihood(power: float) -> float:
        t, log_jacobian = transform(float(power))
        t = t * root
        r = t - Q @ (Q.T @ t)
        sse = float(r @ r)
        if sse <= (1e-13 * float(np.linalg.norm(t))) ** 2:
            raise FitError(Problem("the model reproduces every score exactly: no scale is better than another"))
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
