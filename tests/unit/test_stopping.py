"""The stop rule: every part can fail alone; floors, forecasts and the intervals against closed forms."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from seqrsm.decide.confirmation import Agreement, ConfirmationInterval, confirmation_agrees, confirmation_interval
from seqrsm.decide.stopping import Decision, Look, StopRule, amount, decide, target_problem
from seqrsm.fit.intervals import t_quantile

RULE = StopRule(interval="prediction", half_width=5.0, max_runs=80)
DEPARTED = replace(RULE, acting_terms=15)
GOOD: dict[str, Any] = {
    "n_runs": 50,
    "n_terms": 15,
    "s": 2.0,
    "df_residual": 35,
    "df_pure_error": 6,
    "lack_of_fit": 0.4,
    "h": 0.2,
}


def look(rule: StopRule = RULE, **changes: Any) -> Decision:
    facts = {**GOOD, **changes}
    confirmation, unit = facts.pop("confirmation", None), facts.pop("unit", "")
    return decide(rule, Look(**facts), confirmation, unit)


def agreement(fresh: ConfirmationInterval, predicted: float, *, s: float, df: int, h: float) -> Agreement:
    """Against Student's prediction interval of the mean of as many runs."""
    half = float(stats.t.ppf(0.5 * (1.0 + fresh.level), df)) * s * np.sqrt(1.0 / fresh.n + h)
    return confirmation_agrees(fresh, predicted=predicted, half_width=half, df=df, text="fresh runs {verdict}, {p}")


def holds(decision: Decision) -> dict[str, bool | None]:
    return {check.name: check.holds for check in decision.checks}


def test_all_parts_hold_and_it_stops() -> None:
    decision = look()
    assert decision.held
    assert list(holds(decision)) == ["interval", "runs", "pure_error", "lack_of_fit"]
    assert all(holds(decision).values())
    assert decision.half_width == pytest.approx(stats.t.ppf(0.975, 35) * 2.0 * np.sqrt(1.2))
    assert decision.reasons[0] == "The stop rule is met after 50 runs."
    assert decision.futility == ()


@pytest.mark.parametrize(
    ("part", "changes", "number"),
    [
        ("interval", {"s": 2.3}, "± 5.1"),
        ("runs", {"n_runs": 34}, "35 are required (20 degrees of freedom)"),
        ("runs", {"n_runs": 17, "n_terms": 6}, "18 are required (3 per term)"),
        ("runs", {"n_runs": 12, "n_terms": 3}, "13 are required (10 degrees of freedom)"),
        ("pure_error", {"df_pure_error": 3}, "3 degrees of freedom"),
        ("pure_error", {"df_pure_error": 1}, "1 degree of freedom"),
        ("lack_of_fit", {"lack_of_fit": 0.04}, "significant: the model does not describe this region (p = 0.04"),
    ],
)
def test_each_part_can_fail_alone(part: str, changes: dict[str, Any], number: str) -> None:
    decision = look(**changes)
    assert not decision.held
    failing = [name for name, value in holds(decision).items() if value is not True]
    assert failing == [part]
    text = next(check.text for check in decision.checks if check.name == part)
    assert number in text
    assert decision.reasons == (text,)


def test_untestable_lack_of_fit_does_not_stop_a_campaign() -> None:
    decision = look(lack_of_fit="no settings were repeated")
    assert not decision.held
    assert holds(decision)["lack_of_fit"] is None
    assert any("no settings were repeated" in reason for reason in decision.reasons)


def test_saturated_fit_has_no_interval() -> None:
    decision = look(n_runs=15, df_residual=0, s=float("nan"))
    assert not decision.held
    assert holds(decision)["interval"] is None
    assert decision.runs_needed is None
    assert np.isnan(decision.attainable_half_width)


def test_interval_kinds() -> None:
    t = stats.t.ppf(0.975, 35)
    for kind, share in (("prediction", 1.0), ("prediction_mean", 0.2), ("confidence", 0.0)):
        rule = StopRule(interval=kind, half_width=5.0)  # type: ignore[arg-type]
        assert look(rule).half_width == pytest.approx(t * 2.0 * np.sqrt(share + 0.2))


