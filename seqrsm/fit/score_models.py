"""Counts of correct decisions: a model of scores that has no closed-form posterior.

For :func:`seqrsm.fit.target.general_target`: more scatter between runs than the binomial.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit, gammaln

from seqrsm.arrays import FloatArray
from seqrsm.fit.target import GeneralModel

_INDEPENDENCE = 9.0  # second parameter of the prior of the correlation within a run
_STIRLING = 60.0  # from here on the series is exact to the last digits


@dataclass(frozen=True, slots=True)
class CoefficientPrior:
    """Normal prior, cut off at bounds where there are any."""

    mean: FloatArray
    """(p,)."""
    inverse: FloatArray
    """(p, p): inverse covariance; a row of zeros: flat."""
    low: FloatArray | None = None
    high: FloatArray | None = None
    """(p,): bounds of each coefficient; -inf and inf where there is none."""

    def bounded(self, start: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """A start (p,) moved inside the bounds, and these, (p,) each."""
        low = np.full(start.size, -np.inf) if self.low is None else self.low
        high = np.full(start.size, np.inf) if self.high is None else self.high
        inner = np.where(np.isfinite(high - low), 0.02 * (high - low), 0.02 * np.abs(start) + 1e-3)
        return np.clip(start, low + inner, high - inner), low, high

    def log_density(self, beta: FloatArray) -> FloatArray:
        """Value (n,) at coefficients (n, p), up to a constant."""
        off = beta - self.mean
        return np.asarray(-0.5 * np.sum((off @ self.inverse) * off, axis=1))


def beta_binomial_model(
    Z: FloatArray, correct: FloatArray, trials: FloatArray, prior: CoefficientPrior
) -> GeneralModel:
    """Counts of correct decisions: logit p = Z beta, correct ~ BetaBinomial(trials, p phi, (1 - p) phi).

    The last parameter, the correlation of decisions within a run, 1 / (1 + phi) in (0, 1), has the prior Beta(1, 9),
    which expects 0.1. The variance is binomial times 1 + (trials - 1) correlation. Z is (n, p); counts (n,), 0 <=
    correct <= trials, trials > 0, need not be whole numbers (effective counts); the prior is on the logit scale.
    """
    Z = np.asarray(Z, dtype=np.float64)
    c, m = np.asarray(correct, dtype=np.float64), np.asarray(trials, dtype=np.float64)
    logit = np.log((c + 0.5) / (m - c + 0.5))
    start, low, high = prior.bounded(np.asarray(np.linalg.lstsq(Z, logit, rcond=None)[0], dtype=np.float64))
    p = Z.shape[1]

    def log_density(v: FloatArray) -> FloatArray:
        share = np.clip(expit(v[:, :p] @ Z.T), 1e-12, 1.0 - 1e-12)
        phi = (1.0 / v[:, p] - 1.0)[:, None]
        # B(c + a, m - c + b) / B(a, b), with the binomial part apart: beyond it little is left of large counts.
        binomial = c * np.log(share) + (m - c) * np.log1p(-share)
        more = _log_rising(share * phi, c) + _log_rising((1.0 - share) * phi, m - c) - _log_rising(phi, m)
        likelihood = np.sum(binomial + more, axis=1)
        return np.asarray(likelihood + prior.log_density(v[:, :p]) + (_INDEPENDENCE - 1.0) * np.log1p(-v[:, p]))

    start = np.append(start, 1.0 / (1.0 + _INDEPENDENCE))
    return GeneralModel(start, np.append(low, 0.0), np.append(high, 1.0), log_density)


def _log_rising(a: FloatArray, c: FloatArray) -> FloatArray:
    """Log of Gamma(a + c) / (Gamma(a) a^c), without the cancellation that a large ``a`` (Stirling's series) brings."""
    large = np.maximum(a, _STIRLING)

    def correction(x: FloatArray) -> FloatArray:
        return np.asarray((1.0 / 12.0 - (1.0 / 360.0 - 1.0 / 1260.0 / x**2) / x**2) / x)

    series = (large + c - 0.5) * np.log1p(c / large) - c + correction(large + c) - correction(large)
    small = np.minimum(a, _STIRLING)
    return np.where(a >= _STIRLING, series, gammaln(small + c) - gammaln(small) - c * np.log(small))
