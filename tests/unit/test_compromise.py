"""Several applications: desirability, front, compromise against brute force, and what each gives up."""

from __future__ import annotations

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import statsmodels.api as sm
from scored_campaigns import numeric

from seqrsm.analysis.belief import Departure
from seqrsm.analysis.compromise import (
    Objective,
    _application,
    campaign_compromise,
    compromise,
    desirability,
    pareto_front,
)
from seqrsm.campaign.campaign import Campaign
from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.region import Region
from seqrsm.report.sections.compromise import _score_table, _setting_table
from seqrsm.spec.tables import ApplicationSpec
from seqrsm.store.records import IngestedFile, IngestedRun, NewScore

BOX = Region((ContinuousFactor("a", -1.0, 1.0), ContinuousFactor("b", -1.0, 1.0)))


def bowl(at: tuple[float, float], top: float = 100.0):
    return lambda x: top - 20 * np.sum((x - np.array(at)) ** 2, axis=1)


def test_desirability_by_hand() -> None:
    values = np.array([0.0, 20.0, 50.0, 80.0, 100.0])
    np.testing.assert_allclose(desirability(values, "maximize", 20, 80), [0, 0, 0.5, 1, 1])
    np.testing.assert_allclose(desirability(values, "minimize", 80, 20), [1, 1, 0.5, 0, 0])
    np.testing.assert_allclose(desirability(values, "maximize", 50, 50), 1.0)


def test_what_nothing_reaches_is_unacceptable_and_what_all_surpass_is_ideal() -> None:
    beyond = [
        Objective("x", "maximize", 1.0, bowl((0.0, 0.0)), unacceptable=120.0),
        Objective("cost", "minimize", 1.0, lambda p: 50.0 + p[:, 0], unacceptable=40.0),
        Objective("noise", "minimize", 1.0, lambda p: 50.0 + p[:, 0], ideal=60.0),
        Objective("y", "maximize", 1.0, bowl((0.0, 0.0)), ideal=10.0),
    ]
    found = compromise(BOX, beyond)
    assert [row.desirability for row in found.given_up] == [0.0, 0.0, 1.0, 1.0]
    assert found.desirability == 0.0
    # The others decide, of every draw too.
    drawn = replace(beyond[0], draws=lambda p: np.tile(beyond[0].mean(p), (5, 1)))
    wanted = Objective("reach", "maximize", 1.0, lambda p: p[:, 1], unacceptable=-2.0)
    found = compromise(BOX, [drawn, wanted])
    assert found.settings["b"] == 1.0
    assert (found.credible["b"].low, found.credible["b"].high) == (1.0, 1.0)


def test_what_is_unacceptable_to_the_lightest_objective_is_no_compromise() -> None:
    # At a > 0.2 y is unacceptable; a = 1 is best for x, whose weight is 99 times that of y.
    x = Objective("x", "maximize", 0.99, lambda p: np.exp(3.0 * p[:, 0]), unacceptable=0.0)
    y = Objective("y", "maximize", 0.01, lambda p: 0.2 - p[:, 0], unacceptable=0.0, ideal=1.2)
    found = compromise(BOX, [x, y])
    a = np.linspace(-1.0, 0.2, 200_001)[:-1]
    geometric = (np.exp(3.0 * a) / np.exp(3.0)) ** 0.99 * ((0.2 - a) / 1.2) ** 0.01
    assert found.settings["a"] == pytest.approx(a[np.argmax(geometric)], abs=0.005)
    assert found.desirability == pytest.approx(geometric.max(), rel=0.02)


def test_front_against_all_pairs() -> None:
    rng = np.random.default_rng(1)
    values = np.round(rng.uniform(size=(120, 3)), 1)
    goals = ("maximize", "minimize", "maximize")
    signed = values * [1, -1, 1]
    expected = np.ones(120, dtype=bool)
    for i, j in itertools.permutations(range(120), 2):
        if np.all(signed[j] >= signed[i]) and np.any(signed[j] > signed[i]):
            expected[i] = False
    np.testing.assert_array_equal(pareto_front(values, goals), expected)