def test_what_an_interval_has_beyond_the_scatter_of_runs_falls_with_more_of_them() -> None:
    """As that of a logit, of selection bias, of a surface that is no quadratic: the floor is that of runs alone."""
    wide = look(half_width=8.0)
    assert wide.half_width == 8.0
    assert wide.noise_floor == pytest.approx(1.959964 * 2.0, rel=1e-6)
    beyond = (8.0 / (stats.t.ppf(0.975, 35) * 2.0)) ** 2 - 1.0
    expected = stats.t.ppf(0.975, 65) * 2.0 * np.sqrt(1.0 + 1.0 / (1.0 / beyond + 0.4 * 30))
    assert wide.attainable_half_width == pytest.approx(expected)
    narrow = look(half_width=3.95)  # of normal quantiles: Student's alone of 35 degrees of freedom would be 4.06
    assert narrow.attainable_half_width == 3.95


def test_target_below_the_noise_floor_is_told_with_what_can_be_had() -> None:
    rule = StopRule(half_width=3.0, max_runs=80)
    decision = look(rule, unit="percent")
    assert decision.noise_floor == pytest.approx(1.959964 * 2.0, rel=1e-6)
    assert decision.runs_needed is None
    assert not decision.held
    h = 1.0 / (1.0 / 0.2 + 0.4 * 30)
    assert decision.attainable_half_width == pytest.approx(stats.t.ppf(0.975, 65) * 2.0 * np.sqrt(1.0 + h))
    assert decision.attainable_mean_half_width == pytest.approx(stats.t.ppf(0.975, 65) * 2.0 * np.sqrt(0.2 + h))


def test_runs_needed_is_the_smallest_number_that_reaches_the_target() -> None:
    rule = StopRule(interval="confidence", half_width=1.0, max_runs=500)
    needed = look(rule).runs_needed
    assert needed is not None

    def width(n: int) -> float:
        return float(stats.t.ppf(0.975, n - 15) * 2.0 * np.sqrt(1.0 / (5.0 + 0.4 * (n - 50))))

    assert width(needed) <= 1.0 < width(needed - 1)


def test_runs_needed_respects_the_guard() -> None:
    few = {"n_runs": 20, "df_residual": 5, "s": 1.0}
    assert look(**few).runs_needed == 35
    assert look(DEPARTED, **few).runs_needed == 45
    assert "44 runs for 15 terms; 45 are required (3 per term)." in look(DEPARTED, n_runs=44).reasons
    assert look(DEPARTED, n_runs=45).held
    wide = {"n_terms": 28, "df_residual": 40}
    told = "77 runs for 28 terms; 78 are required (3 for each of the 26 terms in factors that matter)."
    assert told in look(replace(RULE, acting_terms=26), n_runs=77, **wide).reasons
    told = "47 runs for 28 terms; 48 are required (20 degrees of freedom)."
    assert told in look(replace(RULE, acting_terms=6), n_runs=47, **wide).reasons
    assert look(replace(RULE, acting_terms=6), n_runs=48, **wide).held
    assert target_problem(replace(DEPARTED, max_runs=44), 2.0, 15).startswith("The stop rule needs at least 45 runs")


def test_a_loss_above_its_limit_goes_on_for_as_many_runs_as_it_is_too_large() -> None:
    rule = replace(RULE, loss=0.5)
    assert look(rule, loss=0.5).held
    assert "The settings are expected to lose 0.12; at most 0.5 is allowed." in look(rule, loss=0.1234).reasons
    decision = look(rule, loss=0.8, unit="percent")
    assert [check.name for check in decision.checks if not check.holds] == ["loss"]
    assert decision.reasons[0] == "The settings are expected to lose 0.8 percent; at most 0.5 percent is allowed."
    assert decision.runs_needed == 80  # of 50
    assert look(rule, loss=0.805).runs_needed == 81
    assert decision.futility == ()
    spent = look(replace(rule, max_runs=79), loss=0.8, unit="percent")
    assert spent.futility == (
        "The budget of 79 runs is too small for an expected loss of 0.5 percent: about 80 runs are needed.",
    )
    # The interval, too, is too wide, and 70 runs would do for it: the two are told apart.
    wide = look(replace(rule, half_width=4.4, max_runs=70), loss=0.8, unit="percent")
    assert [line.partition(":")[0] for line in wide.futility] == [
        "The budget of 70 runs is too small for an expected loss of 0.5 percent"
    ]


