"""Gains from level to level against the t interval of a difference, and what constraints leave out."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy import stats
from scored_campaigns import campaign, specification

from seqrsm.analysis.ground import RANKED
from seqrsm.analysis.steps import joint_draws
from seqrsm.campaign import grounds
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.grounds import Grounds
from seqrsm.campaign.simulation import SimulationTask
from seqrsm.design.factors import ContinuousFactor
from seqrsm.report.blocks import Table
from seqrsm.report.figures.optimum import paint_lines, set_numeric_axis
from seqrsm.report.figures.surfaces import lines_by_level
from seqrsm.report.rounding import NOTHING
from seqrsm.report.sections.optimum import _steps

FACTORS = """
[[factor]]
name = "dates"
values = [1.0, 2.0, 4.0]
[[factor]]
name = "angle"
low = 20.0
high = 50.0
[[factor]]
name = "bands"
levels = ["L", "C", "L+C"]
"""
BANDS = np.array([0.0, -3.0, 5.0])


PRIOR = "[application.prior]\nutility = [0.0, 30.0]\neffect = { dates = [-inf, 0.0] }\n"
"""Scores and the effect of dates are otherwise."""


def analysis(place, more="", order=1, prior=""):
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.choice([-1.0, -1.0 / 3.0, 1.0], 36), rng.uniform(-1.0, 1.0, 36), np.arange(36) % 3])
    dates = 2.5 + 1.5 * points[:, 0]
    scores = 50.0 + 4.0 * dates + 1.5 * points[:, 1] + BANDS[points[:, 2].astype(int)] + rng.normal(scale=2.0, size=36)
    text = specification(FACTORS + more, application=prior, rest=f"[model]\norder = {order}\n")
    return campaign(place / "c", text, points, scores).analyse_all(n_draws=4000, thorough=True)[0]


@pytest.mark.usefixtures("least_squares_alone")
@pytest.mark.parametrize("prior", ["", PRIOR])
def test_steps_are_the_t_intervals_of_differences(prior, tmp_path) -> None:
    """By the scores alone, as the recommended settings are, whatever prior is stated."""
    found = analysis(tmp_path, prior=prior)
    assert bool(found.posterior.effects) == bool(prior)
    fit, model, region = found.fit, found.model, found.region
    assert [(s.factor, s.level, s.over) for s in found.steps] == [
        ("dates", 2.0, 1.0), ("dates", 4.0, 2.0), ("bands", "L", "L+C"), ("bands", "C", "L+C"),
    ]  # fmt: skip
    for step in found.steps:
        best = found.optimum.settings
        rows = model.matrix(region.code([{**best, step.factor: x} for x in (step.level, step.over)]))
        row = rows[0] - rows[1]
        gain, se = float(row @ fit.estimate), float(fit.s * np.sqrt(row @ fit.covariance_unscaled @ row))
        # The recommended one's mean is less for having been chosen, and the others' by as much as leaves none above it.
        less = {best[step.factor]: found.optimum.optimism}
        off = less.get(step.level, 0.0) - less.get(step.over, 0.0)
        levels = {"dates": (1.0, 2.0), "bands": ("L", "C")}[step.factor]
        others = model.matrix(region.code([{**best, step.factor: x} for x in levels])) @ fit.estimate
        above = max(float(others.max()) - found.optimum.mean, 0.0)
        taken = [less.get(x, above) for x in (step.level, step.over)]
        means = [float(one @ fit.estimate) - by for one, by in zip(rows, taken, strict=True)]
        half = float(stats.t.ppf(0.975, fit.df_residual)) * se
        assert (step.mean, step.gain) == pytest.approx((means[0], means[0] - means[1]), abs=1e-9)
        # 4000 draws: the ends of an interval are known to some 0.03 of its half-width.
        wanted = gain - half - max(off, 0.0), gain + half - min(off, 0.0)
        assert (step.interval.low, step.interval.high) == pytest.approx(wanted, abs=0.1 * half)
        assert step.better == pytest.approx(float(stats.t.cdf(gain / se, fit.df_residual)), abs=0.04)


@pytest.mark.usefixtures("least_squares_alone")
def test_levels_that_are_not_chosen_differ_as_they_do_by_the_fit(tmp_path) -> None:
    """Each was cut to the mean of the best: of a fall by 0.34 from 2 to 3 dates, -0.49 to -0.18, -0.14 was told."""
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.choice(np.linspace(-1.0, 1.0, 9), 64), np.arange(64) % 8])
    scores = 50.0 - 2.0 * points[:, 0] + rng.normal(scale=1.5, size=64)
    dates = '[[factor]]\nname = "dates"\nvalues = [1, 2, 3, 4, 5, 6, 7, 8, 9]\n'
    pol = f'[[factor]]\nname = "pol"\nlevels = {list("abcdefgh")}\n'.replace("'", '"')
    text = specification(dates + pol, rest="[model]\norder = 1\n")
    (found,) = campaign(tmp_path / "c", text, points, scores).analyse_all(thorough=True)
    assert found.optimum.optimism > 0.5
    for step in found.steps:
        assert step.interval.low <= step.gain <= step.interval.high
        assert step.mean <= found.optimum.mean
    # Of a straight line all steps are alike, but for the one from the recommended value.
    slope = float(found.fit.estimate[found.model.term_names.index("dates")])
    gains = [step.gain for step in found.steps if step.factor == "dates" and step.over != 1.0]
    assert gains == pytest.approx([slope / 4.0] * 7, rel=1e-9)


def test_no_step_has_an_interval_where_nothing_tells_the_scatter(tmp_path) -> None:
    """As many runs as terms: that no other level can be as good would be told of the prior alone."""
    points = np.array([[-1.0, -1.0, 0], [1.0, 0.5, 1], [-1.0 / 3.0, 1.0, 2], [1.0, -1.0, 0], [-1.0, 0.3, 2]])
    made = campaign(
        tmp_path / "c", specification(FACTORS, rest="[model]\norder = 1\n"), points, [5.0, 7.0, 6.0, 9.0, 4.0]
    )
    (found,) = made.analyse_all(thorough=True)
    assert np.isnan(found.fit.s)
    assert found.steps == ()


def test_on_the_actual_ground_another_level_is_better_more_often(tmp_path) -> None:
    """A gain with a normal ground on top: Phi(gain / sd), and the mean of its part above zero."""
    found = analysis(tmp_path)
    fit, best = found.fit, found.optimum
    assert all(np.isnan(step.better_here) and np.isnan(step.loss_here) for step in found.steps)
    levels = [{"factor": "bands", "level": "L", "sd": 6.0}, {"factor": "bands", "level": "C", "sd": 0.0}]
    detail = {"application": found.application, "settings": dict(best.settings), "levels": levels}
    opened = Campaign.open(tmp_path / "c")
    opened.store.add_event(RANKED, {**detail, "settings": {**best.settings, "bands": "L"}})
    assert np.isnan(opened.analyse_all(thorough=True)[0].steps[-1].better_here)  # of other settings
    opened.store.add_event(RANKED, detail)
    (known,) = opened.analyse_all(thorough=True)
    steps = {step.level: step for step in known.steps}
    assert np.isnan(steps[2.0].better_here)
    for level, sd in (("L", 6.0), ("C", 0.0)):
        step = steps[level]
        rows = found.model.matrix(found.region.code([{**best.settings, "bands": one} for one in (level, "L+C")]))
        row = rows[0] - rows[1]
        se = float(fit.s * np.sqrt(row @ fit.covariance_unscaled @ row))
        both = float(np.hypot(sd, se * np.sqrt(fit.df_residual / (fit.df_residual - 2.0))))
        z = step.gain / both
        assert step.better_here == pytest.approx(stats.norm.cdf(z), abs=0.03)
        assert step.loss_here == pytest.approx(both * (stats.norm.pdf(z) + z * stats.norm.cdf(z)), abs=0.1)
        assert step.better_here >= step.better
    # Nothing known of a step is a dash, in both columns: one had it, and the other was empty.
    (told,) = _steps(known)
    assert isinstance(told, Table)
    rows = [row[-2:] for row in told.rows]
    assert all((one.text == NOTHING) == (other.text == NOTHING) for one, other in rows)
    assert {other.text for _, other in rows} > {NOTHING}


def test_with_a_process_gains_hold_the_truth(tmp_path) -> None:
    found = analysis(tmp_path, order=2)
    assert found.fitted.departure.process is not None
    truth = {("dates", 2.0): 4.0, ("dates", 4.0): 8.0, ("bands", "L"): -5.0, ("bands", "C"): -8.0}
    for step in found.steps:
        low, high = step.interval.low, step.interval.high
        assert low - 1.0 <= truth[step.factor, step.level] <= high + 1.0
        assert low < step.gain < high


def test_where_the_quadratic_fails_gains_are_the_processes(tmp_path) -> None:
    """A jump at the last value, which no quadratic has: its own gain lies far from the truth."""
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.choice([-1.0, -1.0 / 3.0, 1.0], 48), rng.uniform(-1.0, 1.0, 48), np.arange(48) % 3])
    scores = 50.0 + 30.0 / (1.0 + np.exp(-14.0 * points[:, 1])) + 4.0 * points[:, 0] + rng.normal(scale=0.3, size=48)
    text = specification(FACTORS)
    found = campaign(tmp_path / "c", text, points, scores).analyse_all(n_draws=1000, thorough=True)[0]
    assert found.fitted.departure.probability > 0.99
    for step in found.steps:
        truth = {("dates", 2.0): 8.0 / 3.0, ("dates", 4.0): 16.0 / 3.0}.get((step.factor, step.level), 0.0)
        assert step.interval.low <= step.gain <= step.interval.high
        assert step.interval.low - 1.0 <= truth <= step.interval.high + 1.0
        assert step.interval.half_width < 6.0
        assert step.factor == "bands" or step.better > 0.9


def test_a_step_that_a_constraint_forbids_is_left_out(tmp_path, monkeypatch) -> None:
    found = analysis(tmp_path, more='[[constraint]]\nexpr = "dates * count(bands) <= 4"\n')
    assert not any(step.factor == "bands" and step.level == "L+C" for step in found.steps)
    assert all(step.level != 4.0 or found.optimum.settings["bands"] != "L+C" for step in found.steps)
    opened = Campaign.open(tmp_path / "c")
    assert (found.optimum.settings["dates"], found.optimum.settings["bands"]) == (4.0, "L")
    monkeypatch.setattr(grounds, "bundle_tasks", lambda spec, settings, cells, worlds: [settings] * 2 * len(worlds))
    monkeypatch.setattr(grounds, "scores_of", lambda tasks, *_: np.zeros(len(tasks)))
    monkeypatch.setattr(Grounds, "_bundle", lambda *_: np.zeros((16, 2)))
    assert [one["level"] for one in Grounds(opened.spec, opened.store)._other_levels(found)] == ["C"]


def test_levels_are_held_against_the_recommended_one_over_the_same_grounds(tmp_path, monkeypatch) -> None:
    """What a ground does to all levels alike is no difference between them; a level's own is, and chance is not."""
    found = analysis(tmp_path)
    opened, own = Campaign.open(tmp_path / "c"), {"L": 3.0, "C": 0.0, "L+C": 0.0}
    monkeypatch.setattr(grounds, "bundle_tasks", lambda spec, settings, cells, worlds: [settings] * 2 * len(worlds))
    common = 20.0 * np.repeat(np.random.default_rng(1).standard_normal(8), 2)
    ground = np.repeat([-1.0, 1.0] * 4, 2)

    def scores(tasks, *_):
        return np.concatenate([60.0 + common + own[one["bands"]] * ground for one in tasks[::16]])

    here = scores([found.optimum.settings]).reshape(-1, 2)
    monkeypatch.setattr(Grounds, "_bundle", lambda *_: here)
    monkeypatch.setattr(grounds, "scores_of", scores)
    levels = Grounds(opened.spec, opened.store)._other_levels(found)
    assert [(one["factor"], one["level"]) for one in levels] == [("bands", "L"), ("bands", "C")]
    assert [one["sd"] for one in levels] == pytest.approx([3.0 * np.sqrt(8.0 / 7.0), 0.0], abs=1e-4)
    # One occasion that failed leaves its ground out: two of eight.
    common[[0, 3]] = np.nan
    levels = Grounds(opened.spec, opened.store)._other_levels(found)
    assert [one["sd"] for one in levels] == pytest.approx([3.0 * np.sqrt(6.0 / 5.0), 0.0], abs=1e-4)


