"""Simulated campaigns: coverage against its binomial error and against the measured study of stopping rules.

The reference figures are those of 600 campaigns each on quadratics with interior optimum, sigma = 2: Student intervals
cover nominally at fixed n; stopping as soon as a prediction interval is narrow makes s too small by a tenth and costs
coverage; asking for three runs a term restores it.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from seqrsm.decide.campaigns import Campaigns, Stage
from seqrsm.decide.rehearsal import Rehearsal, rehearse, share_se
from seqrsm.decide.rule import StopRule
from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.moments import region_moments
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import DesignError
from seqrsm.fit.least_squares import fit_least_squares
from seqrsm.fit.rank_one import downdate, linear_gain

SIGMA = 2.0
CAMPAIGNS = 800


def greedy_start(model: QuadraticModel, region: Region, n: int) -> np.ndarray:
    points = region.candidates(n_continuous_levels=3)
    Z, W, C = model.matrix(points), region_moments(model, region), 1e3 * np.eye(model.p)
    chosen = []
    for _ in range(n):
        best = int(np.argmax(linear_gain(C, W, Z)))
        C = downdate(C, Z[best])
        chosen.append(best)
    return points[chosen]


def peaked(model: QuadraticModel, m: int, seed: int) -> np.ndarray:
    """Rotated quadratics with an interior maximum of 90."""
    rng = np.random.default_rng(seed)
    k = model.k
    betas = np.zeros((m, model.p))
    for row in betas:
        Q, _ = np.linalg.qr(rng.normal(size=(k, k)))
        B = -Q @ np.diag(rng.uniform(4.0, 12.0, k)) @ Q.T
        x0 = rng.uniform(-0.6, 0.6, k)
        values = {"intercept": 90.0 + x0 @ B @ x0}
        for i, a in enumerate(model.factors):
            values[a.name] = (-2.0 * B @ x0)[i]
            values[f"{a.name}^2"] = B[i, i]
            values |= {f"{a.name}:{b.name}": 2.0 * B[i, j] for j, b in enumerate(model.factors) if j > i}
        row[:] = [values[name] for name in model.term_names]
    return betas


@cache
def setting(k: int) -> tuple[QuadraticModel, Region, np.ndarray, np.ndarray]:
    factors = tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k))
    model, region = QuadraticModel(factors), Region(factors)
    return model, region, greedy_start(model, region, model.p + 6), peaked(model, 400, 1)


def run(rule: StopRule, k: int = 3, n: int = CAMPAIGNS, seed: int = 5) -> Rehearsal:
    model, region, start, betas = setting(k)
    return rehearse(Stage(model, region, start, rule), betas, np.full(len(betas), SIGMA), n, seed)


def share_stopped(found: Rehearsal) -> float:
    """Share of campaigns in which the rule held within the budget."""
    return float(found.stopped.mean())


def runs_needed(found: Rehearsal, probability: float) -> float:
    """Runs within which the rule held in this share of campaigns; inf where the budget did not suffice."""
    ended = np.sort(np.where(found.stopped, found.runs.astype(np.float64), np.inf))
    return float(ended[min(int(np.ceil(probability * len(ended))), len(ended)) - 1])


def coverage(found: Rehearsal, of: str) -> tuple[float, float]:
    """Coverage and its binomial standard error."""
    share = float(getattr(found, f"covers_{of}").mean())
    return share, share_se(share, len(found.runs))


def near(found: tuple[float, float], expected: float, sd: float = 3.5) -> bool:
    return abs(found[0] - expected) <= sd * np.sqrt(expected * (1 - expected) / CAMPAIGNS)


def test_intervals_cover_nominally_at_fixed_n() -> None:
    found = run(StopRule(interval="confidence", half_width=1e-9, max_runs=36))
    assert not found.stopped.any()
    assert (found.runs == 36).all()
    for of in ("mean", "new_run", "confirmation"):
        assert near(coverage(found, of), 0.95), of
    assert found.s_ratio.mean() == pytest.approx(1.0, abs=0.02)
    assert runs_needed(found, 0.5) == np.inf


def test_stopping_on_a_narrow_prediction_interval_picks_small_s() -> None:
    hasty = StopRule(half_width=4.4, max_runs=76, runs_per_term=0, min_df_pure_error=0, alpha_lack_of_fit=0)
    found = run(hasty)
    assert 0.88 <= share_stopped(found) <= 0.99  # 0.93 in the study
    assert 20 <= runs_needed(found, 0.5) <= 32  # 24
    assert 0.85 <= found.s_ratio.mean() <= 0.95  # 0.88 to 0.92
    assert 0.88 <= coverage(found, "mean")[0] < 0.95  # 0.915
    assert near(coverage(found, "confirmation"), 0.95)  # exact whatever the rule was


def test_three_runs_a_term_restore_the_coverage() -> None:
    guarded = run(StopRule(interval="confidence", half_width=1.0, max_runs=80))
    assert share_stopped(guarded) > 0.95
    assert near(coverage(guarded, "rule"), 0.95)
    assert guarded.covers_rule.tolist() == guarded.covers_mean.tolist()
    assert (guarded.runs[guarded.stopped] >= 30).all()
    assert (guarded.half_width[guarded.stopped] <= 1.0).all()
    assert np.median(guarded.regret) < 0.15  # 0.09 in the study of sequential designs


@pytest.mark.parametrize("guard", ["confirmation", "anytime"])
def test_other_guards_cover_at_least_nominally(guard: str) -> None:
    found = run(StopRule(half_width=5.0, max_runs=80, guard=guard))  # type: ignore[arg-type]
    assert coverage(found, "rule")[0] > 0.92
    assert near(coverage(found, "confirmation"), 0.95)
    assert found.runs.max() <= 80 + 5


def test_same_seed_same_campaigns_and_progress_ends() -> None:
    model, region, start, betas = setting(3)
    calls: list[tuple[int, int]] = []
    rule = StopRule(half_width=5.0, max_runs=50)
    common = (Stage(model, region, start, rule), betas, np.full(len(betas), SIGMA))
    one = rehearse(*common, n_campaigns=300, seed=2, progress=lambda a, b: calls.append((a, b)))
    two = rehearse(*common, n_campaigns=300, seed=2)
    np.testing.assert_array_equal(one.runs, two.runs)
    np.testing.assert_array_equal(one.half_width, two.half_width)
    assert calls[-1] == (300, 300)
    assert [a for a, _ in calls] == sorted(a for a, _ in calls)


def test_minimising_mirrors_maximising() -> None:
    model, region, start, betas = setting(3)
    stage = Stage(model, region, start, StopRule(half_width=5.0, max_runs=50), goal="minimize")
    found = rehearse(stage, -betas, np.full(len(betas), SIGMA), n_campaigns=100)
    assert (found.regret >= 0.0).all()
    assert np.median(found.regret) < 0.3


def test_mixed_factors_and_constraints_run() -> None:
    factors = (
        ContinuousFactor("a", 0.0, 1.0),
        DiscreteFactor("d", (1.0, 2.0, 4.0)),
        CategoricalFactor("e", ("u", "v")),
    )
    model, region = QuadraticModel(factors), Region(factors, (Constraint("a * d <= 3"),))
    rng = np.random.default_rng(3)
    betas = rng.normal(size=(20, model.p))
    stage = Stage(model, region, greedy_start(model, region, model.p + 6), StopRule(half_width=0.9, max_runs=40))
    found = rehearse(stage, betas, np.full(20, 0.3), n_campaigns=30)
    assert len(found.runs) == 30
    assert (found.runs <= 40).all()


def test_start_that_cannot_estimate_the_model_is_refused() -> None:
    model, region, start, _ = setting(3)
    for bad in (start[:10], np.repeat(start[:1], 20, axis=0)):
        with pytest.raises(DesignError, match="cannot estimate"):
            Stage(model, region, bad, StopRule())


def test_campaigns_in_step_equal_an_ordinary_fit() -> None:
    """One simulated look, redone from its runs by the least-squares module."""
    model, region, start, betas = setting(3)
    start = np.vstack([start, start[:3], start[:2]])
    stage = Stage(model, region, start, StopRule(half_width=4.0, max_runs=80), 4, "maximize", 0.25, 16, 300)
    rng = np.random.default_rng(8)
    group = Campaigns(stage, betas[:3], np.full(3, SIGMA), rng)
    replay = np.random.default_rng(8)
    e = SIGMA * replay.standard_normal((len(start), 3))
    Z = stage.Z[stage.start]
    sse = group.ee - np.einsum("gi,gij,gj->g", group.Ze, np.linalg.inv(group.A), group.Ze)
    df_pure, p = group.lack_of_fit(group.alive, sse)
    for g in range(3):
        fit = fit_least_squares(Z, Z @ betas[g] + e[:, g], model.terms, setting_ids=stage.start)
        assert fit.sse == pytest.approx(sse[g], rel=1e-9)
        lof = fit.lack_of_fit()
        assert not isinstance(lof, str)
        assert lof.df_pe == df_pure[g]
        assert lof.p == pytest.approx(p[g], rel=1e-8)
        error = np.linalg.inv(group.A[g]) @ group.Ze[g]
        np.testing.assert_allclose(fit.estimate, betas[g] + error, rtol=1e-9, atol=1e-9)


def test_none_or_all_of_some_campaigns_is_not_certain() -> None:
    # Of 20 campaigns none: the exact 68 % interval reaches to 1 - 0.16 ** (1 / 20) = 8.8 %, the rule of three to 15 %.
    assert 0.02 < share_se(0.0, 20) < 0.09
    assert share_se(0.0, 20) == pytest.approx(share_se(1.0, 20))
    assert share_se(0.5, 400) == pytest.approx(0.025, rel=1e-3)