def test_compromise_lies_between_and_matches_a_fine_grid() -> None:
    objectives = [
        Objective("x", "maximize", 1.0, bowl((-0.5, 0.0))),
        Objective("y", "maximize", 2.0, bowl((0.5, 0.0)), unacceptable=60.0, ideal=100.0),
    ]
    found = compromise(BOX, objectives)
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 401)] * 2), -1).reshape(-1, 2)
    x, y = (o.mean(grid) for o in objectives)
    worst = float(min(bowl((-0.5, 0.0))(np.array([[1.0, 1.0]]))))
    log = np.log(np.maximum(desirability(x, "maximize", worst, 100), 1e-6)) / 3
    log += 2 * np.log(np.maximum(desirability(y, "maximize", 60, 100), 1e-6)) / 3
    np.testing.assert_allclose(found.point, grid[np.argmax(log)], atol=0.02)
    assert found.desirability == pytest.approx(np.exp(log.max()), abs=1e-3)
    first, second = found.given_up
    assert first.own_settings == pytest.approx({"a": -0.5, "b": 0.0}, abs=0.02)
    assert first.given_up > second.given_up > 0.0  # the heavier weight gives up less
    assert first.given_up == pytest.approx(first.own_best - first.value)


def test_an_optimum_told_elsewhere_is_the_one_told_here() -> None:
    told = np.array([0.49, 0.01])
    objectives = [
        Objective("x", "maximize", 1e-9, bowl((-0.5, 0.0))),
        Objective("y", "maximize", 1.0, bowl((0.5, 0.0)), optimum=told),
    ]
    found = compromise(BOX, objectives).given_up[1]
    assert found.own_settings == pytest.approx({"a": 0.49, "b": 0.01}, abs=1e-12)
    assert found.given_up == 0.0  # the compromise is nearer to where y is best than what was told


def test_what_is_fitted_beyond_the_scale_is_no_better_than_its_end(tmp_path, monkeypatch) -> None:
    """A surface fitted above 100 percent gave nothing up at 100, yet was told to be less than ideal there."""
    monkeypatch.setattr(ApplicationSpec, "score_limits", property(lambda self: (0.0, 100.0)))
    cost = '[[application]]\nname = "a"\nutility = "measured"\n[[consideration]]\nname = "cost"\nexpr = "3 + x0"\n'
    text = f'[campaign]\nname = "test"\n{numeric(1)}{cost}[stop]\nhalf_width = 5.0\nmax_runs = 40\n'
    (tmp_path / "campaign.toml").write_text(text, "utf-8")
    made, x = Campaign.open(tmp_path), np.linspace(-1.0, 1.0, 21)
    scores = 95.0 + 15.0 * x + 0.1 * np.random.default_rng(4).normal(size=21)  # 100 from x0 = 1/3 on
    rows = zip(made.spec.region.decode(x[:, None]), scores, strict=True)
    runs = tuple(IngestedRun(None, at, "flight", "", 1.0, (NewScore("a", float(y)),)) for at, y in rows)
    made.store.ingest_files([IngestedFile("f.csv", "0", len(runs), runs)])
    found = campaign_compromise(made.spec, made.analyse_all())
    assert found is not None
    grid = np.linspace(-1.0, 1.0, 2001)  # desirability from the worst, 80, to 100, and of cost from 4 to 2
    merit = np.sqrt((np.minimum(95.0 + 15.0 * grid, 100.0) - 80.0) / 20.0 * (1.0 - grid) / 2.0)
    assert found.settings["x0"] == pytest.approx(grid[merit.argmax()], abs=0.02)
    assert found.desirability == pytest.approx(merit.max(), abs=0.01)
    assert found.given_up[0].own_best == 100.0
    assert found.front_values[:, 0].max() == 100.0


