"""Shape of a fitted quadratic: stationary point, canonical axes, and how much of it each factor accounts for.

Notation: the quadratic in the q numeric factors (coded) is ``c + x'b + x'Bx`` with symmetric B. Eigenvalues smaller
than a share `FLAT` of the largest are taken as flat: the surface then is a ridge, and the
stationary point reported is the one nearest to the centre along it; the exact one is given beside it.

Standard errors of a stationary point are those of its derivatives by the coefficients (the delta method). The point
with flat axes left out is ``-f(B) b / 2`` with f(l) = 1/l, or 0 where flat; of such a function of a matrix the
derivative is ``V [F o (V' dB V)] V'`` with F the divided differences of f at the eigenvalues (Daleckii & Krein 1965).

With the factors varied independently and uniformly over their coded ranges and levels, the fitted surface has a
variance, and it splits into what each factor explains alone and with others (Sobol indices). For a polynomial every
part is a quadratic form of the coefficients, ``Var E[f | x_u] = b' V_u b``, with V_u from products of moments.

References
----------
Sobol (1993), Sensitivity estimates for nonlinear mathematical models, Math. Modelling Comput. Exp. 1, 407-414.
Saltelli et al. (2008), Global sensitivity analysis: the primer, chapter 4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray
from seqrsm.design.factors import CategoricalFactor
from seqrsm.design.quadratic import QuadraticModel, Quadratics
from seqrsm.design.region import ROUNDING, Region

Kind = Literal["maximum", "minimum", "saddle", "ridge", "none"]

FLAT = 0.1
"""Share of the largest eigenvalue, as in R's rsm."""


@dataclass(frozen=True, slots=True)
class CanonicalForm:
    """Canonical analysis of ``c + x'b + x'Bx``."""

    point: FloatArray
    """(q,): stationary point with flat directions left out (minimum norm); nan when the quadratic has no curvature."""
    exact_point: FloatArray
    """(q,): solution of ``2Bx = -b`` with every eigenvalue kept; nan where B is singular to working precision."""
    value: float
    """Value at ``point``."""
    kind: Kind
    """One of "maximum", "minimum" or "saddle" by the signs of the eigenvalues that are not flat; "ridge" when these
    agree in sign but others are flat; "none" without curvature."""
    eigenvalues: FloatArray
    """(q,): in falling order, unrounded."""
    eigenvectors: FloatArray
    """(q, q): columns, largest component positive."""
    flat: BoolArray
    """(q,): which eigenvalues are below that share."""


@dataclass(frozen=True, slots=True)
class StationaryPoint(CanonicalForm):
    """Stationary point of a fitted model at given category levels: the canonical form of its numeric factors.

    ``point`` and ``exact_point`` (k,) are coded, in factor order; category columns hold the level index. Numeric
    entries are nan where the form's are.
    """

    inside_region: bool
    """Inside the bounds and the constraints. Whether a discrete factor's value is one of its levels is not asked:
    canonical analysis treats it as continuous."""
    se: FloatArray
    """(k,): standard errors of ``point``, coded, to first order and with the same axes flat; nan for categorical
    factors, and where nothing is known of errors."""
    exact_value: float
    exact_inside_region: bool
    exact_se: FloatArray
    """The same of ``exact_point``, with no eigenvalue taken as flat."""
    warning: str
    """A sentence when the surface is a ridge or has no curvature; else empty."""


def canonical_form(surface: Quadratics) -> CanonicalForm:
    """Canonical analysis of one quadratic."""
    values, vectors = np.linalg.eigh(surface.quadratic)
    values, vectors = values[::-1].copy(), vectors[:, ::-1].copy()
    q = len(values)
    if q:
        largest = np.argmax(np.abs(vectors), axis=0)
        vectors *= np.where(vectors[largest, np.arange(q)] < 0.0, -1.0, 1.0)
    size = np.abs(values)
    top = float(size.max(initial=0.0))
    singular = size <= q * np.finfo(float).eps * top
    flat: BoolArray = singular | (size < FLAT * top)
    projected = vectors.T @ surface.linear
    if top == 0.0:
        nothing = np.full(q, np.nan)
        return CanonicalForm(nothing, nothing.copy(), float("nan"), "none", values, vectors, flat)
    point: FloatArray = vectors @ np.where(flat, 0.0, -0.5 * projected / np.where(flat, 1.0, values))
    exact: FloatArray = np.full(q, np.nan) if singular.any() else vectors @ (-0.5 * projected / values)
    kept = values[~flat]
    kind: Kind
    if kept.max() > 0.0 > kept.min():
        kind = "saddle"
    elif flat.any():
        kind = "ridge"
    else:
        kind = "maximum" if kept.max() < 0.0 else "minimum"
    return CanonicalForm(point, exact, surface.at(point), kind, values, vectors, flat)