def test_scores_over_other_grounds_are_of_the_application_that_is_asked_for(monkeypatch) -> None:
    """In the order of the tasks, whichever ends first; one that failed has none."""

    def run_many(_function, tasks, *_, **__):
        for index in (2, 0, 1):
            made = [SimpleNamespace(score=ord(name) + index) for name, _ in tasks[index].utilities]
            yield index, OSError() if index == 1 else SimpleNamespace(scores=made)

    monkeypatch.setattr(grounds, "run_many", run_many)
    task = SimulationTask("psm", 1, 1, {}, {}, "", "", (("a", "one"), ("b", "two"), ("c", "three")))
    np.testing.assert_array_equal(grounds.scores_of([task] * 3, "b"), [98.0, np.nan, 100.0])


def test_how_coarse_the_ground_may_be_is_measured_once_for_each_tolerance(monkeypatch) -> None:
    kept: list[dict[str, float]] = []
    store: Any = SimpleNamespace(
        events=lambda kind: [SimpleNamespace(detail=one) for one in kept],
        add_event=lambda kind, detail, once: kept.append(detail),
    )

    def measured(spec) -> dict[str, float]:
        return {"tolerance": spec.simulator.tolerance, "cells": round(10.0 * spec.simulator.tolerance)}

    monkeypatch.setattr(grounds, "coarsest_within", measured)
    specs: list[Any] = [SimpleNamespace(simulator=SimpleNamespace(tolerance=one)) for one in (0.5, 0.2, 0.5, 0.0)]
    assert [grounds.cells_of_ground(one, store) for one in specs] == [5, 2, 5, 0]
    assert [one["tolerance"] for one in kept] == [0.5, 0.2]