def test_posterior_of_the_compromise() -> None:
    rng = np.random.default_rng(2)
    centres = np.array([-0.5, 0.0]) + 0.05 * rng.normal(size=(100, 2))
    draws = lambda x: np.array([bowl(tuple(c))(x) for c in centres])  # noqa: E731
    objectives = [
        Objective("x", "maximize", 1.0, bowl((-0.5, 0.0)), draws),
        Objective("cost", "minimize", 1.0, lambda x: 2.0 + x[:, 0]),
    ]
    found = compromise(BOX, objectives)
    for name, best in found.settings.items():
        assert found.credible[name].low <= best <= found.credible[name].high
        assert found.credible[name].half_width < 0.25
    assert 0.0 <= found.expected_shortfall < 0.05
    application, cost = found.given_up
    assert application.low <= application.given_up <= application.high
    assert np.isnan(cost.low)
    assert cost.value < 2.0


def test_an_exact_cost_is_told_with_its_own_digits() -> None:
    """Those of the difference had made 0.025 Mbit/s at its own optimum 0.0."""
    objectives = [
        Objective("x", "maximize", 1.0, bowl((0.5, 0.0))),
        Objective("rate", "minimize", 1.0, lambda x: 0.025 + 8.0 * (x[:, 0] + 1.0), unit="Mbit/s"),
    ]
    rate = compromise(BOX, objectives).given_up[1]
    assert rate.given_up > 4.0
    assert f"rate: {rate.value:.4g} Mbit/s against 0.025 at its own optimum, {rate.given_up:.4g} Mbit/s" in rate.text


def test_a_single_objective() -> None:
    alone = compromise(BOX, [Objective("x", "minimize", 1.0, lambda x: -bowl((0.2, -0.3))(x))])
    np.testing.assert_allclose(alone.point, [0.2, -0.3], atol=0.02)
    assert alone.given_up[0].given_up == pytest.approx(0.0, abs=0.02)


def test_how_likely_each_level_is_the_compromise_of_the_true_surfaces() -> None:
    """Of 100 draws 30 have the larger score at v, whose cost is the same: the report told no probability of either."""
    region = Region((ContinuousFactor("a", -1.0, 1.0), CategoricalFactor("c", ("u", "v"))))
    ahead = np.where(np.arange(100) < 30, 1.0, -1.0)
    of_v = region.code([{"a": 0.0, "c": "v"}])[0, 1]

    def score(x: np.ndarray) -> np.ndarray:
        return 80.0 - x[:, 0] ** 2 - 0.4 * (x[:, 1] == of_v)

    def draws(x: np.ndarray) -> np.ndarray:
        return 80.0 - x[:, 0] ** 2 + ahead[:, None] * (x[:, 1] == of_v)

    found = compromise(region, [Objective("x", "maximize", 1.0, score, draws)])
    assert found.settings["c"] == "u"
    assert found.levels == {"c": {"u": pytest.approx(0.7), "v": pytest.approx(0.3)}}
    assert found.to_json()["levels"] == found.levels
    texts = [[getattr(cell, "text", cell) for cell in row] for row in _setting_table(region, found).rows]
    assert texts[1][2] == "u: 70 %, v: 30 %".replace(" %", "\u00a0%")


def test_discrete_and_constrained_regions() -> None:
    region = Region((DiscreteFactor("a", (1, 2, 3)), CategoricalFactor("c", ("u", "v"))))
    found = compromise(region, [Objective("x", "maximize", 1.0, lambda x: x[:, 0] + 5 * x[:, 1])])
    assert region.decode(found.point)[0] == {"a": 3.0, "c": "v"}
    cut = Region(BOX.factors, (Constraint("a + b <= 0"),))
    found = compromise(cut, [Objective("x", "maximize", 1.0, lambda x: x[:, 0] + x[:, 1])])
    assert cut.feasible(found.point[None, :])[0]
    assert found.given_up[0].value == pytest.approx(0.0, abs=0.01)


def test_many_factors_of_values_are_searched() -> None:
    """No place of the cover has the best value of all seven: they are found one by one."""
    values = tuple(float(value) for value in range(9))
    region = Region(tuple(DiscreteFactor(f"d{i}", values) for i in range(7)))
    found = compromise(region, [Objective("x", "maximize", 1.0, bowl((-0.25,) * 7))])
    np.testing.assert_allclose(found.point, -0.25)


