"""The second-order model and its matrix.

RSL TR 380-1 eq. (2-2) to (2-5) with every pair of factors counted once (the printed double sum counts it twice, which
makes Z'Z singular). A categorical factor with c levels has c - 1 sum-to-zero contrasts, their products with the other
factors, and no square.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor, Factor, OfFactors

TermKind: TypeAlias = Literal["intercept", "linear", "category", "interaction", "square"]


@dataclass(frozen=True, slots=True)
class Term:
    """Column of the model matrix."""

    name: str
    """``"intercept"``, ``"frequency"``, ``"frequency^2"``, ``"frequency:resolution"``, ``"polarization[VV]"``,
    ``"polarization[VV]:frequency"``."""

    kind: TermKind
    factors: tuple[str, ...]
    """Names of the factors in it; none for the intercept."""


class Quadratics(NamedTuple):
    """Quadratics ``c + x'b + x'Bx`` in q coordinates: constants (m,), b (m, q), symmetric B (m, q, q); or one: no m."""

    constant: FloatArray
    linear: FloatArray
    quadratic: FloatArray

    def take(self, rows: int | IntArray | slice) -> Quadratics:
        """Some of them, or one."""
        return Quadratics(*(part[rows] for part in self))

    def values(self, points: FloatArray) -> FloatArray:
        """Values (m, n), each at its own points (m, n, q)."""
        values: FloatArray = self.constant[:, None] + (points @ self.linear[:, :, None])[..., 0]
        values += np.sum((points @ self.quadratic) * points, axis=-1)
        return values

    def at(self, x: FloatArray) -> float:
        """Value of one at a point (q,)."""
        return float(self.constant + x @ self.linear + x @ self.quadratic @ x)


@dataclass(frozen=True, slots=True)
class QuadraticModel(OfFactors):
    """First- or second-order polynomial in coded factors.

    Every term is a product of two base columns: column 0 is one, then come the numeric factors and the contrasts of
    the categorical ones. ``first`` and ``second`` name the two; the exchange kernels work on them directly.
    """

    factors: tuple[Factor, ...]
    """In the order of the columns of the points."""
    order: int = 2
    """1: intercept, linear terms and contrasts. 2: products of two and squares as well; a factor of two discrete values
    has no square, as it would repeat the intercept."""
    terms: tuple[Term, ...] = field(init=False, repr=False, compare=False)
    """Intercept, linear in factor order, contrasts, interactions, squares."""
    first: IntArray = field(init=False, repr=False, compare=False)
    second: IntArray = field(init=False, repr=False, compare=False)
    """(p,): base columns whose product is the term."""

    def __post_init__(self) -> None:
        products = _products(self.factors, self.columns, self.order)
        object.__setattr__(self, "terms", tuple(term for term, _, _ in products))
        object.__setattr__(self, "first", np.array([a for _, a, _ in products], dtype=np.int64))
        object.__setattr__(self, "second", np.array([b for _, _, b in products], dtype=np.int64))

    @property
    def name(self) -> str:
        """What it is called in results."""
        return "quadratic" if self.order == 2 else "first-order model"

    @property
    def p(self) -> int:
        """Number of terms."""
        return len(self.terms)

    @property
    def term_names(self) -> tuple[str, ...]:
        """Names of the terms, in column order."""
        return tuple(term.name for term in self.terms)

    @property
    def columns(self) -> tuple[range, ...]:
        """Base columns of each factor: one for a numeric factor, c - 1 for a categorical one."""
        columns, number, contrast = [], 1, 1 + len(self.numeric)
        for factor in self.factors:
            if isinstance(factor, CategoricalFactor):
                columns.append(range(contrast, contrast + len(factor.levels) - 1))
                contrast += len(factor.levels) - 1
            else:
                columns.append(range(number, number + 1))
                number += 1
        return tuple(columns)

    def base(self, points: FloatArray) -> FloatArray:
        """Base columns (n, m) of coded points (n, k): one, numeric factors, contrasts; ValueError of no such level."""
        points = np.atleast_2d(np.asarray(points, dtype=np.float64))
        columns = [np.ones((points.shape[0], 1)), points[:, list(self.numeric)]]
        for i in self.categorical:
            factor = self.factors[i]
            assert isinstance(factor, CategoricalFactor)
            index = points[:, i].astype(np.intp)
            if np.any(index != points[:, i]) or np.any(index < 0) or np.any(index >= len(factor.levels)):
                raise ValueError(f"column {i} holds a value that is no level index of '{factor.name}'")
            columns.append(factor.contrasts[index])
        return np.hstack(columns)

    def matrix(self, points: FloatArray) -> FloatArray:
        """Model matrix Z (n, p) of coded points (n, k), RSL TR 380-1 eq. (2-4)."""
        base = self.base(points)
        return base[:, self.first] * base[:, self.second]

    def part_moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean (k, p) of each factor's part of each term, and mean product (k, p, p) of its parts of two terms.

        Coded continuous factors are uniform on [-1, 1], levels of discrete and categorical factors equally likely.
        """
        means, moments = np.ones((self.k, self.p)), np.ones((self.k, self.p, self.p))
        for j, (factor, columns) in enumerate(zip(self.factors, self.columns, strict=True)):
            part = np.zeros(self.p, dtype=np.intp)  # which function of this factor a term holds
            for column in (self.first, self.second):
                mine = (column >= columns.start) & (column < columns.stop)
                part[mine] += column[mine] - columns.start + 1
            of = _moments(factor)
            means[j], moments[j] = of[0, part], of[np.ix_(part, part)]
        return means, moments

    def forms(self, beta: FloatArray, levels: tuple[int, ...] = ()) -> Quadratics:
        """The quadratic in the q numeric factors at given categorical levels.

        ``beta`` (..., p) are coefficients in the order of ``terms``; ``levels`` the index of the level of each
        categorical factor, in the order of ``categorical``.
        """
        beta = np.asarray(beta, dtype=np.float64)
        point = np.zeros((1, self.k))
        point[0, list(self.categorical)] = levels
        fixed = self.base(point)[0]
        q = len(self.numeric)
        c, b, B = np.zeros(beta.shape[:-1]), np.zeros((*beta.shape[:-1], q)), np.zeros((*beta.shape[:-1], q, q))
        for t, (i, j) in enumerate(zip(self.first, self.second, strict=True)):
            free = [int(column) - 1 for column in (i, j) if 1 <= column <= q]
            scale = np.prod([fixed[column] for column in (i, j) if not 1 <= column <= q])
            value = scale * beta[..., t]
            if not free:
                c += value
            elif len(free) == 1:
                b[..., free[0]] += value
            else:
                B[..., free[0], free[1]] += 0.5 * value
                B[..., free[1], free[0]] += 0.5 * value
        return Quadratics(c, b, B)

    def factor_terms(self, name: str) -> IntArray:
        """Return the indices of all terms that hold the factor ``name``, for RSL TR 380-1 eq. (2-14)."""
        return np.array([t for t, term in enumerate(self.terms) if name in term.factors], dtype=np.int64)


