"""How good a design is: efficiencies, prediction variance over the region, conditioning; terms not told apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr, solve_triangular

from seqrsm.arrays import FloatArray
from seqrsm.design import search
from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region

# Optimal values over all continuous designs for the full quadratic in k = 1..7 factors on [-1, 1]^k: max |M|^(1/p) and
# min N tr(W M^-1). Computed by the multiplicative algorithm on the orbits of the 3^k grid; by the equivalence theorem
# (Kiefer & Wolfowitz 1960) they hold to 13 digits. The D values of k = 1, 2 are in closed form 4^(1/3)/3 and Farrell,
# Kiefer & Walbran (1967).
_D_BOUND = (0.5291336839893998, 0.4745937662, 0.4744782067, 0.4885696454, 0.5068587164, 0.5259919962, 0.5446948684)
_I_BOUND = (2.1333333333333333, 3.586215760, 5.275409587, 7.163453067, 9.232581693, 11.473244551, 13.879544375)

_TOLERANCE = 1e-8
_SAMPLE = 10_000
_SEED = 71_993
_SEQUENCE, _ENOUGH, _MOMENTS_SEED = 1 << 17, 1000, 33_391


@dataclass(frozen=True, slots=True)
class DesignReport:
    """Figures of a design of N runs."""

    d_efficiency: float | None
    i_efficiency: float | None
    """Against the best continuous design, where tabulated and all runs lie in the region."""
    d_value: float
    a_value: float
    i_value: float
    """|Z'Z|^(1/p) / N; N tr((Z'Z)^-1) / p; mean scaled prediction variance N z'(Z'Z)^-1 z over the region."""
    condition_number: float
    """Of the column-scaled model matrix."""
    n_distinct: int
    df_pure_error: int
    """Different settings, and N less that."""
    leverage: FloatArray
    """(N,): diagonal of the hat matrix."""
    fraction_of_design_space: FloatArray
    """(101,): scaled prediction variance that 0, 1 ... 100 % of the region does not exceed."""


def continuous_bound(model: QuadraticModel, criterion: str) -> float | None:
    """Return max |M|^(1/p) (``"D"``) or min N tr(W M^-1) (``"I"``) over continuous designs, or None."""
    k = model.k
    if model.order != 2 or not 1 <= k <= 7 or not all(isinstance(f, ContinuousFactor) for f in model.factors):
        return None
    return {"D": _D_BOUND, "I": _I_BOUND}[criterion][k - 1]


def condition(Z: FloatArray) -> float:
    """Condition number of a model matrix (n, p) whose columns are scaled to length one."""
    return float(np.linalg.cond(Z / np.linalg.norm(Z, axis=0)))


def inestimable_terms(model: QuadraticModel, points: FloatArray, tolerance: float = _TOLERANCE) -> tuple[str, ...]:
    """Names of terms of which these points (n, k) leave no more than such a share beside the terms before them."""
    Z = model.matrix(points)
    kept: list[int] = []
    found = []
    for column, term in enumerate(model.terms):
        z = Z[:, column]
        rest = z - Z[:, kept] @ np.linalg.lstsq(Z[:, kept], z, rcond=None)[0] if kept else z
        if np.linalg.norm(rest) <= tolerance * max(float(np.linalg.norm(z)), 1e-300):
            found.append(term.name)
        else:
            kept.append(column)
    return tuple(found)


def prediction_variance(model: QuadraticModel, points: FloatArray, at: FloatArray) -> FloatArray:
    """Scaled prediction variance N z'(Z'Z)^-1 z at points ``at`` (m, k), by QR; RSL TR 380-1 eq. (2-17) over sigma^2/N.

    The design ``points`` (n, k) can estimate every term.
    """
    Z = model.matrix(points)
    R = qr(Z, mode="r")[0][: model.p]
    half = solve_triangular(R, model.matrix(at).T, trans="T")
    variance: FloatArray = Z.shape[0] * np.sum(half**2, axis=0)
    return variance


def evaluate_design(model: QuadraticModel, region: Region, points: FloatArray) -> DesignReport:
    """Figures of a design that can estimate every term: see :class:`DesignReport`.

    Mean variance from the region's moments; the fraction-of-design-space curve from 10000 random points (Zahran,
    Anderson-Cook & Myers 2003, J. Quality Technology 35, 377-386), its end from a cover of the region, too.
    """
    Z = model.matrix(points)
    n, p = Z.shape
    distinct = np.unique(np.round(points, 9), axis=0).shape[0]
    R = qr(Z, mode="r")[0][:p]
    inverse_root = solve_triangular(R, np.eye(p))
    inverse = inverse_root @ inverse_root.T
    d_value = float(np.exp(2.0 * np.mean(np.log(np.abs(np.diag(R)))))) / n
    i_value = n * float(np.sum(inverse * region_moments(model, region)))
    sample = region.sample(_SAMPLE, np.random.default_rng(_SEED))
    curve = np.quantile(prediction_variance(model, points, sample), np.linspace(0.0, 1.0, 101))
    # Random points hardly come near a corner, where the variance is largest.
    curve[-1] = max(curve[-1], np.max(prediction_variance(model, points, region.candidates())))
    d_bound, i_bound = continuous_bound(model, "D"), continuous_bound(model, "I")
    comparable = region.is_box and bool(np.all(region.feasible(points)))
    return DesignReport(
        d_efficiency=d_value / d_bound if d_bound is not None and comparable else None,
        i_efficiency=i_bound / i_value if i_bound is not None and comparable else None,
        d_value=d_value,
        a_value=n * float(np.trace(inverse)) / p,
        i_value=i_value,
        condition_number=condition(Z),
        n_distinct=distinct,
        df_pure_error=n - distinct,
        leverage=np.sum((Z @ inverse_root) ** 2, axis=1),
        fraction_of_design_space=curve,
    )


def region_moments(model: QuadraticModel, region: Region) -> FloatArray:
    """Return the mean of z(x) z(x)' over the region, shape (p, p).

    Coded continuous factors are uniform on [-1, 1], levels of discrete and categorical factors equally likely. Exact
    for a box (E x^2 = 1/3, E x^4 = 1/5, E x^2 y^2 = 1/9); for a constrained region the mean over the feasible part
    of an even sequence of 131072 points, relative error about 1e-3.
    """
    if region.is_box:
        return np.asarray(np.prod(model.part_moments()[1], axis=0))
    points = search.low_discrepancy(region.axes, _SEQUENCE)
    points = points[region.slack(points) >= 0.0]
    if points.shape[0] < _ENOUGH:
        points = region.sample(_ENOUGH, np.random.default_rng(_MOMENTS_SEED))
    Z = model.matrix(points)
    W: FloatArray = Z.T @ Z / points.shape[0]
    return W