def test_lines_of_levels_stand_side_by_side_at_the_values_of_a_logarithmic_axis(tmp_path) -> None:
    """A thousandth of its length away from 1 is not -1, where a line of the least value was drawn."""
    factors = (
        '[[factor]]\nname = "looks"\nvalues = [1, 4, 16, 64, 256, 1024]\nscale = "log"\n'
        '[[factor]]\nname = "bands"\nlevels = ["L", "C", "L+C"]\n'
    )
    points = np.array([[at, level] for at in np.linspace(-1.0, 1.0, 6) for level in range(3)] * 2)
    scores = 50.0 - 9.0 * (points[:, 0] - 0.2) ** 2 + np.random.default_rng(1).normal(size=36)
    (found,) = campaign(tmp_path / "c", specification(factors), points, scores).analyse_all()
    lines, axes = lines_by_level(found, 0, 1), Figure().add_subplot()
    paint_lines(found, 1, lines, axes)
    drawn = axes.get_lines()
    assert len(drawn) == 3
    for one, line in zip(drawn, lines, strict=True):
        np.testing.assert_allclose(np.log(one.get_xdata()), np.log(line.x), atol=0.012 * np.log(1024.0) + 1e-9)
        np.testing.assert_array_equal(one.get_ydata(), line.mean)