def _products(factors: tuple[Factor, ...], places: tuple[range, ...], order: int) -> list[tuple[Term, int, int]]:
    """Terms in column order, each with the two base columns whose product it is."""
    numeric = [f for f in factors if not isinstance(f, CategoricalFactor)]
    columns: dict[str, list[tuple[str, int]]] = {}
    for factor, place in zip(factors, places, strict=True):
        levels = [f"[{level}]" for level in factor.levels] if isinstance(factor, CategoricalFactor) else [""]
        columns[factor.name] = [(f"{factor.name}{level}", i) for level, i in zip(levels, place, strict=False)]
    products = [(Term("intercept", "intercept", ()), 0, 0)]
    products += [(Term(f.name, "linear", (f.name,)), 0, columns[f.name][0][1]) for f in numeric]
    for factor in factors:
        if isinstance(factor, CategoricalFactor):
            products += [(Term(name, "category", (factor.name,)), 0, i) for name, i in columns[factor.name]]
    if order == 1:
        return products
    for left, right in itertools.combinations(factors, 2):
        # The contrast comes first in the name: "polarization[VV]:frequency".
        swapped = isinstance(right, CategoricalFactor) and not isinstance(left, CategoricalFactor)
        a, b = (right, left) if swapped else (left, right)
        products += [
            (Term(f"{name_a}:{name_b}", "interaction", (a.name, b.name)), i, j)
            for name_a, i in columns[a.name]
            for name_b, j in columns[b.name]
        ]
    for factor in numeric:
        if not (isinstance(factor, DiscreteFactor) and len(factor.values) == 2):
            i = columns[factor.name][0][1]
            products.append((Term(f"{factor.name}^2", "square", (factor.name,)), i, i))
    return products


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
