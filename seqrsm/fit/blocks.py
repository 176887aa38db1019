"""Blocks, such as flight days, as a random effect.

Every run of a day has u_d ~ N(0, rho sigma^2) beside its own error.

Given the ratio rho everything is as in least squares with V = W^-1 + rho JJ' within a day, so coefficients, day effects
and future runs are Student-t. With a flat prior on the coefficients and on log sigma the likelihood of rho is the
restricted (REML) likelihood; its posterior is taken on a grid, with a half-Cauchy prior of scale 1 on sqrt(rho), the
ratio of the two standard deviations. Intervals are mixtures over that grid: they carry what few days leave unknown,
which a plug-in REML interval does not.

References
----------
Patterson, Thompson (1971), Recovery of inter-block information when block sizes are unequal, Biometrika 58, 545-554.
Gelman (2006), Prior distributions for variance parameters in hierarchical models, Bayesian Analysis 1, 515-534.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.errors import FitError
from seqrsm.fit.conjugate import mixture_interval
from seqrsm.fit.intervals import Prediction

_LOG_ROOT = np.linspace(-7.0, 7.0, 57)  # log sqrt(rho): prior mass outside is below 1e-3 at either end
_FEW_DAYS = 4
_NEGLIGIBLE = 1e-8


@dataclass(frozen=True, slots=True)
class RandomBlockPosterior:
    """Posterior of the model with random days."""

    ratios: FloatArray
    shares: FloatArray
    """(c,): grid of variance ratios and their posterior probabilities."""
    mean: FloatArray
    """(c, p): coefficients given each ratio."""
    factor: FloatArray
    """(c, p, p): L with (Z'V^-1 Z)^-1 = LL' given each ratio."""
    s: FloatArray
    """(c,): scale of a run of weight 1."""
    df: float
    """Residual degrees of freedom n - p."""
    sigma: float
    sigma_day: float
    """Standard deviations of a run of weight 1 and of the days by restricted maximum likelihood; 0 for the days where
    that is most likely."""
    reason: str
    """Why intervals rest on the prior of how days differ; empty when there are days enough."""

    def sigma_ratio_interval(self, level: float = 0.95) -> tuple[float, float]:
        """Credible interval of sigma_day / sigma."""
        cumulative, ratios = np.concatenate([[0.0], np.cumsum(self.shares)]), self.ratios
        edges = np.sqrt(np.concatenate([ratios[:1], np.sqrt(ratios[1:] * ratios[:-1]), ratios[-1:]]))
        tail = 0.5 * (1.0 - level)
        low, high = np.interp([tail, 1.0 - tail], cumulative, edges)
        return float(low), float(high)

    @property
    def estimate(self) -> FloatArray:
        """Posterior mean (p,) of the coefficients: of the average day."""
        return np.asarray(self.shares @ self.mean)

    @property
    def s_of_days(self) -> float:
        """Posterior mean of the standard deviation of the days; that of its square has no end for two days."""
        return float(self.shares @ (self.s * np.sqrt(self.ratios)))

    @property
    def s_new_day(self) -> float:
        """Standard deviation of a run of weight 1 on a new day."""
        return float(np.sqrt(self.shares @ np.square(self.s) + self.s_of_days**2))

    def draws(self, n: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Independent draws: coefficients (n, p), sigma (n,) and sigma_day (n,)."""
        which = rng.choice(len(self.shares), size=n, p=self.shares)
        sigma = self.s[which] * np.sqrt(self.df / rng.chisquare(self.df, n))
        normal = rng.standard_normal((n, self.mean.shape[1]))
        beta = self.mean[which] + sigma[:, None] * np.einsum("npq,nq->np", self.factor[which], normal)
        return beta, sigma, sigma * np.sqrt(self.ratios[which])

    def predict(
        self, rows: FloatArray, level: float = 0.95, *, weight: float | FloatArray = 1.0, replicates: float = 1
    ) -> Prediction:
        """Mean response of the average day at rows (m, p), and future runs on a new day, which brings its own effect.

        ``weight`` and ``replicates`` as in ``LeastSquaresFit.predict``; all replicates fall on one day. The standard
        error is a root mean square over the ratios, with the scatter of the centres.
        """
        rows = np.atleast_2d(np.asarray(rows, dtype=np.float64))
        centre = rows @ self.mean.T
        h = np.sum(np.square(np.einsum("mp,cpq->mcq", rows, self.factor)), axis=2)
        own = np.broadcast_to(1.0 / (replicates * np.asarray(weight)), len(rows))
        mean_scale = self.s * np.sqrt(h)
        new_scale = self.s * np.sqrt(h + self.ratios + own[:, None])
        mean = centre @ self.shares
        between = np.square(centre - mean[:, None])
        se_mean = np.sqrt((np.square(mean_scale) + between) @ self.shares)
        df = np.array(self.df)
        confidence = mixture_interval(level, self.shares, df, centre, mean_scale)
        prediction = mixture_interval(level, self.shares, df, centre, new_scale)
        return Prediction(mean, confidence, prediction, se_mean)


def fit_random_blocks(
    Z: FloatArray, y: FloatArray, days: Sequence[object], *, weights: FloatArray | None = None, inflation: float = 1.0
) -> RandomBlockPosterior:
    """Fit ``y = Z beta + u_day + e``, of y (n,) and Z (n, p) without block columns, n > p, of full rank.

    ``days`` (n,) names that of each run; ``weights`` (n,) are inverse relative variances of the runs' own errors. The
    variance of coefficients is ``inflation`` times what these tell, see `ErrorModel.inflation`. FitError of a single
    day, without residual degrees of freedom, or of terms the runs cannot tell apart.
    """
    Z, y = np.asarray(Z, dtype=np.float64), np.asarray(y, dtype=np.float64)
    w = np.ones(y.shape[0]) if weights is None else np.asarray(weights, dtype=np.float64)
    names = tuple(dict.fromkeys(days))
    n, p = Z.shape
    if len(names) < 2:
        raise FitError("one block cannot show how blocks differ", "Fly on a second day, or fit without blocks.")
    if n <= p or np.linalg.matrix_rank(Z / np.maximum(np.linalg.norm(Z, axis=0), 1e-300)) < p:
        raise FitError(f"{n} runs cannot determine {p} terms and their scatter", "Add runs or drop terms.")
    index = np.array([names.index(day) for day in days], dtype=np.int64)
    ratios = np.exp(2.0 * _LOG_ROOT)
    runs = _reduce(Z, y, w, index)
    mean, factor, scale, log_likelihood = _given(ratios, runs)
    log_share = log_likelihood + _LOG_ROOT - np.log1p(ratios)  # half-Cauchy on sqrt(rho), times d rho / d log rho
    shares = np.exp(log_share - np.max(log_share))
    keep = shares > _NEGLIGIBLE
    shares = shares[keep] / np.sum(shares[keep])
    few = f"{len(names)} blocks tell little of how blocks differ; all intervals of scores rest on the prior of it"
    reason = few if len(names) <= _FEW_DAYS else ""
    return RandomBlockPosterior(
        ratios[keep],
        shares,
        mean[keep],
        np.sqrt(inflation) * factor[keep],
        scale[keep],
        float(n - p),
        *_reml(runs, ratios, log_likelihood),
        reason,
    )


@dataclass(frozen=True, slots=True)
class _Reduced:
    """The runs as rows whose covariance is diagonal at any ratio of variances: n rows become p + 1 + days.

    Within a day W^(1/2) V W^(1/2) = I + ratio uu', u = sqrt(w): only the direction of u depends on the ratio. What
    is orthogonal to it is triangularised once for all ratios.
    """

    within: FloatArray
    """(p + 1, p + 1): triangle of the rows [Z, y] orthogonal to every u."""
    along: FloatArray
    """(d, p + 1): rows along u, one a day, of variance ``1 + ratio * total``."""
    total: FloatArray
    """(d,): |u|^2, the weight of each day."""
    log_weights: float
    """Sum of log w."""
    n: int
    """Runs."""


def _reduce(Z: FloatArray, y: FloatArray, w: FloatArray, index: IntArray) -> _Reduced:
    root = np.sqrt(w)
    X = np.column_stack([Z, y]) * root[:, None]
    total: FloatArray = np.bincount(index, w).astype(np.float64)
    along = np.zeros((total.size, X.shape[1]))
    np.add.at(along, index, root[:, None] * X)
    along /= np.sqrt(total)[:, None]
    within = np.asarray(np.linalg.qr(X - (root / np.sqrt(total)[index])[:, None] * along[index], mode="r"))
    return _Reduced(within, along, total, float(np.sum(np.log(w))), Z.shape[0])


def _given(ratios: FloatArray, runs: _Reduced) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Mean (c, p), factor (c, p, p), scale (c,) and log restricted likelihood (c,) at each ratio."""
    n, p = runs.n, runs.within.shape[1] - 1
    stretch = 1.0 + ratios[:, None] * runs.total
    within = np.broadcast_to(runs.within, (len(ratios), *runs.within.shape))
    white = np.concatenate([within, runs.along / np.sqrt(stretch)[:, :, None]], axis=1)
    log_det = np.sum(np.log(stretch), axis=1) - runs.log_weights
    R: FloatArray = np.asarray(np.linalg.qr(white, mode="r"), dtype=np.float64)
    # The last column of R holds Q'y and, below it, the length of the residual.
    residual = np.abs(R[:, p, p])
    if np.any(residual <= 1e-13 * np.linalg.norm(white[:, :, p], axis=1)):
        remedy = 'Score more runs, or set [model] block_effect = "fixed".'
        raise FitError("the model reproduces every score exactly, so no scatter remains", remedy)
    inverse: FloatArray = np.asarray(np.linalg.inv(R[:, :p, :p]), dtype=np.float64)
    log_det_r = np.sum(np.log(np.abs(np.diagonal(R[:, :p, :p], axis1=1, axis2=2))), axis=1)
    log_likelihood = -0.5 * log_det - log_det_r - (n - p) * np.log(residual)
    mean: FloatArray = np.asarray((inverse @ R[:, :p, p, None])[:, :, 0], dtype=np.float64)
    return mean, inverse, residual / np.sqrt(n - p), log_likelihood


def _reml(runs: _Reduced, ratios: FloatArray, log_likelihood: FloatArray) -> tuple[float, float]:
    """Standard deviations of a run and of the days that are most likely."""

    def at(ratio: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        return _given(np.array([ratio]), runs)

    peak = int(np.argmax(log_likelihood))
    around = np.log(ratios[[max(peak - 1, 0), min(peak + 1, len(ratios) - 1)]])
    found = scipy.optimize.minimize_scalar(
        lambda t: -float(at(float(np.exp(t)))[3][0]),
        bounds=(float(around[0]), float(around[1])),
        method="bounded",
        options={"xatol": 1e-10},
    )
    ratio = float(np.exp(found.x)) if -float(found.fun) > float(at(0.0)[3][0]) else 0.0
    sigma = float(at(ratio)[2][0])
    return sigma, sigma * float(np.sqrt(ratio))
