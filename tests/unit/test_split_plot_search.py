"""The compiled exchange in plots: its value, its local optima, and factors of every kind."""

from __future__ import annotations

import numpy as np
import pytest

from seqrsm.design import kernels_plots as kernels
from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.design.split_plot import FIXED_BLOCKS, _improved, _Plots, plot_information, plot_sizes, split_plot_design

FACTORS = (
    ContinuousFactor("a", -1.0, 1.0),
    DiscreteFactor("d", (0.0, 1.0, 3.0)),
    CategoricalFactor("c", ("u", "v", "w")),
)
STEPS = np.array([-1.0, 0.0, 1.0])


def log_det(model, points, plots, eta) -> float:
    """By the covariance of the runs, not by the sums that the search works on."""
    Z = model.matrix(points)
    V = np.eye(len(plots)) + eta * (plots[:, None] == plots[None, :])
    return float(np.linalg.slogdet(Z.T @ np.linalg.solve(V, Z))[1])


@pytest.mark.parametrize("hard", [(), (0,), (2,), (0, 1)])
@pytest.mark.parametrize("eta", [0.0, 0.3, 10.0])
def test_the_exchange_ends_at_its_value_where_no_level_gains(hard, eta) -> None:
    model, region = QuadraticModel(FACTORS), Region(FACTORS)
    plots = plot_sizes(17, 6)
    engine = _Plots(model, region, plots, hard, eta)
    G = model.base(engine.start(1, np.random.default_rng(3))[0])
    value = _improved(G, np.empty((17, model.p)), eta, engine.plan())
    points = engine.from_base(G)
    assert value == pytest.approx(log_det(model, points, plots, eta), abs=1e-8)
    np.testing.assert_array_equal(model.base(points), G)
    for plot in range(6):
        members = np.flatnonzero(plots == plot)
        for j, axis in enumerate((STEPS, *region.axes[1:])):
            for runs in [members] if j in hard else members[:, None]:
                for level in axis:
                    other = points.copy()
                    other[runs, j] = level
                    assert log_det(model, other, plots, eta) <= value + 1e-6
    for j in hard:
        assert all(np.ptp(points[plots == plot, j]) == 0.0 for plot in range(6))


def test_a_singular_start_is_told_and_a_ridge_leads_out_of_it() -> None:
    model, region = QuadraticModel(FACTORS[:1]), Region(FACTORS[:1])
    engine = _Plots(model, region, plot_sizes(6, 2), (), 1.0)
    G, F = model.base(np.zeros((6, 1))), np.empty((6, 3))
    assert kernels.exchange(G, F, 1.0, 0.0, engine.plan(), STEPS, 0.0, 20) == -np.inf
    assert np.isfinite(_improved(G, F, 1.0, engine.plan()))


@pytest.mark.parametrize("constraint", [(), ("a + 0.2 * d <= 1.0",)])
def test_designs_keep_to_levels_plots_and_constraints(constraint) -> None:
    model = QuadraticModel(FACTORS)
    region = Region(FACTORS, tuple(Constraint(text) for text in constraint))
    plots = plot_sizes(20, 7)
    points = split_plot_design(model, region, plots, (0,), seed=5)
    assert np.all(region.feasible(points))
    assert all(np.ptp(points[plots == plot, 0]) == 0.0 for plot in range(7))
    np.testing.assert_array_equal(points, split_plot_design(model, region, plots, (0,), seed=5))


def test_fixed_blocks_are_the_limit_of_a_large_ratio() -> None:
    """For large eta, log|M| is that of the runs after their blocks' means are taken out, and that of the intercept."""
    model, region = QuadraticModel(FACTORS[:2]), Region(FACTORS[:2])
    plots = plot_sizes(14, 3)
    points = split_plot_design(model, region, plots, (), FIXED_BLOCKS, seed=1)
    Z = np.column_stack([plots == b for b in range(3)]).astype(float)
    X = model.matrix(points)[:, 1:]
    within = X - Z @ np.linalg.lstsq(Z, X, rcond=None)[0]
    found = np.linalg.slogdet(within.T @ within)[1]
    better = 0
    for seed in range(200):
        other = model.matrix(region.sample(14, np.random.default_rng(seed)))[:, 1:]
        other = other - Z @ np.linalg.lstsq(Z, other, rcond=None)[0]
        better += np.linalg.slogdet(other.T @ other)[1] > found
    assert better == 0
    M = plot_information(model.matrix(points), plots, FIXED_BLOCKS)
    assert np.linalg.slogdet(M)[1] == pytest.approx(found + np.log(3.0 / FIXED_BLOCKS), abs=1e-3)
