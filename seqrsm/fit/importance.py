"""How much of the surface each factor accounts for: variance shares over the region's box.

With the factors varied independently and uniformly over their coded ranges and levels, the fitted surface has a
variance, and it splits into what each factor explains alone and with others (Sobol indices). For a polynomial every
part is a quadratic form of the coefficients, ``Var E[f | x_u] = b' V_u b``, with V_u from products of moments.

References
----------
Sobol (1993), Sensitivity estimates for nonlinear mathematical models, Math. Modelling Comput. Exp. 1, 407-414.
Saltelli et al. (2008), Global sensitivity analysis: the primer, chapter 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, Factor
from seqrsm.design.quadratic import QuadraticModel


@dataclass(frozen=True, slots=True)
class VarianceShares:
    """Variance shares of one surface, or of many.

    Attributes
    ----------
    factors : tuple of str (k,)
    first_order : ndarray (..., k)
        Share that a factor explains alone: Var E[f | x_j] / Var f. They sum to at most 1.
    total : ndarray (..., k)
        Share that would be left if all other factors were known: first order plus all of its interactions.
    variance : ndarray (...)
        Of the surface over the box, squared score units; shares are nan where it is 0.
    """

    factors: tuple[str, ...]
    first_order: FloatArray
    total: FloatArray
    variance: FloatArray


def variance_shares(model: QuadraticModel, beta: FloatArray) -> VarianceShares:
    """Variance shares of the surfaces with coefficients ``beta`` (..., p), such as posterior draws.

    Constraints are left out: they would make the factors dependent, and shares then have no unique meaning.
    """
    beta = np.asarray(beta, dtype=np.float64)
    means, moments = _parts(model)
    centre = np.prod(means, axis=0)

    def form(inside: set[int]) -> FloatArray:
        """B' V_u b: moments for the factors of u, products of means for the others."""
        V = np.ones((model.p, model.p))
        for j in range(model.k):
            V *= moments[j] if j in inside else np.outer(means[j], means[j])
        V -= np.outer(centre, centre)
        return np.asarray(np.maximum(np.sum((beta @ V) * beta, axis=-1), 0.0), dtype=np.float64)

    everything = set(range(model.k))
    variance = form(everything)
    # What rounding leaves of a constant surface is no variance.
    flat = variance <= 1e-24 * np.sum(np.square(beta), axis=-1)
    scale = np.where(flat, np.nan, variance)
    first = np.stack([form({j}) / scale for j in range(model.k)], axis=-1)
    total = np.stack([1.0 - form(everything - {j}) / scale for j in range(model.k)], axis=-1)
    names = tuple(factor.name for factor in model.factors)
    return VarianceShares(names, first, np.maximum(total, 0.0), np.where(flat, 0.0, variance))


def _parts(model: QuadraticModel) -> tuple[FloatArray, FloatArray]:
    """Mean (k, p) of each factor's part of each term, and mean product (k, p, p) of its parts of two terms."""
    means, moments = np.ones((model.k, model.p)), np.ones((model.k, model.p, model.p))
    for j, (factor, columns) in enumerate(zip(model.factors, model.columns, strict=True)):
        part = np.zeros(model.p, dtype=np.intp)  # which function of this factor a term holds
        for column in (model.first, model.second):
            mine = (column >= columns.start) & (column < columns.stop)
            part[mine] += column[mine] - columns.start + 1
        of = _moments(factor)
        means[j], moments[j] = of[0, part], of[np.ix_(part, part)]
    return means, moments


def _moments(factor: Factor) -> FloatArray:
    """Mean products of the factor's functions: 1, x, x^2 or 1 and its contrasts."""
    if isinstance(factor, ContinuousFactor):
        power = np.add.outer(np.arange(3), np.arange(3))
        return np.where(power % 2 == 0, 1.0 / (power + 1.0), 0.0)
    if isinstance(factor, CategoricalFactor):
        functions = np.column_stack([np.ones(len(factor.levels)), factor.contrasts])
    else:
        functions = factor.coded_levels[:, None] ** np.arange(3)
    return np.asarray(functions.T @ functions / functions.shape[0])
