"""Proposals: rank-one gains against recomputed variances, repeats, pending runs, costs, determinism."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.optimum import optimum_draws
from seqrsm.propose import batch as batches
from seqrsm.propose import known
from seqrsm.propose.batch import FOR_THE_OPTIMUM, Optimum, Proposal, Spread, propose_batch
from seqrsm.propose.candidates import Search, Source
from seqrsm.propose.known import VALUE, Evidence, Sought, downdate, optimum_targets, unscaled_covariance

RNG_SEED = 11


def campaign(k: int = 3, n: int = 18) -> dict:
    factors = tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k))
    model, region = QuadraticModel(factors), Region(factors)
    rng = np.random.default_rng(RNG_SEED)
    points = np.vstack([rng.choice([-1.0, 0.0, 1.0], (n, k)), np.zeros((2, k))])
    Z = model.matrix(points)
    beta = np.zeros(model.p)
    for t, term in enumerate(model.terms):
        beta[t] = {"linear": 1.0, "square": -2.5}.get(term.kind, 0.0)
    C = np.linalg.inv(Z.T @ Z)
    draws = beta + 0.5 * rng.normal(size=(64, model.p)) @ np.linalg.cholesky(C).T
    targets, _ = optimum_draws(model, region, draws)
    x_hat, _ = optimum_draws(model, region, beta[None, :])
    return {
        "model": model,
        "region": region,
        "Z_done": Z,
        "x_hat": x_hat[0],
        "target_points": targets,
        "points_done": points,
        "df_pure_error": len(points) - len(np.unique(points, axis=0)),
    }


def propose(
    model: QuadraticModel, region: Region, *, n: int, spread_share: float = 0.25, **given: Any
) -> tuple[Proposal, ...]:
    """A batch, its facts by name."""
    facts = {name: given.pop(name) for name in ("prior_precision", "df_pure_error") if name in given}
    evidence = Evidence(given.pop("Z_done"), given.pop("points_done"), **facts)
    sought = Sought(given.pop("x_hat"), given.pop("target_points"))
    source = Source(**{name: given.pop(name) for name in ("rows", "cost") if name in given})
    plan = [(batches.Testing, spread_share), (Optimum, 1.0 - spread_share)]
    plan = given.pop("plan", plan)
    return propose_batch(model, region, evidence, sought, n, plan, source=source, **given)


def covariance(Z: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return np.linalg.inv(Z.T @ (weights[:, None] * Z))


def linear_gain(C: np.ndarray, W: np.ndarray, Z: np.ndarray, weight: float = 1.0) -> np.ndarray:
    return Optimum(SimpleNamespace(C=C, value=W, regret=0.0 * W, weight=weight)).gain(Z)


def information_gain(C: np.ndarray, Z: np.ndarray, weight: float = 1.0) -> np.ndarray:
    return Spread(SimpleNamespace(C=C, weight=weight)).gain(Z)


def test_rank_one_gain_is_the_drop_of_the_variance() -> None:
    data = campaign()
    rng = np.random.default_rng(1)
    Z, weights = data["Z_done"], rng.uniform(0.5, 2.0, len(data["Z_done"]))
    C = covariance(Z, weights)
    for _ in range(20):
        z, row, w = rng.normal(size=Z.shape[1]), rng.normal(size=Z.shape[1]), rng.uniform(0.2, 3.0)
        after = covariance(np.vstack([Z, z]), np.append(weights, w))
        np.testing.assert_allclose(downdate(C, z, w), after, rtol=1e-8, atol=1e-12)
        W = np.outer(row, row)
        assert linear_gain(C, W, z[None, :], w)[0] == pytest.approx(row @ C @ row - row @ after @ row, rel=1e-9)
        information = 0.5 * (np.linalg.slogdet(C)[1] - np.linalg.slogdet(after)[1])
        assert information_gain(C, z[None, :], w)[0] == pytest.approx(information, rel=1e-8)


def test_target_matrices_are_the_mean_variances_they_stand_for() -> None:
    rng = np.random.default_rng(3)
    z_hat, z_star, A = rng.normal(size=4), rng.normal(size=(7, 4)), rng.normal(size=(4, 4))
    C = A @ A.T
    value, regret = optimum_targets(z_hat, z_star)
    by_hand = 0.5 * z_hat @ C @ z_hat + 0.5 * np.mean([z @ C @ z for z in z_star])
    assert np.trace(value @ C) == pytest.approx(VALUE * by_hand)
    assert np.trace(regret @ C) == pytest.approx(np.mean([(z - z_hat) @ C @ (z - z_hat) for z in z_star]))


def test_first_proposal_beats_every_point_of_a_grid() -> None:
    data = campaign(3)
    model = data["model"]
    C = covariance(data["Z_done"], np.ones(len(data["Z_done"])))
    W = sum(optimum_targets(model.matrix(data["x_hat"][None, :])[0], model.matrix(data["target_points"])))
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 21)] * 3), -1).reshape(-1, 3)
    best = linear_gain(C, W, model.matrix(grid)).max()
    first = propose(**data, n=1, spread_share=0.0)[0]
    assert first.gain >= 0.999 * best
    assert linear_gain(C, W, model.matrix(first.point[None, :]))[0] == pytest.approx(first.gain, rel=1e-10)


def test_runs_for_the_optimum_tell_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nearly as well as runs that are for nothing else: they do not gather where it seems to be."""
    data = campaign(4, 21)
    model = data["model"]
    spread = model.matrix(data["target_points"]) - model.matrix(data["x_hat"][None, :])

    def doubt() -> float:
        points = np.array([p.point for p in propose(**data, n=12, spread_share=0.0, seed=1)])
        Z = np.vstack([data["Z_done"], model.matrix(points)])
        return float(np.mean(np.sum((spread @ covariance(Z, np.ones(len(Z)))) * spread, axis=1)))

    found = doubt()
    monkeypatch.setattr(known, "VALUE", 0.0)
    assert found < 2.5 * doubt()