def test_what_misses_its_target_is_not_told_as_the_target() -> None:
    decision = look(replace(RULE, half_width=4.448, loss=0.8), loss=0.8004)
    assert decision.reasons == ("The settings are expected to lose 0.8004; at most 0.8 is allowed.",)
    interval = look(replace(RULE, half_width=4.449)).checks[0]  # of 4.44774
    assert interval.holds
    assert "is ± 4.448 (95 %); the target is ± 4.449." in interval.text


def test_confirmation_runs_among_the_runs_are_beyond_the_budget_of_what_is_needed() -> None:
    needed = look(StopRule(interval="confidence", half_width=0.8, max_runs=80)).runs_needed  # 0.80 of 1.82
    assert needed is not None
    few = StopRule(interval="confidence", half_width=0.8, max_runs=needed - 3)
    lossy = replace(RULE, loss=0.5, max_runs=77)  # 80 of 50 runs for 0.8
    for rule, loss, short in ((few, 0.0, "target"), (lossy, 0.8, "an expected loss")):
        for confirming, told in ((0, True), (2, True), (3, False)):
            found = look(rule, loss=loss, n_confirmation=confirming)
            assert any(f"is too small for {'the ' * (loss == 0.0)}{short}" in text for text in found.futility) == told
    terms = look(replace(RULE, max_runs=33), n_runs=32, n_confirmation=2)  # 35 for 15 terms
    assert "more than the budget" not in str(terms.reasons)
    assert "more than the budget of 33 runs" in str(look(replace(RULE, max_runs=33), n_runs=32).reasons)


def test_lack_of_fit_is_significant_below_five_percent() -> None:
    assert [holds(look(lack_of_fit=p))["lack_of_fit"] for p in (0.0499, 0.05)] == [False, True]


def test_budget_that_cannot_reach_the_target() -> None:
    rule = StopRule(interval="confidence", half_width=0.5, max_runs=80)
    decision = look(rule)
    assert decision.runs_needed is not None
    assert decision.runs_needed > 80
    assert any("too small for the target" in line and str(decision.runs_needed) in line for line in decision.futility)


def test_a_target_below_the_noise_floor_is_told_with_what_the_mean_of_runs_would_give() -> None:
    """Where the interval is of that mean already there is no such way out, and more runs do narrow it to the floor."""
    floor = f"± {stats.norm.ppf(0.975) * 2.0:.3g} percent."
    told = look(replace(RULE, half_width=3.0), unit="percent").futility
    head = (
        "The target of ± 3 percent is below the noise floor: by the scatter so far (35 degrees of freedom) no number "
        "of runs brings the prediction interval of"
    )
    assert told[0] == f"{head} one future run below {floor}"
    assert told[1].startswith("The mean of 5 future runs could be predicted to ± ")
    ground = replace(RULE, interval="prediction_mean", half_width=0.5, ground_share=0.5, counts_ground=True)
    floor = f"± {stats.norm.ppf(0.975) * 2.0 * np.sqrt(0.5 + 0.5 / 5):.3g} percent."
    assert look(ground, unit="percent").futility == (
        f"{head.replace('3 percent', '0.5 percent')} the mean of 5 future runs below {floor}",
    )


def test_a_budget_below_the_runs_that_the_rule_asks_for_is_told() -> None:
    """However narrow the interval is: by the interval and the loss alone the campaign seemed to need 33 runs more."""
    decision = look(replace(RULE, half_width=30.0, max_runs=56), n_runs=39, n_terms=36, df_residual=3)
    assert decision.reasons == ("39 runs for 36 terms; 56 are required (20 degrees of freedom).",)
    decision = look(replace(RULE, half_width=30.0, max_runs=55), n_runs=39, n_terms=36, df_residual=3)
    assert decision.reasons[0].endswith("56 are required (20 degrees of freedom), more than the budget of 55 runs.")


def test_spent_budget_is_told() -> None:
    decision = look(n_runs=80, df_residual=65, df_pure_error=1)
    assert decision.budget_spent
    assert any("budget of 80 runs was spent" in reason for reason in decision.reasons)


