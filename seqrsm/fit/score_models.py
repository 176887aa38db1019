"""Models of scores that have no closed-form posterior, for :func:`seqrsm.fit.ensemble.sample_model`.

:func:`normal_model`: one surface seen through several sources, each with a scatter of its own; flights may differ from
the simulation by a scale and a low-order discrepancy (Kennedy and O'Hagan 2000, in its linear form); days may have
random effects; coefficients may have bounds. :func:`beta_binomial_model`: counts of correct decisions with more scatter
than the binomial.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, gammaln

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.errors import FitError, Problem
from seqrsm.fit.linear_system import check_runs
from seqrsm.fit.target import GeneralModel, Parameter

_STIRLING = 60.0  # from here on the series is exact to the last digits


@dataclass(frozen=True, slots=True)
class CoefficientPrior:
    """Normal priors, cut off at bounds where there are any.

    Attributes
    ----------
    mean, sd : ndarray (p,)
        Of independent coefficients; ``sd`` inf: flat.
    low, high : ndarray (p,), optional
        Bounds of each coefficient; -inf and inf where there is none.
    precision : ndarray (p, p), optional
        Inverse covariance of coefficients that depend on each other, in place of ``sd``.
    """

    mean: FloatArray
    sd: FloatArray
    low: FloatArray | None = None
    high: FloatArray | None = None
    precision: FloatArray | None = None

    @property
    def inverse(self) -> FloatArray:
        """Inverse covariance (p, p)."""
        return np.diag(1.0 / np.square(self.sd)) if self.precision is None else self.precision

    def parameters(self, start: FloatArray) -> list[Parameter]:
        """Parameters "beta[j]" with a start inside the bounds."""
        p = start.size
        low = np.full(p, -np.inf) if self.low is None else np.asarray(self.low, dtype=np.float64)
        high = np.full(p, np.inf) if self.high is None else np.asarray(self.high, dtype=np.float64)
        if np.any(low >= high):
            raise FitError(Problem("a coefficient's bounds are empty", "Give low < high."))
        inner = np.where(np.isfinite(high - low), 0.02 * (high - low), 0.02 * np.abs(start) + 1e-3)
        inside = np.clip(start, low + inner, high - inner)
        return [Parameter(f"beta[{j}]", float(inside[j]), float(low[j]), float(high[j])) for j in range(p)]

    def log_density(self, beta: FloatArray) -> FloatArray:
        """Value (n,) at coefficients (n, p), up to a constant."""
        off = beta - self.mean
        return np.asarray(-0.5 * np.sum((off @ self.inverse) * off, axis=1))


@dataclass(frozen=True, slots=True)
class Discrepancy:
    """How the second source may differ from the first: ``scale * surface + z_delta' gamma``.

    Attributes
    ----------
    columns : ndarray (n, r)
        z_delta of every run, such as (1, x); rows of runs that are not ``inside`` are ignored.
    inside : ndarray (n,) of bool
        Runs of the second source (flights).
    sd : ndarray (r,)
        Prior standard deviation of gamma, about 0.
    scale_sd : float
        Prior standard deviation of the scale about 1; 0 keeps it at 1.
    """

    columns: FloatArray
    inside: BoolArray
    sd: FloatArray
    scale_sd: float = 0.0


def normal_model(
    Z: FloatArray,
    y: FloatArray,
    prior: CoefficientPrior,
    *,
    weights: FloatArray | None = None,
    sources: Sequence[object] | None = None,
    sigma_scale: float = 1.0,
    sigma_known: Sequence[float] | None = None,
    days: Sequence[object] | None = None,
    day_scale: float = 1.0,
    discrepancy: Discrepancy | None = None,
) -> GeneralModel:
    """Scores with normal errors and unknown variances: by source, between days, between sources.

    Without bounds the coefficients are integrated out exactly, the sampler sees the standard deviations and the scale
    only, and coefficients are drawn given these: the posterior of a thousand terms costs no more steps than one.

    Parameters
    ----------
    Z : ndarray (n, p)
    y : ndarray (n,)
    prior : CoefficientPrior
    weights : ndarray (n,), optional
        Inverse relative variances within a source.
    sources : sequence (n,), optional
        Source of each run; parameters "sigma[<source>]" ~ half-normal(``sigma_scale``).
    sigma_scale, day_scale : float
        Scales of the half-normal priors of the standard deviations, score units.
    sigma_known : sequence of float, optional
        Standard deviation of each source, in order of first appearance: known, and no parameters.
    days : sequence (n,), optional
        Day of each run: random effects with the parameter "sigma_day" ~ half-normal(``day_scale``), integrated out.
    discrepancy : Discrepancy, optional
        Parameters "gamma[j]" and, when its scale may vary, "scale".

    Raises
    ------
    FitError
        Scores that cannot be used.
    """
    Z, y = np.asarray(Z, dtype=np.float64), np.asarray(y, dtype=np.float64)
    w = np.ones(y.shape[0]) if weights is None else np.asarray(weights, dtype=np.float64)
    check_runs(Z, y, w, Z.shape[1])
    names, source = _index(["all"] * y.size if sources is None else sources)
    _, day = _index(list(range(y.size)) if days is None else days)
    b: FloatArray = np.asarray(np.linalg.lstsq(Z, y, rcond=None)[0], dtype=np.float64)
    hyper: list[Parameter] = []
    if sigma_known is None:
        spread = max(float(np.std(y - Z @ b)), 0.05 * sigma_scale)
        hyper += [Parameter(f"sigma[{name}]", spread, 0.0) for name in names]
    if days is not None:
        hyper.append(Parameter("sigma_day", 0.5 * day_scale, 0.0))
    if discrepancy is not None and discrepancy.scale_sd > 0.0:
        hyper.append(Parameter("scale", 1.0))
    known = None if sigma_known is None else np.asarray(sigma_known, dtype=np.float64)
    scores = _NormalScores(
        Z, y, w, prior, b, source, day, len(names), sigma_scale, known, day_scale, discrepancy, hyper
    )
    if hyper and prior.low is None and prior.high is None:
        return GeneralModel(tuple(hyper), scores.marginal, scores.complete)
    linear = prior.parameters(b) + [Parameter(f"gamma[{j}]", 0.0) for j in range(scores.r)]
    return GeneralModel((*linear, *hyper), scores.joint)


@dataclass(frozen=True, slots=True)
class _NormalScores:
    """Densities of the normal model: of everything, and with the coefficients integrated out.

    Inside, coefficients count from ``centre`` (p,), the least-squares fit: scores far from zero lose no digits.
    """

    Z: FloatArray
    y: FloatArray
    w: FloatArray
    prior: CoefficientPrior
    centre: FloatArray
    source: IntArray
    day: IntArray
    n_sources: int
    sigma_scale: float
    known: FloatArray | None
    day_scale: float
    discrepancy: Discrepancy | None
    hyper: list[Parameter]

    @property
    def r(self) -> int:
        """Number of discrepancy coefficients."""
        return 0 if self.discrepancy is None else self.discrepancy.columns.shape[1]

    def hyperparameters(self, v: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Precision of every run (n, N), sigma_day (n,), scale of the flights (n,) and log prior (n,)."""
        column = {parameter.name: v[:, j] for j, parameter in enumerate(self.hyper)}
        log_prior = np.zeros(len(v))
        if self.known is None:
            sigma = v[:, : self.n_sources]
            log_prior -= 0.5 * np.sum(np.square(sigma / self.sigma_scale), axis=1)
        else:
            sigma = np.broadcast_to(self.known, (len(v), self.n_sources))
        tau = column.get("sigma_day", np.zeros(len(v)))
        scale = column.get("scale", np.ones(len(v)))
        log_prior -= 0.5 * np.square(tau / self.day_scale)
        if "scale" in column and self.discrepancy is not None:
            log_prior -= 0.5 * np.square((scale - 1.0) / self.discrepancy.scale_sd)
        return self.w / np.square(sigma[:, self.source]), tau, scale, log_prior

    def joint(self, v: FloatArray) -> FloatArray:
        """Log density (n,) of (beta, gamma, hyperparameters)."""
        p = self.Z.shape[1]
        precision, tau, scale, value = self.hyperparameters(v[:, p + self.r :])
        value = value + self.prior.log_density(v[:, :p])
        mean = v[:, :p] @ self.Z.T
        if self.discrepancy is not None:
            gamma = v[:, p : p + self.r]
            value = value - 0.5 * np.sum(np.square(gamma / self.discrepancy.sd), axis=1)
            other = scale[:, None] * mean + gamma @ self.discrepancy.columns.T
            mean = np.where(self.discrepancy.inside, other, mean)
        J = (self.day[:, None] == np.arange(self.day.max() + 1)).astype(np.float64)
        return np.asarray(value + _log_likelihood(self.y - mean, precision, tau, J))

    def marginal(self, v: FloatArray) -> FloatArray:
        """Log density (n,) of the hyperparameters."""
        value = self.hyperparameters(v)[3]
        precision, c, constant, log_det = self._information(v)
        # Bordered by c, the triangle's last row is L^-1 c: one factorisation in place of one and a solve.
        size = c.shape[1]
        bordered = np.empty((len(v), size + 1, size + 1))
        bordered[:, :size, :size], bordered[:, size, :size], bordered[:, :size, size] = precision, c, c
        bordered[:, size, size] = 2.0 * constant
        L, ok = _cholesky(bordered)
        value = np.where(ok, value, -np.inf)
        fitted = np.sum(np.square(L[:, size, :size]), axis=1)
        log_det_l = np.sum(np.log(np.diagonal(L, axis1=1, axis2=2)[:, :size]), axis=1)
        return np.asarray(value - 0.5 * (constant - fitted + log_det) - log_det_l)

    def complete(self, v: FloatArray, rng: np.random.Generator) -> tuple[tuple[str, ...], FloatArray]:
        """Add exact draws of (beta, gamma) in front of the hyperparameters."""
        parts = []
        for start in range(0, len(v), 4096):
            precision, c, _, _ = self._information(v[start : start + 4096])
            # H = LL': mean H^-1 c and noise L'^-1 e in one solve with the transpose.
            L = np.linalg.cholesky(precision)
            half = np.linalg.solve(L, c[:, :, None]) + rng.standard_normal((*c.shape, 1))
            parts.append(np.linalg.solve(np.swapaxes(L, 1, 2), half)[:, :, 0])
            parts[-1][:, : self.centre.size] += self.centre
        names = [f"beta[{j}]" for j in range(self.Z.shape[1])] + [f"gamma[{j}]" for j in range(self.r)]
        return (*names, *(parameter.name for parameter in self.hyper)), np.hstack([np.concatenate(parts), v])

    def _information(self, v: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Posterior precision (n, c, c) of (beta, gamma), its product with their mean, the constant, log |V|."""
        run_precision, tau, scale, _ = self.hyperparameters(v)
        c, p = self.centre.size + self.r, self.centre.size
        log_det = -np.sum(np.log(run_precision), axis=1)
        if np.any(tau > 0.0):
            moment, more = self._moment_with_days(run_precision, tau, scale)
            log_det += more
        else:
            moment = self._moment(run_precision, scale)
        D, m = np.zeros((c, c)), np.zeros(c)
        D[:p, :p], m[:p] = self.prior.inverse, self.prior.mean - self.centre
        if self.discrepancy is not None:
            D[p:, p:] = np.diag(1.0 / np.square(self.discrepancy.sd))
        return moment[:, :c, :c] + D, moment[:, :c, c] + D @ m, moment[:, c, c] + m @ D @ m, log_det

    def _moment(self, run_precision: FloatArray, scale: FloatArray) -> FloatArray:
        """X' V^-1 X (n, c + 1, c + 1) of runs that know nothing of each other; the last column is that of the scores.

        Runs of a source count alike but for their weights, so that their sums of products are made once.
        """
        base = self.Z @ self.centre
        X0 = np.hstack([self.Z, np.zeros((self.y.size, self.r)), (self.y - base)[:, None]])
        X1 = np.zeros_like(X0)  # X = X0 + (scale - 1) X1
        if self.discrepancy is not None:
            inside = self.discrepancy.inside
            X0[inside, self.centre.size : -1] = self.discrepancy.columns[inside]
            X1[inside, : self.centre.size], X1[inside, -1] = self.Z[inside], -base[inside]
        factors, products = [], []
        for source in range(self.n_sources):
            rows = self.source == source
            A, B, w = X0[rows], X1[rows], self.w[rows, None]
            unit = run_precision[:, rows][:, 0] / w[0, 0]
            factors += [unit, unit * (scale - 1.0), unit * np.square(scale - 1.0)]
            cross = (A * w).T @ B
            products += [(A * w).T @ A, cross + cross.T, (B * w).T @ B]
        return np.asarray(np.tensordot(np.array(factors).T, np.array(products), axes=1))

    def _moment_with_days(
        self, run_precision: FloatArray, tau: FloatArray, scale: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The same with day effects integrated out, and what they add to log |V|."""
        root, p, base = np.sqrt(run_precision), self.Z.shape[1], self.Z @ self.centre
        X = np.zeros((len(tau), self.y.size, p + self.r + 1))
        X[:, :, :p], X[:, :, -1] = self.Z, self.y - base
        if self.discrepancy is not None:
            inside = self.discrepancy.inside
            X[:, inside, :p] *= scale[:, None, None]
            X[:, inside, -1] = self.y[inside] - scale[:, None] * base[inside]
            X[:, inside, p:-1] = self.discrepancy.columns[inside]
        X *= root[:, :, None]
        J = (self.day[:, None] == np.arange(self.day.max() + 1)).astype(np.float64)
        total = run_precision @ J
        stretch = 1.0 + np.square(tau)[:, None] * total
        shrink = (1.0 - 1.0 / np.sqrt(stretch)) / total
        along = J.T @ (root[:, :, None] * X)
        X -= root[:, :, None] * (shrink[:, :, None] * along)[:, self.day]
        return np.swapaxes(X, 1, 2) @ X, np.sum(np.log(stretch), axis=1)


def _cholesky(precision: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Lower triangles (n, c, c), and which matrices have one to the digits at hand.

    Where one source is a million times more certain than another and cannot tell all terms apart, the sum of both has
    lost the other; such variances are beyond what scores can say, and count as impossible.
    """
    ok = np.ones(len(precision), dtype=np.bool_)
    try:
        return np.asarray(np.linalg.cholesky(precision), dtype=np.float64), ok
    except np.linalg.LinAlgError:
        pass
    L = np.broadcast_to(np.eye(precision.shape[1]), precision.shape).copy()
    for i, one in enumerate(precision):
        try:
            L[i] = np.linalg.cholesky(one)
        except np.linalg.LinAlgError:
            ok[i] = False
    return L, ok


def _log_likelihood(residual: FloatArray, precision: FloatArray, tau: FloatArray, J: FloatArray) -> FloatArray:
    """Normal log likelihood (n,) of residuals (n, N) with day effects of standard deviation tau (n,) integrated out.

    By Woodbury within each day; J (N, b) tells the days. The weights' own determinant is left to the caller.
    """
    total = precision @ J
    stretch = 1.0 + np.square(tau)[:, None] * total
    pull = (precision * residual) @ J
    square = np.sum(precision * np.square(residual), axis=1)
    square -= np.sum(np.square(tau)[:, None] * np.square(pull) / stretch, axis=1)
    log_det = np.sum(np.log(stretch), axis=1) - np.sum(np.log(precision), axis=1)
    return np.asarray(-0.5 * (square + log_det))


def beta_binomial_model(
    Z: FloatArray, correct: FloatArray, trials: FloatArray, prior: CoefficientPrior, *, overdispersion: float = 9.0
) -> GeneralModel:
    """Counts of correct decisions: logit p = Z beta, correct ~ BetaBinomial(trials, p phi, (1 - p) phi).

    Parameters
    ----------
    Z : ndarray (n, p)
    correct, trials : ndarray (n,)
        0 <= correct <= trials, trials > 0; not necessarily whole numbers (effective counts).
    prior : CoefficientPrior
        On the logit scale.
    overdispersion : float
        The parameter "correlation" of decisions within a run, 1 / (1 + phi) in (0, 1), has the prior
        Beta(1, ``overdispersion``): the default expects 0.1. The variance is binomial times
        1 + (trials - 1) correlation.

    Raises
    ------
    FitError
        Counts outside their limits; the runs are named.
    """
    Z = np.asarray(Z, dtype=np.float64)
    c, m = np.asarray(correct, dtype=np.float64), np.asarray(trials, dtype=np.float64)
    check_runs(Z, c, np.ones(c.shape), Z.shape[1])
    bad = ~((m > 0.0) & np.isfinite(m) & (c >= 0.0) & (c <= m))
    if np.any(bad):
        runs = ", ".join(str(i + 1) for i in np.flatnonzero(bad))
        raise FitError(
            Problem(f"run {runs} (counted from 1) has counts that cannot be", "Give 0 <= correct <= trials.")
        )
    logit = np.log((c + 0.5) / (m - c + 0.5))
    start: FloatArray = np.asarray(np.linalg.lstsq(Z, logit, rcond=None)[0], dtype=np.float64)
    parameters = [*prior.parameters(start), Parameter("correlation", 1.0 / (1.0 + overdispersion), 0.0, 1.0)]
    p = Z.shape[1]

    def log_density(v: FloatArray) -> FloatArray:
        share = np.clip(expit(v[:, :p] @ Z.T), 1e-12, 1.0 - 1e-12)
        phi = (1.0 / v[:, p] - 1.0)[:, None]
        # B(c + a, m - c + b) / B(a, b), with the binomial part apart: beyond it little is left of large counts.
        binomial = c * np.log(share) + (m - c) * np.log1p(-share)
        more = _log_rising(share * phi, c) + _log_rising((1.0 - share) * phi, m - c) - _log_rising(phi, m)
        likelihood = np.sum(binomial + more, axis=1)
        return np.asarray(likelihood + prior.log_density(v[:, :p]) + (overdispersion - 1.0) * np.log1p(-v[:, p]))

    return GeneralModel(tuple(parameters), log_density)


def _log_rising(a: FloatArray, c: FloatArray) -> FloatArray:
    """Log of Gamma(a + c) / (Gamma(a) a^c), without the cancellation that a large ``a`` (Stirling's series) brings."""
    large = np.maximum(a, _STIRLING)

    def correction(x: FloatArray) -> FloatArray:
        return np.asarray((1.0 / 12.0 - (1.0 / 360.0 - 1.0 / 1260.0 / x**2) / x**2) / x)

    series = (large + c - 0.5) * np.log1p(c / large) - c + correction(large + c) - correction(large)
    small = np.minimum(a, _STIRLING)
    return np.where(a >= _STIRLING, series, gammaln(small + c) - gammaln(small) - c * np.log(small))


def _index(labels: Sequence[object]) -> tuple[tuple[object, ...], IntArray]:
    names = tuple(dict.fromkeys(labels))
    return names, np.array([names.index(label) for label in labels], dtype=np.int64)