def test_stated_shares_can_be_read() -> None:
    told = [known.percent(share) for share in (0.0, 6.2e-6, 0.00123, 0.0756, 0.287, 0.9949, 0.9951, 1.0)]
    assert told == ["less than 0.01 %"] * 2 + ["0.12 %", "7.6 %", "29 %", "99 %", "100 %", "100 %"]


def test_stated_narrowing_is_the_true_one() -> None:
    data, weight, common = campaign(3), 1.7, 0.4
    sought = Sought(data["x_hat"], data["target_points"], common=common)
    found = known.Known(data["model"], data["region"], Evidence(data["Z_done"]), sought, weight)
    z, row = data["model"].matrix(np.array([data["x_hat"], [0.4, -0.7, 0.2]]))
    ones = np.ones(len(data["Z_done"]))
    before = z @ covariance(data["Z_done"], ones) @ z
    after = z @ covariance(np.vstack([data["Z_done"], row]), np.append(ones, weight)) @ z
    run = 1.0 / weight + common
    prediction, mean = (100.0 * (1.0 - np.sqrt((own + after) / (own + before))) for own in (run, 0.0))
    assert found.narrowing(row) == (
        f"narrows the prediction interval at the optimum by {prediction:.2g} %, the confidence interval of the mean by "
        f"{mean:.2g} %"
    )


def test_stated_drop_of_the_loss_is_the_true_one() -> None:
    data = campaign(3) | {"target_points": np.random.default_rng(0).uniform(-1.0, 1.0, (64, 3))}
    model, Z, told = data["model"], data["Z_done"], []
    spread = model.matrix(data["target_points"]) - model.matrix(data["x_hat"][None, :])

    def loss(rows: np.ndarray) -> float:
        return float(np.sum((spread @ covariance(rows, np.ones(len(rows)))) * spread))

    for proposal in propose(**data, n=8, spread_share=0.0):
        before, Z = loss(Z), np.vstack([Z, model.matrix(proposal.point[None, :])])
        share = f"loss from a misplaced optimum by {100.0 * (1.0 - loss(Z) / before):.2g} %"
        told += [share in proposal.why] if proposal.purpose == "regret" else []
    assert len(told) > 2
    assert all(told)


