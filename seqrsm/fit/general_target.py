"""Any model with a log density, made ready for the ensemble sampler.

Parameters with bounds are sampled on an unbounded scale: x = log(v - low) for one bound, the logit of the share of the
interval for two, with the Jacobian. The proposal is a Student-t distribution at the mode with the curvature there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, gammaln

from seqrsm.arrays import FloatArray
from seqrsm.errors import FitError, Problem
from seqrsm.fit.target import Target

_DF = 6.0  # of the proposal: heavier tails than a posterior near normal
_WIDEN = 1.15
_STEP = 1e-4


Complete: TypeAlias = Callable[[FloatArray, np.random.Generator], tuple[tuple[str, ...], FloatArray]]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter and its bounds.

    Attributes
    ----------
    name : str
    start : float
        A likely value, inside the bounds.
    low, high : float
        -inf and inf where there is none.
    """

    name: str
    start: float
    low: float = -np.inf
    high: float = np.inf


@dataclass(frozen=True, slots=True)
class GeneralModel:
    """Parameters and their joint log density with the data.

    Attributes
    ----------
    parameters : tuple of Parameter (d,)
    log_density : callable
        (n, d) parameter values -> (n,) log prior plus log likelihood, up to a constant; -inf where impossible.
    complete : callable, optional
        For parameters that were integrated out: (draws (m, d), generator) -> names and draws (m, c) of all of them,
        each drawn from its exact distribution given the sampled ones.
    """

    parameters: tuple[Parameter, ...]
    log_density: Callable[[FloatArray], FloatArray]
    complete: Complete | None = None

    def natural(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Parameter values (n, d) of unbounded coordinates (n, d), and the log Jacobian (n,)."""
        values, log_jacobian = x.copy(), np.zeros(x.shape[0])
        for j, parameter in enumerate(self.parameters):
            if np.isfinite(parameter.low) and np.isfinite(parameter.high):
                width = parameter.high - parameter.low
                values[:, j] = parameter.low + width * expit(x[:, j])
                log_jacobian += -np.abs(x[:, j]) - 2.0 * np.log1p(np.exp(-np.abs(x[:, j]))) + np.log(width)
            elif np.isfinite(parameter.low):
                values[:, j] = parameter.low + np.exp(x[:, j])
                log_jacobian += x[:, j]
            elif np.isfinite(parameter.high):
                values[:, j] = parameter.high - np.exp(x[:, j])
                log_jacobian += x[:, j]
        return values, log_jacobian

    def unbounded(self, values: FloatArray) -> FloatArray:
        """Coordinates (d,) of parameter values (d,) inside their bounds."""
        x = values.copy()
        for j, p in enumerate(self.parameters):
            if np.isfinite(p.low) and np.isfinite(p.high):
                x[j] = np.log(values[j] - p.low) - np.log(p.high - values[j])
            elif np.isfinite(p.low):
                x[j] = np.log(values[j] - p.low)
            elif np.isfinite(p.high):
                x[j] = np.log(p.high - values[j])
        return x


@dataclass(frozen=True, slots=True)
class StudentProposal:
    """Multivariate Student-t distribution with ``_DF`` degrees of freedom, centre (d,) and scale LL'."""

    centre: FloatArray
    L: FloatArray
    inverse: FloatArray

    @classmethod
    def of(cls, centre: FloatArray, covariance: FloatArray) -> StudentProposal:
        """From a positive definite scale matrix (d, d)."""
        L: FloatArray = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
        return cls(centre, L, np.asarray(np.linalg.inv(L), dtype=np.float64))

    def draw(self, random: Any, n: int) -> FloatArray:
        """Draw (n, d) with a ``numpy.random.RandomState``."""
        normal = random.standard_normal((n, self.centre.size)) @ self.L.T
        scale = np.sqrt(random.chisquare(_DF, size=(n, 1)) / _DF)
        return np.asarray(self.centre + normal / scale)

    def log_density(self, x: FloatArray) -> FloatArray:
        """Normalised log density (n, d) -> (n,)."""
        d = self.centre.size
        square = np.sum(np.square((x - self.centre) @ self.inverse.T), axis=1)
        constant = gammaln(0.5 * (_DF + d)) - gammaln(0.5 * _DF) - 0.5 * d * np.log(_DF * np.pi)
        constant -= np.sum(np.log(np.diagonal(self.L)))
        return np.asarray(constant - 0.5 * (_DF + d) * np.log1p(square / _DF))

    def tuned(self, draws: FloatArray) -> StudentProposal:
        """Same centre and somewhat more than the covariance of ``draws`` (n, d)."""
        return StudentProposal.of(np.mean(draws, axis=0), _WIDEN * np.atleast_2d(np.cov(draws, rowvar=False)))


def general_target(model: GeneralModel) -> Target:
    """Target for the sampler, with its proposal at the mode.

    Raises
    ------
    FitError
        The density is not finite at the starting values.
    """
    d = len(model.parameters)

    def log_prob(x: FloatArray) -> FloatArray:
        with np.errstate(all="ignore"):
            values, log_jacobian = model.natural(x)
            value = model.log_density(values) + log_jacobian
        return np.where(np.isfinite(value), value, -np.inf)

    start = model.unbounded(np.array([parameter.start for parameter in model.parameters]))
    if not np.all(np.isfinite(start)) or not np.isfinite(log_prob(start[None, :])[0]):
        raise FitError(Problem("the posterior density is not finite where it is expected to lie"))
    mode = _mode(log_prob, start)
    covariance = _covariance(log_prob, mode)

    def unpack(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        values, _ = model.natural(x)
        return values, np.ones(len(values)), None

    return Target(log_prob, StudentProposal.of(mode, covariance), False, d, unpack)


def _mode(log_prob: Callable[[FloatArray], FloatArray], start: FloatArray) -> FloatArray:
    steps = _STEP * np.eye(start.size)

    def negative(x: FloatArray) -> tuple[float, FloatArray]:
        values = -log_prob(np.vstack([x, x + steps, x - steps]))
        with np.errstate(invalid="ignore"):  # the search may step where the density is 0
            gradient = (values[1 : start.size + 1] - values[start.size + 1 :]) / (2.0 * _STEP)
        return float(np.minimum(values[0], 1e300)), np.where(np.isfinite(gradient), gradient, 0.0)

    found = minimize(negative, start, jac=True, method="L-BFGS-B", options={"maxiter": 500})
    mode: FloatArray = np.asarray(found.x, dtype=np.float64)
    return mode if np.isfinite(log_prob(mode[None, :])[0]) else start


def _covariance(log_prob: Callable[[FloatArray], FloatArray], mode: FloatArray) -> FloatArray:
    """Inverse of the negative Hessian at the mode, by differences; directions without curvature get a wide step."""
    d = mode.size
    step = 3e-3
    moves = step * np.eye(d)
    pairs = [(a * moves[i] + b * moves[j]) for i in range(d) for j in range(d) for a in (1, -1) for b in (1, -1)]
    values = log_prob(mode + np.array(pairs)).reshape(d, d, 2, 2)
    with np.errstate(invalid="ignore"):
        hessian = (values[:, :, 0, 0] - values[:, :, 0, 1] - values[:, :, 1, 0] + values[:, :, 1, 1]) / (4.0 * step**2)
        precision = -0.5 * (hessian + hessian.T)
    precision = np.where(np.isfinite(precision), precision, np.eye(d))
    eigenvalues, vectors = np.linalg.eigh(precision)
    eigenvalues = np.maximum(eigenvalues, 0.1)
    return np.asarray(_WIDEN * (vectors / eigenvalues) @ vectors.T)
