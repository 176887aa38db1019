"""The fitted region: it stays on a quadratic, shrinks and moves on what is none, and depends on the runs alone."""

from __future__ import annotations

import numpy as np
import pytest

from seqrsm.campaign.next_runs import rounded_settings
from seqrsm.decide import moving
from seqrsm.decide.discrepancy import find_discrepancy, likely_optimum
from seqrsm.decide.moving import Box, Plan, box_around, evidence_limit, needed_runs, sub_region, walk, whole_box
from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region

LOG = ContinuousFactor("frequency", 1.0, 100.0, "GHz", "log")
LINEAR = ContinuousFactor("angle", 20.0, 60.0, "deg")
PAIR = Region((LOG, LINEAR))


def hump(x: np.ndarray, at: tuple[float, float] = (0.5, 0.3)) -> np.ndarray:
    return 40 * np.exp(-np.sum((x - np.array(at)) ** 2, axis=1) / 0.2)


def scattered(n: int, seed: int, k: int = 2) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (n, k))


def test_settings_run_are_the_same_after_the_coding_of_a_part_of_the_region() -> None:
    """To the bit, for settings of the digits that are proposed: what repeats a run there repeats it."""
    box = box_around(PAIR, np.array([0.2, -0.1]), np.array([0.3, 0.4]))
    rng = np.random.default_rng(4)
    settings = [
        {"frequency": float(f"{f:.4g}"), "angle": float(f"{a:.4g}")}
        for f, a in zip(10.0 ** rng.uniform(0.0, 2.0, 200), rng.uniform(20.0, 60.0, 200), strict=True)
    ]
    local = box.local(PAIR.code(settings))
    assert rounded_settings(PAIR, np.array([box.outwards(point) for point in local])) == settings


def test_local_coding_is_that_of_the_sub_region() -> None:
    box = box_around(PAIR, np.array([0.5, 0.9]), np.array([0.3, 0.4]))
    inner = sub_region(PAIR, box)
    points = scattered(20, 1) * 0.3 + np.array([0.5, 0.6])
    np.testing.assert_allclose(inner.code(PAIR.decode(points)), box.local(points), atol=1e-9)
    np.testing.assert_allclose([box.outwards(p) for p in box.local(points)], points, atol=1e-12)
    assert inner.factors[1].high == 60.0  # pushed inside the bounds
    assert box.high[1] == 1.0
    low = inner.factors[0].low
    assert low == float(f"{low:.4g}")  # its ends are read by people


def test_discrete_and_categorical_factors_are_never_cut() -> None:
    region = Region((LOG, DiscreteFactor("looks", (1, 2, 4, 8)), CategoricalFactor("band", ("L", "C"))))
    box = box_around(region, np.array([0.0, 0.2, 1.0]), np.full(3, 0.5))
    inner = sub_region(region, box)
    assert inner.factors[1:] == region.factors[1:]
    assert inner.factors[0].low == pytest.approx(10**0.5, rel=1e-3)
    assert box.contains(np.array([[0.1, 1.0, 1.0], [0.9, 1.0, 1.0]])).tolist() == [True, False]


def test_evidence_is_the_restricted_likelihood_ratio() -> None:
    """Against the textbook formula with determinants, at the length and variance that were found."""
    model, X = QuadraticModel(PAIR.factors), scattered(25, 2)
    y = hump(X) + np.random.default_rng(3).normal(size=25)
    Z = model.matrix(X)
    found = find_discrepancy(model, X, Z, y)

    def restricted(V: np.ndarray) -> float:
        inverse = np.linalg.inv(V)
        M = Z.T @ inverse @ Z
        P = inverse - inverse @ Z @ np.linalg.solve(M, Z.T @ inverse)
        rss = y @ P @ y
        return -0.5 * (np.linalg.slogdet(V)[1] + np.linalg.slogdet(M)[1] + (25 - 6) * np.log(rss))

    gap = np.sum((X[:, None] - X[None]) ** 2, axis=-1)
    V = np.eye(25) + found.variance * np.exp(-0.5 * gap / found.length**2)
    assert found.evidence == pytest.approx(2 * (restricted(V) - restricted(np.eye(25))), rel=1e-8)
    assert found.evidence > evidence_limit(19)


def test_quadratics_show_no_departure() -> None:
    model = QuadraticModel(PAIR.factors)
    false = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        X = rng.uniform(-1, 1, (30, 2))
        y = model.matrix(X) @ rng.normal(size=6) * 10 + rng.normal(size=30)
        false += find_discrepancy(model, X, model.matrix(X), y).evidence > evidence_limit(24)
    assert false <= 0.06 * 200  # about 2 % in 2000 trials


def test_likely_optimum_finds_the_hump_that_a_quadratic_misses() -> None:
    model, X = QuadraticModel(PAIR.factors), scattered(60, 5)
    y = hump(X) + 0.8 * hump(X, (-0.6, -0.5)) + 0.5 * np.random.default_rng(6).normal(size=60)
    Z = model.matrix(X)
    at = likely_optimum(model, PAIR, X, Z, y, find_discrepancy(model, X, Z, y))
    assert np.linalg.norm(at - np.array([0.5, 0.3])) < 0.15
    low = likely_optimum(model, PAIR, X, Z, -y, find_discrepancy(model, X, Z, -y), "minimize")
    np.testing.assert_allclose(low, at, atol=0.05)