def test_equal_inputs_give_equal_results() -> None:
    objectives = [Objective("x", "maximize", 1.0, bowl((0.1, 0.7))), Objective("y", "maximize", 1.0, bowl((0.4, 0.0)))]
    np.testing.assert_array_equal(compromise(BOX, objectives).point, compromise(BOX, objectives).point)


def test_an_interval_of_a_factor_with_values_ends_at_values() -> None:
    """Between two dates lies no number of dates."""
    region = Region((DiscreteFactor("dates", (1, 2, 3, 4, 6)), ContinuousFactor("b", -1.0, 1.0)))
    shift = np.repeat([-1.0, -0.2, 0.2, 1.0], [3, 22, 22, 3])
    draws = lambda x: np.array([-((x[:, 0] - s) ** 2) - x[:, 1] ** 2 for s in shift])  # noqa: E731
    objective = Objective("x", "maximize", 1.0, lambda x: -(x[:, 0] ** 2) - x[:, 1] ** 2, draws)
    interval = compromise(region, [objective], level=0.9).credible["dates"]
    assert (interval.low, interval.high) == (1, 6)  # 3 of 50 draws at either end


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_errors_of_one_application_are_not_those_of_another(tmp_path, monkeypatch, sign) -> None:
    """Interval and shortfall are those of two regressions drawn independently, whatever the goals are.

    Draws that erred alike made the shortfall 1.9 times as large where both are maximized, a quarter where one is not.
    """
    alone = Departure(None, float("nan"), 0.0, "the quadratic is true")
    monkeypatch.setattr("seqrsm.analysis.fitted.weigh_departure", lambda *given: alone)
    rng = np.random.default_rng(7)
    x, goals = np.linspace(-1.0, 1.0, 300), ("maximize", "maximize" if sign > 0.0 else "minimize")
    tops, signs = (-0.4, 0.4), (1.0, sign)
    y = [
        s * (80.0 - 20.0 * (x - top) ** 2) + 6.0 * rng.standard_normal(300) for s, top in zip(signs, tops, strict=True)
    ]
    ends = [(s * 40.0, s * 85.0) for s in signs]
    uses = "".join(
        f'[[application]]\nname = "{name}"\nutility = "measured"\ngoal = "{goal}"\nunacceptable = {u}\nideal = {i}\n'
        for name, goal, (u, i) in zip("ab", goals, ends, strict=True)
    )
    head = f'[campaign]\nname = "test"\n{numeric(1)}{uses}'
    (tmp_path / "campaign.toml").write_text(f"{head}[stop]\nhalf_width = 5.0\nmax_runs = 400\n", "utf-8")
    made = Campaign.open(tmp_path)
    both = (
        tuple(NewScore(name, float(one)) for name, one in zip("ab", row, strict=True)) for row in zip(*y, strict=True)
    )
    settings = made.spec.region.decode(x[:, None])
    runs = tuple(IngestedRun(None, at, "flight", "", 1.0, row) for at, row in zip(settings, both, strict=True))
    made.store.ingest_files([IngestedFile("f.csv", "0", len(runs), runs)])
    found = campaign_compromise(made.spec, made.analyse_all(n_draws=4000))
    assert found is not None

    grid = np.linspace(-1.0, 1.0, 2001)
    merit = np.zeros((4000, len(grid)))
    for one, (u, i) in zip(y, ends, strict=True):
        beta, covariance = np.polyfit(x, one, 2, cov=True)
        values = rng.multivariate_normal(beta, covariance, 4000) @ np.vander(grid, 3).T
        merit += 0.5 * np.log(np.clip((values - u) / (i - u), 1e-6, 1.0))
    wanted = np.quantile(grid[np.argmax(merit, axis=1)], [0.025, 0.975])
    half = 0.5 * (wanted[1] - wanted[0])
    lost = np.exp(merit.max(axis=1)) - np.exp(merit[:, np.argmax(merit.mean(axis=0))])
    # Of 200 draws: both vary by a tenth.
    assert found.credible["x0"].half_width == pytest.approx(half, rel=0.25)
    assert found.expected_shortfall == pytest.approx(float(lost.mean()), rel=0.3)