def test_no_parameter_matters() -> None:
    assert any("No factor has a significant effect" in line for line in look(model_p=0.6, df_pure_error=0).futility)
    assert not any("No factor" in line for line in look(model_p=0.001, df_pure_error=0).futility)
    early = look(model_p=0.6, df_residual=3, n_runs=18)
    assert not any("No factor" in line for line in early.futility)


def test_confirmation_guard_waits_for_fresh_runs() -> None:
    rule = StopRule(half_width=5.0, guard="confirmation")
    waiting = look(rule, n_runs=25, df_residual=10, s=1.5)
    assert not waiting.held
    assert waiting.wants_confirmation
    assert holds(waiting)["confirmation"] is None
    assert waiting.reasons == ("Confirmation runs at the recommended settings are still to be made.",)
    early = look(rule, n_runs=25, df_residual=10, s=3.0)  # `propose` issues none yet, and none after the budget
    assert not early.wants_confirmation
    assert "Confirmation runs follow once all else is met." in early.reasons
    fresh = confirmation_interval([80.1, 81.0, 79.5, 80.4, 80.2])
    good = agreement(fresh, 80.0, s=1.5, df=10, h=0.2)
    assert look(rule, n_runs=25, df_residual=10, s=1.5, confirmation=good).held
    bad = agreement(fresh, 90.0, s=1.5, df=10, h=0.2)
    refused = look(rule, n_runs=25, df_residual=10, s=1.5, confirmation=bad)
    assert not refused.held
    assert not refused.wants_confirmation
    assert bad.text in refused.reasons


def test_disagreeing_confirmation_is_told_under_the_other_guards() -> None:
    fresh = confirmation_interval([80.1, 81.0, 79.5])
    bad = agreement(fresh, 90.0, s=1.5, df=10, h=0.2)
    assert bad.text in look(confirmation=bad).reasons


# before the first run -------------------------------------------------------------------------------------------------


def test_reachable_target_is_no_problem() -> None:
    assert target_problem(StopRule(half_width=5.0, max_runs=60), 2.0, 15) == ""
    # No design tells a mean better than all runs made there.
    least = stats.t.ppf(0.975, 45) * 2.0 / np.sqrt(60)
    rules = [StopRule("confidence", share * least, max_runs=60) for share in (1.001, 0.999)]
    assert [target_problem(rule, 2.0, 15, "percent") for rule in rules] == [
        "", f"60 runs cannot reach a half-width of {0.999 * least:.3g} percent."
    ]  # fmt: skip


def test_unreachable_targets_are_explained() -> None:
    floor = target_problem(StopRule(half_width=3.0, max_runs=60), 2.0, 15, "percent")
    assert "below the noise floor" in floor
    assert "3.92 percent" in floor
    h = stats.t.ppf(0.975, 45) * 2.0 * np.sqrt(0.2 + 15 / 60)
    assert floor.endswith(f"below ± 3.92 percent; about ± {h:.3g} percent is attainable for the mean of 5 runs.")
    budget = target_problem(StopRule(interval="confidence", half_width=0.1, max_runs=60), 2.0, 15)
    assert "60 runs cannot reach" in budget
    assert "35 runs" in target_problem(StopRule(half_width=5.0, max_runs=34), 2.0, 15)
    # One degree of freedom: Student's t is 12.7, not 2.
    one = StopRule(half_width=10.0, max_runs=16, guard="confirmation")
    assert "16 runs cannot reach a half-width of 10" in target_problem(one, 1.0, 15)
    assert "no degree of freedom" in target_problem(
        StopRule(half_width=5.0, max_runs=15, guard="confirmation"), 2.0, 15
    )


# intervals ------------------------------------------------------------------------------------------------------------


def test_t_quantile_equals_scipy_and_ends_in_the_normal() -> None:
    df = np.array([1.0, 2.0, 7.0, 100.0])
    np.testing.assert_allclose(t_quantile(df, 0.9), stats.t.ppf(0.95, df), rtol=1e-10)
    assert t_quantile(np.inf, 0.95) == pytest.approx(1.959963984540054, rel=1e-9)
    assert np.isnan(t_quantile(0, 0.95))