def test_one_run_in_four_is_kept_for_repeats_then_for_spread() -> None:
    data = campaign(3)
    data["df_pure_error"] = 0
    purposes = [p.purpose for p in propose(**data, n=40)]
    kept = [p for p in purposes if p in ("repeat", "spread")]
    assert len(kept) == 10
    first_spread = kept.index("spread")
    assert 0 < first_spread <= 4
    assert set(kept[first_spread:]) == {"spread"}


def test_share_is_kept_for_single_proposals_too() -> None:
    data = campaign(2)
    found = []
    for _ in range(12):
        proposal = propose(**data, n=1)[0]
        found.append(proposal.purpose)
        data["Z_done"] = np.vstack([data["Z_done"], data["model"].matrix(proposal.point[None, :])])
        data["points_done"] = np.vstack([data["points_done"], proposal.point])
        data["df_pure_error"] += proposal.repeats
    assert sum(p in ("repeat", "spread") for p in found) == 3


@pytest.mark.parametrize(
    "shares", [(0.25, 0.75), (1 / 3, 1 / 3, 1 / 3), (0.25, 0.5, 0.25), (0.0, 1.0), (1.0, 0.0, 0.0)]
)
def test_criteria_of_a_plan_have_their_shares_of_a_campaign(shares: tuple[float, ...]) -> None:
    """After any number of runs, whatever the size of its batches: the next run's criterion depends on nothing else."""

    class Counted:
        def __init__(self, name: int) -> None:
            self.name = name

        def propose(self, search: Search) -> Proposal:
            return Proposal(search.candidates.points[0], str(self.name), 0.0, "", True)

    data = campaign(2)
    plan = [(lambda known, name=name: Counted(name), share) for name, share in enumerate(shares)]
    sought = Sought(data["x_hat"], data["target_points"])
    turns = []
    for before, n in ((0, 90), (90, 1), (91, 29)):
        evidence = Evidence(np.zeros((before, data["model"].p)))
        batch = propose_batch(data["model"], data["region"], evidence, sought, n, plan)
        turns += [int(proposal.purpose) for proposal in batch]
    counts = np.array([np.cumsum(np.array(turns) == place) for place in range(len(shares))])
    assert np.all(np.abs(counts - np.outer(shares, np.arange(1, 121))) <= 1.0 + 1e-9)


def mixed_campaign() -> dict:
    """Factors of every kind, a constraint, and settings that lie on no grid of coded values."""
    factors = (
        ContinuousFactor("frequency", 1.3, 17.7, "GHz", "log"),
        ContinuousFactor("angle", 20.0, 70.0, "deg"),
        DiscreteFactor("looks", (1.0, 2.0, 4.0, 8.0, 16.0), scale="log"),
        CategoricalFactor("polarization", ("HH", "VV", "HV")),
    )
    model = QuadraticModel(factors)
    region = Region(factors, (Constraint("angle <= 80 - 2 * frequency"),))
    rng = np.random.default_rng(8)
    points = region.sample(26, rng)
    targets, _ = optimum_draws(model, region, rng.normal(size=(40, model.p)))
    return {
        "model": model,
        "region": region,
        "Z_done": model.matrix(points),
        "x_hat": targets[0],
        "target_points": targets,
        "points_done": points,
    }