@pytest.mark.usefixtures("least_squares_alone")
def test_scores_to_expect_are_those_of_least_squares_at_the_compromise(tmp_path) -> None:
    """Against statsmodels' confidence and prediction intervals, of a first-order model; a cost has none."""
    uses = "".join(f'[[application]]\nname = "{name}"\nutility = "measured"\n' for name in "ab")
    cost = '[[consideration]]\nname = "cost"\nexpr = "3 + x0"\n[model]\norder = 1\n'
    text = f'[campaign]\nname = "test"\n{numeric(2)}{uses}{cost}[stop]\nhalf_width = 5.0\nmax_runs = 40\nlevel = 0.9\n'
    (tmp_path / "campaign.toml").write_text(text, "utf-8")
    made, rng = Campaign.open(tmp_path), np.random.default_rng(8)
    x = rng.uniform(-1.0, 1.0, (25, 2))
    y = {"a": x @ [4.0, 1.0] + rng.normal(size=25), "b": x @ [-2.0, 3.0] + 2.0 * rng.normal(size=25)}
    settings = made.spec.region.decode(x)
    scores = ((NewScore("a", a), NewScore("b", b)) for a, b in zip(y["a"], y["b"], strict=True))
    runs = tuple(IngestedRun(None, at, "flight", "", 1.0, row) for at, row in zip(settings, scores, strict=True))
    made.store.ingest_files([IngestedFile("f.csv", "0", len(runs), runs)])
    found = campaign_compromise(made.spec, made.analyse_all())
    assert found is not None
    of_uses, cost_row = found.given_up[:2], found.given_up[2]
    for row in of_uses:
        told = sm.OLS(y[row.name], sm.add_constant(x)).fit().get_prediction(np.array([[1.0, *found.point]]))
        frame = told.summary_frame(alpha=0.1).iloc[0]
        assert row.value == pytest.approx(frame["mean"])
        assert (row.confidence.low, row.confidence.high) == pytest.approx(
            (frame["mean_ci_lower"], frame["mean_ci_upper"])
        )
        assert (row.prediction.low, row.prediction.high) == pytest.approx(
            (frame["obs_ci_lower"], frame["obs_ci_upper"])
        )
    assert (cost_row.confidence, cost_row.prediction) == (None, None)
    (shown,) = _score_table(found)
    assert [row[0].text for row in shown.rows] == ["a", "b"]


def test_where_one_application_is_no_quadratic_another_may_be_one(tmp_path) -> None:
    """Draws of the two kinds of surfaces come in an order of each application's own: by chance half of them meet."""
    uses = "".join(f'[[application]]\nname = "{name}"\nutility = "measured"\ngoal = "maximize"\n' for name in "ab")
    text = f'[campaign]\nname = "test"\n{numeric(1)}{uses}[stop]\nhalf_width = 5.0\nmax_runs = 40\n'
    (tmp_path / "campaign.toml").write_text(text, "utf-8")
    made, rng = Campaign.open(tmp_path), np.random.default_rng(3)
    settings = made.spec.region.decode(np.linspace(-1.0, 1.0, 12)[:, None])
    runs = tuple(
        IngestedRun(None, at, "flight", "", 1.0, tuple(NewScore(name, float(rng.normal(50.0))) for name in "ab"))
        for at in settings
    )
    made.store.ingest_files([IngestedFile("f.csv", "0", len(runs), runs)])
    far = SimpleNamespace(draw=lambda rng: (lambda points: np.full(len(points), 1000.0), 1.0))
    departure = SimpleNamespace(believed=far, probability=0.5)
    of_process = []
    for analysis in made.analyse_all():
        objective = _application(made.spec, replace(analysis, fitted=replace(analysis.fitted, departure=departure)))
        assert objective.draws is not None
        of_process.append(objective.draws(np.zeros((1, 1)))[:, 0] > 500.0)
    assert [np.mean(one) for one in of_process] == [0.5, 0.5]
    # Of 200 draws the share in common has a standard deviation of 0.035.
    assert np.mean(of_process[0] == of_process[1]) == pytest.approx(0.5, abs=0.15)
