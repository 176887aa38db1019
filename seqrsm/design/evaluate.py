"""How good a design is: efficiencies, prediction variance, conditioning, terms that cannot be told apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr, solve_triangular

from seqrsm.arrays import FloatArray
from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.moments import region_moments
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import DesignError, Problem

# Optimal values over all continuous designs for the full quadratic in k = 1..7 factors on [-1, 1]^k: max |M|^(1/p) and
# min N tr(W M^-1). Computed by the multiplicative algorithm on the orbits of the 3^k grid; by the equivalence theorem
# (Kiefer & Wolfowitz 1960) they hold to 13 digits. The D values of k = 1, 2 are in closed form 4^(1/3)/3 and Farrell,
# Kiefer & Walbran (1967).
_D_BOUND = (0.5291336839893998, 0.4745937662, 0.4744782067, 0.4885696454, 0.5068587164, 0.5259919962, 0.5446948684)
_I_BOUND = (2.1333333333333333, 3.586215760, 5.275409587, 7.163453067, 9.232581693, 11.473244551, 13.879544375)

_ALIAS_TOLERANCE = 1e-8
_SAMPLE = 10_000
_SEED = 71_993


@dataclass(frozen=True, slots=True)
class DesignReport:
    """Figures of a design of N runs.

    Attributes
    ----------
    n_runs, n_terms, rank : int
        N, p, and the rank of the model matrix.
    inestimable : tuple of str
        Terms that are combinations of the others at these runs.
    aliases : tuple of str
        For each of them the combination, as in ``"x^2 = +1 intercept"``.
    condition_number : float
        Of the column-scaled model matrix; inf where the rank is short.
    d_value, a_value, i_value, g_value : float
        |Z'Z|^(1/p) / N; N tr((Z'Z)^-1) / p; mean and largest scaled prediction variance N z'(Z'Z)^-1 z over the region;
        nan where the rank is short.
    d_efficiency, i_efficiency : float or None
        Against the best continuous design, where tabulated.
    g_efficiency : float
        p over the largest scaled prediction variance, in (0, 1].
    fraction_of_design_space : ndarray (101,)
        Scaled prediction variance that 0, 1 ... 100 % of the region does not exceed.
    leverage : ndarray (N,)
        Diagonal of the hat matrix.
    n_distinct, df_pure_error : int
        Different settings, and N less that.
    """

    n_runs: int
    n_terms: int
    rank: int
    inestimable: tuple[str, ...]
    aliases: tuple[str, ...]
    condition_number: float
    d_value: float
    a_value: float
    i_value: float
    g_value: float
    d_efficiency: float | None
    i_efficiency: float | None
    g_efficiency: float
    fraction_of_design_space: FloatArray
    leverage: FloatArray
    n_distinct: int
    df_pure_error: int


def continuous_bound(model: QuadraticModel, criterion: str) -> float | None:
    """Return max |M|^(1/p) (``"D"``) or min N tr(W M^-1) (``"I"``) over continuous designs, or None."""
    k = model.k
    if model.order != 2 or not 1 <= k <= 7 or not all(isinstance(f, ContinuousFactor) for f in model.factors):
        return None
    return {"D": _D_BOUND, "I": _I_BOUND}[criterion][k - 1]


def condition(Z: FloatArray) -> tuple[float, int]:
    """Condition number and rank of a model matrix (n, p) after scaling its columns to length one."""
    norms = np.linalg.norm(Z, axis=0)
    scaled = Z / np.where(norms > 0.0, norms, 1.0)
    values = np.linalg.svd(scaled, compute_uv=False)
    rank = int(np.count_nonzero(values > _ALIAS_TOLERANCE * values[0])) if values.size and values[0] > 0.0 else 0
    full = rank == Z.shape[1]
    return (float(values[0] / values[-1]) if full else np.inf), rank


def inestimable_terms(model: QuadraticModel, points: FloatArray) -> tuple[str, ...]:
    """Names of terms that are, at these points (n, k), combinations of terms before them."""
    return tuple(name for name, _ in _dependences(model, points))


def _dependences(model: QuadraticModel, points: FloatArray) -> list[tuple[str, FloatArray]]:
    """Terms in model order that add nothing to those before them, each with its coefficients (p,) on these."""
    Z = model.matrix(points)
    kept: list[int] = []
    found: list[tuple[str, FloatArray]] = []
    for column in range(model.p):
        z = Z[:, column]
        coefficients = np.zeros(model.p)
        rest = z
        if kept:
            solution = np.linalg.lstsq(Z[:, kept], z, rcond=None)[0]
            coefficients[kept] = solution
            rest = z - Z[:, kept] @ solution
        if np.linalg.norm(rest) <= _ALIAS_TOLERANCE * max(float(np.linalg.norm(z)), 1e-300):
            found.append((model.terms[column].name, coefficients))
        else:
            kept.append(column)
    return found


def alias_relations(model: QuadraticModel, points: FloatArray) -> tuple[str, ...]:
    """Each inestimable term written as a combination of the others, as in ``"x^2 = +1 intercept"``."""
    relations = []
    for name, coefficients in _dependences(model, points):
        parts = [
            f"{value:+.4g} {term.name}"
            for value, term in zip(coefficients, model.terms, strict=True)
            if abs(value) > 1e-6
        ]
        relations.append(f"{name} = {' '.join(parts) or '0'}")
    return tuple(relations)


def prediction_variance(model: QuadraticModel, points: FloatArray, at: FloatArray) -> FloatArray:
    """Scaled prediction variance N z'(Z'Z)^-1 z at points ``at`` (m, k), by QR; RSL TR 380-1 eq. (2-17) over sigma^2/N.

    Raises
    ------
    DesignError
        Naming the terms that the design cannot estimate.
    """
    Z = model.matrix(points)
    _, rank = condition(Z)
    if rank < model.p:
        names = ", ".join(inestimable_terms(model, points))
        raise DesignError(Problem(f"the design cannot estimate {names}", "Add runs, or leave the terms out."))
    R = qr(Z, mode="r")[0][: model.p]
    half = solve_triangular(R, model.matrix(at).T, trans="T")
    variance: FloatArray = Z.shape[0] * np.sum(half**2, axis=0)
    return variance


def evaluate_design(model: QuadraticModel, region: Region, points: FloatArray) -> DesignReport:
    """Figures of any design: see :class:`DesignReport`.

    The largest prediction variance is looked for at the candidates of the region and improved by exact coordinate
    ascent, as it is a quartic in each coordinate; mean variance from the region's moments; the fraction-of-design-space
    curve from 10000 random points (Zahran, Anderson-Cook & Myers 2003, J. Quality Technology 35, 377-386).
    """
    Z = model.matrix(points)
    n, p = Z.shape
    number, rank = condition(Z)
    distinct = np.unique(np.round(points, 9), axis=0).shape[0]
    if rank < p:
        nan = float("nan")
        lost = inestimable_terms(model, points)
        return DesignReport(
            n, p, rank, lost, alias_relations(model, points), number, nan, nan, nan, nan, None, None, nan,
            np.full(101, nan), np.full(n, nan), distinct, n - distinct,
        )  # fmt: skip
    R = qr(Z, mode="r")[0][:p]
    inverse_root = solve_triangular(R, np.eye(p))
    inverse = inverse_root @ inverse_root.T
    d_value = float(np.exp(2.0 * np.mean(np.log(np.abs(np.diag(R)))))) / n
    i_value = n * float(np.sum(inverse * region_moments(model, region)))
    g_value = n * _largest_variance(model, region, inverse)
    sample = region.sample(_SAMPLE, np.random.default_rng(_SEED))
    curve = np.quantile(prediction_variance(model, points, sample), np.linspace(0.0, 1.0, 101))
    d_bound, i_bound = continuous_bound(model, "D"), continuous_bound(model, "I")
    return DesignReport(
        n_runs=n,
        n_terms=p,
        rank=rank,
        inestimable=(),
        aliases=(),
        condition_number=number,
        d_value=d_value,
        a_value=n * float(np.trace(inverse)) / p,
        i_value=i_value,
        g_value=g_value,
        d_efficiency=d_value / d_bound if d_bound is not None and region.is_box else None,
        i_efficiency=i_bound / i_value if i_bound is not None and region.is_box else None,
        g_efficiency=p / g_value,
        fraction_of_design_space=curve,
        leverage=np.sum((Z @ inverse_root) ** 2, axis=1),
        n_distinct=distinct,
        df_pure_error=n - distinct,
    )


def _largest_variance(model: QuadraticModel, region: Region, inverse: FloatArray) -> float:
    """Largest z'(Z'Z)^-1 z over the region: best candidates, then coordinate ascent along feasible intervals."""
    points = region.candidates(limit=20_000)
    rows = model.matrix(points)
    values = np.einsum("ij,jk,ik->i", rows, inverse, rows)
    points = points[np.argsort(-values, kind="stable")[:200]].copy()
    best = float(values.max())
    for _ in range(20):
        before = best
        for j in region.continuous:
            spans, counts = region.line_intervals_of(points, j)
            best = max(best, _ascend(model, inverse, points, j, spans, counts))
        if best <= before * (1.0 + 1e-12):
            break
    return best


def _ascend(
    model: QuadraticModel, inverse: FloatArray, points: FloatArray, j: int, spans: FloatArray, counts: np.ndarray
) -> float:
    """Move coordinate j of every point to the largest variance on its line, in place; returns the largest of all."""
    # A quartic through five of its values; exact but for rounding.
    nodes = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    lines = np.repeat(points[:, None, :], nodes.size, axis=1)
    lines[:, :, j] = nodes
    rows = model.matrix(lines.reshape(-1, model.k))
    values = np.einsum("ij,jk,ik->i", rows, inverse, rows).reshape(-1, nodes.size)
    coefficients = np.linalg.solve(np.vander(nodes, 5), values.T).T
    largest = -np.inf
    for i, polynomial in enumerate(coefficients):
        roots = np.roots(np.polyder(polynomial))
        real = roots.real[np.abs(roots.imag) < 1e-9]
        for low, high in spans[i, : counts[i]]:
            places = np.concatenate([[low, high], real[(real > low) & (real < high)]])
            heights = np.polyval(polynomial, places)
            top = int(np.argmax(heights))
            if heights[top] > np.polyval(polynomial, points[i, j]):
                points[i, j] = places[top]
            largest = max(largest, float(heights[top]))
    return largest