def test_noise_floor_of_the_mean_of_m_runs() -> None:
    assert StopRule(interval="prediction_mean", replicates=4).noise_floor(2.0) == pytest.approx(1.959964)
    assert StopRule(interval="confidence").noise_floor(2.0) == 0.0


def test_confirmation_interval_is_the_t_interval() -> None:
    scores = [71.0, 73.5, 70.2, 74.1, 72.0]
    found = confirmation_interval(scores, 0.9)
    low, high = stats.t.interval(0.9, 4, np.mean(scores), stats.sem(scores))
    assert (found.low, found.high) == (pytest.approx(low), pytest.approx(high))


def test_agreement_is_the_prediction_interval_of_the_mean() -> None:
    fresh = confirmation_interval([71.0, 73.5, 70.2, 74.1, 72.0])
    se = 1.8 * np.sqrt(1 / 5 + 0.3)
    limit = stats.t.ppf(0.975, 12) * se
    for sign in (-1.0, 1.0):
        inside = agreement(fresh, fresh.mean + 0.999 * sign * limit, s=1.8, df=12, h=0.3)
        outside = agreement(fresh, fresh.mean + 1.001 * sign * limit, s=1.8, df=12, h=0.3)
        assert inside.agrees
        assert not outside.agrees
        near = agreement(fresh, fresh.mean + 0.4 * sign, s=1.8, df=12, h=0.3)
        assert near.p == pytest.approx(2.0 * stats.t.sf(0.4 / se, 12))
    # Runs that all scored the same foretell exactly that.
    assert [agreement(fresh, fresh.mean + off, s=0.0, df=12, h=0.3).p for off in (0.0, 0.1)] == [1.0, 0.0]
    assert outside.text == "fresh runs contradicting, 0.05"  # 0.0499
    assert near.text.startswith("fresh runs in line with, 0.")


def test_where_a_departure_is_weighed_repeats_and_lack_of_fit_are_not_asked_about() -> None:
    bare = {"df_pure_error": 0, "lack_of_fit": 1e-9}
    assert not look(**bare).held
    decision = look(**bare, weighed=True)
    assert list(holds(decision)) == ["interval", "runs"]
    assert decision.held
    assert not look(**bare, weighed=True, s=2.5).held  # the interval
    assert not look(**bare, weighed=True, n_runs=34).held


def test_a_saturated_region_has_no_lack_of_fit_to_test() -> None:
    decision = look(lack_of_fit="no settings were repeated", saturated=True)
    assert holds(decision)["lack_of_fit"] is True
    assert decision.held


@pytest.mark.parametrize(
    ("known_map", "says"), [(False, "Guessing without an image"), (True, "The existing map alone")]
)
def test_what_the_images_are_held_against_is_named(known_map: bool, says: str) -> None:
    look = Look(60, 6, 2.0, 54, 5, 0.1, 0.5, guess=60.7, lead=0.1, known_map=known_map)
    (check,) = [one for one in decide(StopRule(half_width=5.0), look, None, "percent").checks if one.name == "guess"]
    assert check.text.startswith(f"{says} scores 60.7 percent; ")
    assert "; the optimum is better by 0.1 percent, less than its half-width, so" in check.text
    assert check.text.endswith(f"beat {'the existing map' if known_map else 'guessing'}.")
    worse = decide(StopRule(half_width=5.0), replace(look, lead=-3.0), None, "percent").checks
    (check,) = [one for one in worse if one.name == "guess"]
    assert "; the optimum is no better, so no setting" in check.text


@pytest.mark.parametrize(
    ("value", "target", "told"),
    [(3372.7, 3000.0, "3370 m"), (999.6, 1500.0, "1000 m"), (14000.0, np.nan, "14000 m"), (3000.4, 3000.0, "3000.4 m"),
     (0.0512, 1.0, "0.0512 m"), (2.5e9, np.nan, "2.5e+09 m")],
)  # fmt: skip
def test_large_amounts_are_told_in_digits(value, target, told) -> None:
    """As the report tells them; 3.37e+03 stood in the reasons of a decision."""
    assert amount(value, "m", target) == told