def stationary_point(
    model: QuadraticModel,
    region: Region,
    beta: FloatArray,
    levels: tuple[int, ...] = (),
    variance: Callable[[FloatArray], FloatArray] | None = None,
) -> StationaryPoint:
    """Stationary point and canonical analysis of a fitted model with coded coefficients ``beta`` (p,), in a region.

    ``levels``: index of the level of each categorical factor, in factor order. ``variance`` gives variances (m,) of
    linear functions (m, p) of the coefficients, for standard errors.
    """
    surface = model.forms(beta, levels)
    form = canonical_form(surface)
    point = _full_point(region, form.point, levels)
    exact = _full_point(region, form.exact_point, levels)
    inside, exact_inside = (_inside(region, at) for at in (point, exact))

    def errors(at: FloatArray, flat: BoolArray) -> FloatArray:
        nothing = np.full(len(levels), np.nan)
        if variance is None or not np.all(np.isfinite(at)):
            return _full_point(region, np.full(len(region.numeric), np.nan), nothing)
        slopes = _slopes(model, form, surface.linear, levels, flat)
        return _full_point(region, np.sqrt(np.maximum(variance(slopes), 0.0)), nothing)

    names = [region.names[i] for i in region.numeric]
    return StationaryPoint(
        point=point,
        exact_point=exact,
        value=form.value,
        kind=form.kind,
        eigenvalues=form.eigenvalues,
        eigenvectors=form.eigenvectors,
        flat=form.flat,
        inside_region=inside,
        se=errors(form.point, form.flat),
        exact_value=surface.at(form.exact_point),
        exact_inside_region=exact_inside,
        exact_se=errors(form.exact_point, np.zeros_like(form.flat)),
        warning=_ridge_warning(form, names, level=not np.any(surface.linear)),
    )


def within_error(region: Region, point: FloatArray, se: FloatArray) -> dict[str, tuple[float, float]]:
    """Natural values of the numeric factors a standard error below and above a coded point (k,), by name.

    The error is that of the coded value, hence of the logarithm on a logarithmic scale: no value is below 0 there.
    """
    with np.errstate(over="ignore"):  # a stationary point may lie anywhere
        return {
            factor.name: (float(factor.decode(at - error)), float(factor.decode(at + error)))
            for factor, at, error in zip(region.factors, point.tolist(), se.tolist(), strict=True)
            if not isinstance(factor, CategoricalFactor)
        }


def _slopes(
    model: QuadraticModel, form: CanonicalForm, linear: FloatArray, levels: tuple[int, ...], flat: BoolArray
) -> FloatArray:
    """Derivatives (q, p) of the stationary point with axes left out that are flat, by the coefficients."""
    _, db, dB = model.forms(np.eye(model.p), levels)
    values, V = form.eigenvalues, form.eigenvectors
    f = np.where(flat, 0.0, 1.0 / np.where(flat, 1.0, values))
    gap = values[:, None] - values
    near = np.abs(gap) <= 1e-9 * np.abs(values).max()
    # f' = -1/l^2 where an axis is kept, and so to rounding for two that are hardly apart: -1 / (l m).
    F = np.where(near, -np.outer(f, f), (f[:, None] - f) / np.where(near, 1.0, gap))
    turned = F * (V.T @ dB @ V)  # (p, q, q)
    return np.asarray(-0.5 * V @ (turned @ (V.T @ linear) + db @ V * f).T)


def _full_point(region: Region, numeric: FloatArray, levels: tuple[int, ...] | FloatArray) -> FloatArray:
    point = np.empty(region.k)
    point[list(region.numeric)] = numeric
    point[list(region.categorical)] = levels
    return point


def _inside(region: Region, point: FloatArray) -> bool:
    # Bounds and constraints only; a point computed to lie on a bound may miss it by rounding, and nan lies nowhere.
    inside = bool(np.all(np.abs(point[list(region.numeric)]) <= 1.0 + ROUNDING))
    return inside and bool(region.allowed(point[None, :])[0])


def _ridge_warning(form: CanonicalForm, names: list[str], level: bool) -> str:
    if form.kind == "none":
        if level:
            return "The fitted surface is flat: every setting is equally good."
        return "The fitted surface has no curvature, hence no stationary point; its optimum is at the bounds."
    if not form.flat.any():
        return ""
    axes = []
    for j in np.flatnonzero(form.flat):
        strongest = np.argsort(-np.abs(form.eigenvectors[:, j]))[:2]
        axes.append(" and ".join(names[i] for i in strongest if abs(form.eigenvectors[i, j]) > 0.3))
    share = 100.0 * float(np.abs(form.eigenvalues[form.flat]).max() / np.abs(form.eigenvalues).max())
    which = "this direction" if len(axes) == 1 else "these directions"
    return (
        f"The curvature along {'; '.join(axes)} is at most {share:.2g} % of the largest (ridge threshold "
        f"{100.0 * FLAT:g} %): the response changes little in {which}, in which the stationary point is poorly "
        "determined."
    )


def variance_shares(model: QuadraticModel, beta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shares of the variance of surfaces with coefficients ``beta`` (..., p), such as posterior draws, over the box.

    First (..., k) what a factor explains alone: Var E[f | x_j] / Var f, at most 1 in all; nan where Var f is 0. Then
    (..., k) what would be left if all others were known: this with all of its interactions. Constraints are left out:
    they would make the factors dependent, and shares then have no unique meaning.
    """
    beta = np.asarray(beta, dtype=np.float64)
    means, moments = model.part_moments()
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
    return first, np.maximum(total, 0.0)
