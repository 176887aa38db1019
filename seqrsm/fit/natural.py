"""Coefficients in natural units: the same polynomial, with each coded factor written out.

A coded factor is ``a + b x`` with ``x`` the natural value, or its log10 where the factor has a log scale, so the
coefficients in ``x`` are a linear map of the coded ones, ``beta_nat = T beta``. Estimates, standard errors and
intervals are what the fit predicts at the rows of T, with no further approximation: Cov(beta_nat) = s^2 T C T'.
"""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design.factors import CategoricalFactor, log_ratio, span
from seqrsm.design.quadratic import QuadraticModel


def natural_transform(model: QuadraticModel) -> FloatArray:
    """Matrix T (p, p) from coded to natural coefficients, ``beta_nat = T beta``.

    The natural polynomial is in the value of each numeric factor, or in log10 of it for a log scale; contrasts of
    categorical factors stay as they are. Every product that appears is a term of the model, since the model holds with
    each product all of its factors.
    """
    q = len(model.numeric)
    n_base = 1 + q + sum(len(columns) for i, columns in enumerate(model.columns) if i in model.categorical)
    base = np.eye(n_base)  # base column in coded units = row of this times the natural base columns
    for j, index in enumerate(model.numeric, start=1):
        factor = model.factors[index]
        assert not isinstance(factor, CategoricalFactor)
        low, high = span(factor)
        width = high - low
        if factor.scale == "log":
            width = float(log_ratio(high, low)) / np.log(10.0)
            low, high = np.log10(low), np.log10(high)
        base[j, 0], base[j, j] = -(high + low) / width, 2.0 / width
    place = {
        (min(a, b), max(a, b)): t
        for t, (a, b) in enumerate(zip(model.first.tolist(), model.second.tolist(), strict=True))
    }
    T = np.zeros((model.p, model.p))
    for t, (a, b) in enumerate(zip(model.first.tolist(), model.second.tolist(), strict=True)):
        for i in np.flatnonzero(base[a]).tolist():
            for j in np.flatnonzero(base[b]).tolist():
                T[place[min(i, j), max(i, j)], t] += base[a, i] * base[b, j]
    return T