def dense(seed: int = 7, n: int = 160) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    X = scattered(n, seed)
    y = hump(X) + np.random.default_rng(seed + 1).normal(size=n)
    return X, y, np.repeat(np.arange(n // 20) + 1, 20)


def test_region_shrinks_around_the_hump_and_the_history_says_so() -> None:
    X, y, batches = dense()
    state = walk(Plan(PAIR, max_runs=400), X, y, batches)
    assert not state.box.whole
    assert np.all(np.array(state.box.low) < [0.5, 0.3])
    assert np.all(np.array(state.box.high) > [0.5, 0.3])
    kinds = [step.kind for step in state.steps]
    assert kinds[0] == "shrink"
    assert "filled" in kinds
    assert np.count_nonzero(state.box.contains(X)) >= needed_runs(6)
    filled = [step.box for step in state.steps if step.kind == "filled"]
    assert filled[-1] == state.box


def test_stronger_evidence_asks_for_a_smaller_box() -> None:
    # Three sizes of evidence: at the limit, eight times it, and beyond what shrinks further.
    sizes = [moving._shrink(1.0), moving._shrink(2.0), moving._shrink(8.0), moving._shrink(1e9), moving._shrink(0.1)]
    np.testing.assert_allclose(sizes, [0.6, 0.6 / 2.0 ** (1.0 / 3.0), 0.3, 0.3, 0.6], rtol=1e-14)


def test_state_depends_on_the_runs_and_not_on_how_often_one_looks() -> None:
    X, y, batches = dense()
    plan = Plan(PAIR, max_runs=400)
    at_once = walk(plan, X, y, batches)
    stepwise = moving.RegionState(whole_box(2))
    for batch in np.unique(batches):
        here = batches <= batch
        stepwise = moving.look(plan, stepwise, X[here], y[here], int(batch))
    assert repr(stepwise) == repr(at_once)  # nan is not equal to itself
    order = np.random.default_rng(1).permutation(len(y))
    shuffled = walk(plan, X[order], y[order], batches[order])
    assert [step.kind for step in shuffled.steps] == [step.kind for step in at_once.steps]


def test_quadratic_keeps_the_whole_region() -> None:
    X = scattered(120, 11)
    y = 5 - 3 * np.sum((X - 0.2) ** 2, axis=1) + np.random.default_rng(12).normal(size=120)
    assert walk(Plan(PAIR, max_runs=400), X, y, np.repeat(np.arange(12), 10)).box.whole


def test_box_is_not_called_for_that_the_budget_cannot_fill() -> None:
    X, y, batches = dense(n=40)
    assert walk(Plan(PAIR, max_runs=200), X, y, batches).steps
    few = scattered(16, 7)
    assert not walk(Plan(PAIR, max_runs=16), few, hump(few), np.ones(16, dtype=int)).steps


def test_box_follows_an_optimum_over_its_edge_but_not_over_the_bounds() -> None:
    """Runs in a corner box of a surface that rises towards the opposite corner."""
    box = Box((-1.0, -1.0), (-0.2, -0.2))
    rng = np.random.default_rng(4)
    X = rng.uniform(-1.0, -0.2, (60, 2))
    state = moving.RegionState(box)
    rising = moving.look(Plan(PAIR, max_runs=500), state, X, 10 * X.sum(axis=1) + 0.2 * rng.normal(size=60), 1)
    assert rising.steps[-1].kind == "move"
    assert np.all(np.array(rising.target.low) > np.array(box.low))
    falling = moving.look(Plan(PAIR, max_runs=500), state, X, -10 * X.sum(axis=1) + 0.2 * rng.normal(size=60), 1)
    assert falling.target is None


def test_box_does_not_follow_noise() -> None:
    """A surface without any slope has its fitted optimum on an edge more often than not."""
    box, moves = Box((-0.4, -0.4), (0.4, 0.4)), 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        X = rng.uniform(-0.4, 0.4, (40, 2))
        state = moving.look(Plan(PAIR, max_runs=500), moving.RegionState(box), X, rng.normal(size=40), 1)
        moves += bool(state.steps) and state.steps[-1].kind == "move"
    assert moves <= 12


def test_crowded_runs_do_not_fill_a_box() -> None:
    box = Box((0.0, 0.0), (1.0, 1.0))
    crowd = 0.5 + 0.02 * scattered(60, 3)
    data = moving._Data(crowd, np.zeros(60), np.ones(60), np.empty((60, 0)))
    assert not moving._can_be_fitted(Plan(PAIR), box, data)
    spread = 0.5 + 0.5 * scattered(60, 3)
    data = moving._Data(spread, np.zeros(60), np.ones(60), np.empty((60, 0)))
    assert moving._can_be_fitted(Plan(PAIR), box, data)


def test_all_discrete_region_and_constraints() -> None:
    region = Region((DiscreteFactor("a", (1, 2, 3)), DiscreteFactor("b", (1, 2, 3))))
    assert walk(Plan(region), np.zeros((9, 2)), np.arange(9.0), np.ones(9, dtype=int)).box.whole
    cut = Region(PAIR.factors, (Constraint("angle <= 20 + frequency"),))
    X = cut.sample(200, np.random.default_rng(1))
    state = walk(Plan(cut, max_runs=900), X, hump(X), np.repeat(np.arange(10), 20))
    assert sub_region(cut, state.box).constraints == cut.constraints


def test_equal_scores_call_for_nothing() -> None:
    X = scattered(60, 3)
    state = walk(Plan(PAIR), X, np.full(60, 7.0), np.repeat(np.arange(6), 10))
    assert state.box.whole
    assert not state.steps


def test_categories_depart_each_in_its_own_way() -> None:
    region = Region((LOG, CategoricalFactor("band", ("L", "C", "X"))))
    model = QuadraticModel(region.factors)
    rng = np.random.default_rng(2)
    X = np.column_stack([rng.uniform(-1, 1, 90), rng.integers(3, size=90).astype(float)])
    y = 8 * np.sin(4 * X[:, 0] + X[:, 1]) + rng.normal(size=90)
    assert find_discrepancy(model, X, model.matrix(X), y).evidence > 20