@pytest.mark.parametrize("make", [campaign, mixed_campaign])
def test_repeats_are_exact_copies_of_executed_settings(
    make: Callable[[], dict], monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the bit, of a run made or of one chosen before it: else they tell nothing of pure error."""
    monkeypatch.setattr(batches, "MIN_DF_PURE_ERROR", 40)
    data = make() | {"df_pure_error": 0}
    executed = [tuple(point) for point in data["points_done"]]
    purposes = []
    for proposal in propose(**data, n=12):
        point = tuple(proposal.point)
        purposes.append(proposal.purpose)
        if proposal.purpose == "repeat":
            assert proposal.repeats
            assert "pure error" in proposal.why
        if proposal.repeats:
            assert point in executed
        executed.append(point)
    assert purposes.count("repeat") == 3


def test_settings_executed_that_are_the_best_again_are_a_repeat() -> None:
    """Where all was run once, spread wants a corner again: it is taken as it is, and said to be executed."""
    factors = (DiscreteFactor("a", (1.0, 2.0, 3.0)), DiscreteFactor("b", (1.0, 2.0, 3.0)))
    model, region = QuadraticModel(factors), Region(factors)
    points = region.candidates(3)
    centre = np.zeros((1, 2))
    (found,) = propose(
        model, region, Z_done=model.matrix(points), points_done=points, x_hat=centre[0], target_points=centre, n=1,
        plan=[(Spread, 1.0)],
    )  # fmt: skip
    assert np.all(np.abs(found.point) == 1.0)
    assert found.repeats
    assert found.why.endswith("repeats settings run or proposed before")


def test_pending_runs_count_like_scored_ones() -> None:
    data = campaign(3)
    both = propose(**data, n=2, spread_share=0.0, seed=4)
    again = dict(data)
    again["Z_done"] = np.vstack([data["Z_done"], data["model"].matrix(both[0].point[None, :])])
    again["points_done"] = np.vstack([data["points_done"], both[0].point])
    second = propose(**again, n=1, spread_share=0.0, seed=4)[0]
    # the same criterion value, from another draw of the cloud
    assert second.gain == pytest.approx(both[1].gain, rel=0.01)
    ignored = propose(**data, n=1, spread_share=0.0, seed=4)[0]
    assert ignored.gain > 1.05 * second.gain


def test_batch_does_not_pile_up() -> None:
    data = campaign(4, 30)
    points = np.array([p.point for p in propose(**data, n=8, spread_share=0.0)])
    assert len(np.unique(points, axis=0)) >= 4


def test_cost_divides_the_gain() -> None:
    data = campaign(2)
    same = propose(**data, n=1, spread_share=0.0)[0]
    half = propose(**data, n=1, spread_share=0.0, cost=2.0)[0]
    assert half.gain == pytest.approx(0.5 * same.gain)


def test_every_run_is_for_the_optimum_or_against_regret_and_says_why() -> None:
    data = campaign(3)
    found = propose(**data, n=3, spread_share=0.0)
    assert {p.purpose for p in found} <= {"optimum", "regret"}
    assert all(p.why for p in found)


def test_spread_takes_the_least_known_point() -> None:
    data = campaign(2)
    data["points_done"] = 0.5 * data["points_done"]  # none at the corners, where least is known then
    data["Z_done"] = data["model"].matrix(data["points_done"])
    C = covariance(data["Z_done"], np.ones(len(data["Z_done"])))
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 41)] * 2), -1).reshape(-1, 2)
    Z = data["model"].matrix(grid)
    first = propose(**data, n=1, plan=[(Spread, 1.0)])[0]
    assert first.gain >= information_gain(C, Z).max() * 0.999


def test_nothing_is_proposed_for_no_runs() -> None:
    assert propose(**campaign(2), n=0) == ()


def test_same_seed_same_proposals() -> None:
    data = campaign(4, 30)
    one, two = propose(**data, n=5, seed=9), propose(**data, n=5, seed=9)
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.point, b.point)
        assert (a.purpose, a.gain, a.why) == (b.purpose, b.gain, b.why)


def test_proposals_are_feasible_on_levels_and_within_constraints() -> None:
    factors = (
        ContinuousFactor("resolution", 5.0, 100.0, "m", "log"),
        DiscreteFactor("looks", (1.0, 2.0, 4.0, 8.0, 16.0), scale="log"),
        CategoricalFactor("polarization", ("HH", "VV", "HV")),
    )
    model = QuadraticModel(factors)
    region = Region(factors, (Constraint("looks <= 4 * (resolution / 12.1) ** 2"),))
    rng = np.random.default_rng(5)
    points = region.sample(24, rng)
    targets, _ = optimum_draws(model, region, rng.normal(size=(40, model.p)))
    found = propose(
        model, region, Z_done=model.matrix(points), points_done=points, x_hat=targets[0], target_points=targets, n=12
    )
    assert region.feasible(np.array([p.point for p in found]), tol=0.0).all()


def test_blocks_are_nuisance_columns() -> None:
    data = campaign(2, 16)
    n = len(data["Z_done"])
    block = np.where(np.arange(n) < n // 2, 1.0, -1.0)[:, None]
    plain = propose(**data, n=1, spread_share=0.0)[0]
    data["Z_done"] = np.hstack([data["Z_done"], block])
    blocked = propose(**data, n=1, spread_share=0.0)[0]
    assert blocked.gain > 0.0
    assert blocked.gain != plain.gain


def test_too_few_runs_lean_on_a_weak_prior() -> None:
    data = campaign(3)
    for key in ("Z_done", "points_done"):
        data[key] = data[key][:4]
    data["df_pure_error"] = 0
    found = propose(**data, n=12)
    Z = np.vstack([data["Z_done"], data["model"].matrix(np.array([p.point for p in found]))])
    assert np.linalg.matrix_rank(Z) == data["model"].p
    np.testing.assert_allclose(unscaled_covariance(np.zeros((0, 3)), None, None), 100.0 * np.eye(3))
    prior = np.diag([1.0, 2.0, 4.0])
    np.testing.assert_allclose(unscaled_covariance(np.zeros((0, 3)), None, prior), np.diag([1.0, 0.5, 0.25]))


@pytest.mark.parametrize("size", [1e-8, 1e-5, 1.0, 1e5, 1e8])
def test_coefficients_of_any_size_are_no_singularity(size: float) -> None:
    """Rows Z S, columns in other units, have the covariance S^-1 C S^-1: nothing is added to what is determined."""
    Z = np.random.default_rng(5).normal(size=(9, 4))
    sizes = np.outer([1.0, size, 1.0, size], [1.0, size, 1.0, size])
    C = unscaled_covariance(Z * np.sqrt(np.diagonal(sizes)), None, None)
    np.testing.assert_allclose(C * sizes, np.linalg.inv(Z.T @ Z), rtol=1e-9, atol=1e-12)
    # The prior counts, however little it says of what the runs leave out.
    C = unscaled_covariance(Z * [1.0, 1.0, 1.0, 0.0], None, np.diag([0.0, 0.0, 0.0, 1e-12 * size]))
    assert C[3, 3] == pytest.approx(1e12 / size)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3, 1e5])
def test_coefficients_that_runs_leave_undetermined_are_told_at_any_size(size: float) -> None:
    """Two columns that are one, up to rounding: the weak prior of 0.01 is added, and the difference left to it."""
    for seed in range(8):
        Z = np.random.default_rng(seed).normal(size=(9, 4))
        Z[:, 3] = Z[:, 2] / 3.0
        Z *= size
        C = unscaled_covariance(Z, None, None)
        null = np.array([0.0, 0.0, 1.0, -3.0]) / np.sqrt(10.0)  # moves no response
        assert null @ C @ null == pytest.approx(100.0, rel=0.02)


def test_a_batch_tells_the_new_days_effect_from_the_surface() -> None:
    """Four runs of a day that differs as much as runs do: by all of them it is known about as well as four runs can."""
    factors = (ContinuousFactor("a", -1.0, 1.0), ContinuousFactor("b", -1.0, 1.0))
    model, region = QuadraticModel(factors), Region(factors)
    points = region.sample(14, np.random.default_rng(3))
    Z = np.hstack([model.matrix(points), np.zeros((14, 1))])
    precision = np.diag([0.0] * model.p + [1.0])

    def new_day(at: np.ndarray) -> np.ndarray:
        return np.hstack([model.matrix(at), np.ones((len(at), 1))])

    chosen = propose(
        model, region, Z_done=Z, points_done=points, x_hat=np.zeros(2), target_points=np.zeros((1, 2)), n=4,
        plan=FOR_THE_OPTIMUM, prior_precision=precision, rows=new_day,
    )  # fmt: skip
    rows = new_day(np.array([one.point for one in chosen]))
    effect = np.linalg.inv(precision + Z.T @ Z + rows.T @ rows)[-1, -1]
    assert effect < 1.6 / (1.0 + 4.0)
