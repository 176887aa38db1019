"""The descent on the largest prediction variance: its slope, and the regions and levels it keeps to."""

from __future__ import annotations

import numpy as np
import pytest

from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.minimax import SoftMaximum
from seqrsm.design.optimal import optimal_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region


def build(*constraints: str, k: int = 3, category: bool = False) -> tuple[QuadraticModel, Region]:
    factors: tuple = tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k))
    factors += (CategoricalFactor("c", ("u", "v", "w")),) if category else ()
    return QuadraticModel(factors), Region(factors, tuple(Constraint(text) for text in constraints))


def engine(model: QuadraticModel, region: Region) -> SoftMaximum:
    return SoftMaximum(model, region, 0.1 * np.eye(model.p), model.matrix(region.candidates(5)))


def soft(model, points, rows, power):
    """The soft maximum written out anew."""
    Z = model.matrix(points)
    D = np.linalg.inv(Z.T @ Z + 0.1 * np.eye(model.p))
    return np.log(np.mean(np.sum((rows @ D) * rows, axis=1) ** power)) / power


@pytest.mark.parametrize("category", [False, True])
@pytest.mark.parametrize("power", [4.0, 64.0])
def test_the_slope_is_that_of_differences(power, category) -> None:
    model, region = build(category=category)
    points = region.sample(model.p + 2, np.random.default_rng(1))
    search = engine(model, region)
    value, slope = search.value(points, power)
    assert slope.shape == (len(points), 3)
    assert value == pytest.approx(soft(model, points, search.places, power), rel=1e-7, abs=1e-7)
    for i, j in ((0, 0), (1, 2), (4, 1)):
        ends = []
        for step in (-1e-5, 1e-5):
            moved = points.copy()
            moved[i, j] += step
            ends.append(soft(model, moved, search.places, power))
        assert slope[i, j] == pytest.approx((ends[1] - ends[0]) / 2e-5, rel=1e-4, abs=1e-7)


@pytest.mark.parametrize(
    "constraints", [("x0 + x1 <= 0.4",), ("x0**2 + x1**2 <= 1.2",), ("x0 + x1 <= 0.1", "x0 + x1 >= -0.1")]
)
def test_runs_stay_in_the_region_and_slide_along_its_edge(constraints) -> None:
    model, region = build(*constraints, k=2)
    search = engine(model, region)
    start = region.sample(10, np.random.default_rng(4))
    points = search.lower(start, 16.0)
    assert np.all(region.feasible(points, tol=1e-9))
    assert soft(model, points, search.places, 16.0) < soft(model, start, search.places, 16.0) - 0.05
    if len(constraints) == 1:
        assert np.count_nonzero(region.slack(points) < 1e-3) >= 2


def test_levels_are_exchanged_on_the_largest_variance() -> None:
    factors = (DiscreteFactor("a", (0.0, 1.0, 2.0)), DiscreteFactor("b", (0.0, 1.0, 2.0)))
    model, region = QuadraticModel(factors), Region(factors)
    design = optimal_design(model, region, 9, "G", seed=0, starts=8)
    # The full factorial is among the designs of nine runs.
    Z = model.matrix(region.candidates(3))
    whole = float(np.max(np.sum((Z @ np.linalg.inv(Z.T @ Z)) * Z, axis=1)))
    assert design.value <= whole * (1.0 + 1e-9)
    assert np.all(region.feasible(design.points))


def test_the_same_seed_gives_the_same_design_and_hits_are_counted() -> None:
    model, region = build(k=2)
    one, other = (optimal_design(model, region, 9, "G", seed=7) for _ in range(2))
    np.testing.assert_array_equal(one.points, other.points)
    assert 1 <= one.hits <= one.starts