@pytest.mark.usefixtures("least_squares_alone")
def test_a_gain_is_the_difference_of_scores_that_there_can_be(tmp_path) -> None:
    """By the fit alone C scores 115 percent, and L is told to be 50 below an optimum of 100 at a mean of 65."""
    factors = '[[factor]]\nname = "x"\nlow = -1\nhigh = 1\n[[factor]]\nname = "bands"\nlevels = ["L", "C"]\n'
    points = np.tile([[-1.0, 0.0], [1.0, 0.0], [-1.0, 1.0], [1.0, 1.0]], (4, 1))
    scores = np.tile([0.5, 80.0, 80.0, 99.5], 4) + np.random.default_rng(3).uniform(-0.5, 0.5, 16)
    text = specification(factors, rest="[model]\norder = 1\n").replace('"measured"', '"percent_correct"')
    (found,) = campaign(tmp_path / "c", text, points, scores).analyse_all(thorough=True)
    (step,) = found.steps
    assert found.optimum.mean == 100.0
    assert step.gain == pytest.approx(step.mean - 100.0)
    rows = found.model.matrix(found.region.code([{**found.optimum.settings, "bands": level} for level in ("L", "C")]))
    low, high = np.clip(found.posterior.term_draws @ rows.T, 0.0, 100.0).T
    wanted = np.quantile(low - high, [0.025, 0.975])
    assert (step.interval.low, step.interval.high) == pytest.approx(wanted, abs=1.0)
    assert step.interval.low <= step.gain <= step.interval.high


@pytest.mark.parametrize("high", [8e-6, 0.5, 40.0, 3e7])
def test_no_power_of_ten_stands_apart_from_the_ticks_of_an_axis(high) -> None:
    figure = Figure()
    axes = figure.add_subplot()
    set_numeric_axis(axes, "x", ContinuousFactor("a", 0.1 * high, high, unit="m"))
    FigureCanvasAgg(figure).draw()
    assert axes.xaxis.get_offset_text().get_text() == ""
    assert len({label.get_text() for label in axes.get_xticklabels()}) > 2


def test_joint_draws_do_not_depend_on_the_last_digits_of_a_covariance() -> None:
    """Levels that are equally alike have no axes of their own: the digits, which are the processor's, chose these."""
    alike, rounding = 0.8 + 0.2 * np.eye(4), 1e-14 * np.random.default_rng(1).normal(size=(4, 4))

    def drawn(covariance):
        process = SimpleNamespace(joint=lambda points: (np.zeros((1, 4)), covariance[None]))
        belief = SimpleNamespace(
            departure=SimpleNamespace(believed=process, probability=1.0), surface=SimpleNamespace(rows=lambda at: at)
        )
        (found,) = joint_draws(belief, np.eye(4), np.ones((3, 4)), np.random.default_rng(2))
        return found[0]

    first, other = drawn(alike), drawn(alike + rounding + rounding.T)
    np.testing.assert_allclose(first, other, atol=1e-9)
    np.testing.assert_allclose(np.cov(first.T), alike, atol=0.06)
