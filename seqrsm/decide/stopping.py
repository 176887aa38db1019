"""The decision: the chosen interval is narrow enough, and there is reason to believe it.

Stopping as soon as an interval is narrow picks the moments when s happens to be too small. Therefore the rule also asks
for a number of runs (or another guard), pure error, no significant lack of fit, and the same at two consecutive looks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from seqrsm.arrays import BoolArray
from seqrsm.decide.forecast import amount, forecast, futility, target_problem
from seqrsm.decide.intervals import Agreement
from seqrsm.decide.intervals import half_width as interval_half_width
from seqrsm.decide.rule import Guard, StopRule, conditions, rule_half_width

__all__ = [
    "NO_DEPARTURE",
    "Check",
    "Decision",
    "Departure",
    "Guard",
    "StopRule",
    "conditions",
    "decide",
    "rule_half_width",
    "target_problem",
]


NO_DEPARTURE = 1.0
"""Evidence of a smooth departure below which there is none to speak of."""

UNEQUAL_NOISE = 2.7
"""Evidence of unequal noise from which it explains a significant test against pure error: 5 % under equal noise."""

NO_CHANCE = 0.01
"""P of the test against pure error below which chance does not explain it."""


@dataclass(frozen=True, slots=True)
class Check:
    """One part of the rule.

    Attributes
    ----------
    name : str
        "interval", "runs", "pure_error", "lack_of_fit", "two_looks" or "confirmation".
    holds : bool or None
        None: it cannot be tested yet, which counts as not holding.
    text : str
        One sentence with the numbers.
    """

    name: str
    holds: bool | None
    text: str


@dataclass(frozen=True, slots=True)
class Decision:
    """Stop or go on, and why.

    Attributes
    ----------
    held : bool
        The whole rule holds: stop.
    conditions_hold : bool
        All holds at this look, before "two_looks" and "confirmation"; hand it to the next look as
        ``held_at_previous_look``.
    checks : tuple of Check
        Every part of the rule.
    half_width : float
        Half-width the rule looked at (with the guard "anytime" the wider one), score units.
    noise_floor : float
        Half-width that no number of runs can go below, score units.
    attainable_half_width : float
        Half-width expected when the budget is spent, score units.
    attainable_mean_half_width : float
        The same for the mean of ``replicates`` runs, score units.
    runs_needed : int or None
        Estimated total number of runs until the rule holds; None: out of reach.
    budget_spent : bool
        ``n_runs >= max_runs``.
    wants_confirmation : bool
        Nothing but the fresh runs is missing.
    futility : tuple of str
        Why going on may be useless.
    reasons : tuple of str
        The decision in sentences: what is missing, floors, budget, futility.
    """

    held: bool
    conditions_hold: bool
    checks: tuple[Check, ...]
    half_width: float
    noise_floor: float
    attainable_half_width: float
    attainable_mean_half_width: float
    runs_needed: int | None
    budget_spent: bool
    wants_confirmation: bool
    futility: tuple[str, ...]
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Departure:
    """A smooth departure from the model; see :mod:`seqrsm.decide.discrepancy`.

    Attributes
    ----------
    evidence : float
        Twice the gain of the restricted log likelihood, beyond what unequal noise gains.
    limit : float
        From which it counts.
    noise_evidence : float
        The same of noise that is larger where scores are poorer.
    noise_ratio : float
        Standard deviation of a run where scores are poorest over that where they are best.
    """

    evidence: float
    limit: float
    noise_evidence: float = 0.0
    noise_ratio: float = 1.0

    @property
    def seen(self) -> bool:
        """Whether there is lack of fit, whatever pure error says: no rule holds then."""
        return self.evidence > self.limit


def decide(
    rule: StopRule,
    *,
    n_runs: int,
    n_terms: int,
    s: float,
    df_residual: int,
    df_pure_error: int,
    lack_of_fit_p: float | None,
    h: float,
    half_width: float | None = None,
    held_at_previous_look: bool = False,
    lack_of_fit_reason: str = "",
    saturated: bool = False,
    model_p: float | None = None,
    confirmation: Agreement | None = None,
    unit: str = "",
    n_spent: int | None = None,
    n_before: int = 0,
    departure: Departure | None = None,
    widening: float = 1.0,
) -> Decision:
    """Apply the rule to one look.

    Parameters
    ----------
    rule : StopRule
    n_runs, n_terms : int
        Scored runs and terms of the model.
    s, df_residual : float, int
        Residual standard deviation (nan without degrees of freedom) and its degrees of freedom.
    df_pure_error : int
        Degrees of freedom of pure error.
    lack_of_fit_p : float or None
        p of the lack-of-fit test; None where it cannot be made, for ``lack_of_fit_reason``.
    saturated : bool
        The model has a term for every setting of the region: there is no lack of fit to test.
    h : float
        ``z0' (Z'WZ)^-1 z0`` at the optimum.
    half_width : float, optional
        Half-width of the rule's Student interval in score units, where the fit is on another scale than the scores; by
        default computed from ``s`` and ``h``. Floors and forecasts are scaled by it.
    held_at_previous_look : bool
        ``conditions_hold`` of the look before.
    model_p : float, optional
        p of the F test that no term but the intercept matters.
    confirmation : Agreement, optional
        Test of fresh runs at the recommended settings.
    unit : str
        Unit of the score, for the sentences.
    n_spent : int, optional
        Scored runs that count against the budget, where the fit leaves some out; ``n_runs`` by default.
    n_before : int
        The same at the look before, 0 for the first: for the guard "spending".
    departure : Departure, optional
        Evidence of a smooth departure from the model, see `_effective_p` for what it decides.

    widening : float
        What a departure from the model, too small to be seen, does to the half-width: a factor >= 1, see
        :mod:`seqrsm.decide.allowance`.

    Returns
    -------
    Decision
    """
    spent = n_runs if n_spent is None else n_spent
    if saturated:
        lack_of_fit_p, departure = 1.0, None
    # What is left of the budget goes to the runs that are fitted.
    budget = replace(rule, max_runs=max(rule.max_runs - (spent - n_runs), 1))
    student = float(interval_half_width(rule.interval, s, df_residual, h, rule.level, rule.replicates))
    scale = 1.0
    if half_width is not None and student > 0.0 and np.isfinite(student) and np.isfinite(half_width):
        scale = half_width / student
    width = float("nan")
    if df_residual > 0:
        width = float(rule_half_width(rule, s, df_residual, h, n_terms, n_runs=spent, n_before=n_before))
        width *= scale * widening
    found = conditions(
        rule,
        n_runs=n_runs,
        n_terms=n_terms,
        df_pure_error=df_pure_error,
        lack_of_fit_p=np.nan if lack_of_fit_p is None else _effective_p(rule, lack_of_fit_p, departure),
        half_width=width,
    )
    now = all(bool(value) for value in found.values())
    checks = [
        _interval_check(rule, bool(found["interval"]), width, unit, widening),
        *_count_checks(rule, found, n_runs, n_terms, df_pure_error),
        _SATURATED if saturated else _lack_of_fit_check(rule, lack_of_fit_p, lack_of_fit_reason, departure),
    ]
    if rule.looks == 2:
        checks.append(_two_looks_check(now, held_at_previous_look))
    before_confirmation = all(check.holds is True for check in checks)
    if rule.guard == "confirmation":
        checks.append(_confirmation_check(rule, confirmation))
    held = all(check.holds is True for check in checks)
    ahead = forecast(budget, n_runs=n_runs, n_terms=n_terms, s=s * scale, h=h)
    useless = futility(budget, ahead, n_terms=n_terms, df_residual=df_residual, model_p=model_p, width=width, unit=unit)
    budget_spent = spent >= rule.max_runs
    reasons = [check.text for check in checks if check.holds is not True]
    if held:
        reasons = [f"The stop rule holds after {n_runs} runs.", *(check.text for check in checks)]
    elif budget_spent:
        reasons.append(f"The budget of {rule.max_runs} runs is spent before the stop rule held.")
    if confirmation is not None and not confirmation.agrees and rule.guard != "confirmation":
        reasons.append(confirmation.text)
    return Decision(
        held=held,
        conditions_hold=now,
        checks=tuple(checks),
        half_width=width,
        noise_floor=ahead.noise_floor,
        attainable_half_width=ahead.attainable_half_width,
        attainable_mean_half_width=ahead.attainable_mean_half_width,
        runs_needed=None if ahead.runs_needed is None else ahead.runs_needed + spent - n_runs,
        budget_spent=budget_spent,
        wants_confirmation=rule.guard == "confirmation" and before_confirmation and confirmation is None,
        futility=() if held else useless,
        reasons=tuple(reasons if held else [*reasons, *useless]),
    )


def _interval_check(rule: StopRule, holds: bool, width: float, unit: str, widening: float) -> Check:
    target = f"the target is ± {amount(rule.half_width, unit)}"
    if not np.isfinite(width):
        return Check("interval", None, f"The {rule.interval_name} has no finite half-width yet; {target}.")
    kinds = {"anytime": ", valid at every look", "spending": ", its error spent over the looks"}
    kind = kinds.get(rule.guard, "")
    departure = f", {100 * (widening - 1.0):.0f} % of it for departures from the model" if widening >= 1.005 else ""
    text = (
        f"The {rule.interval_name} at the optimum is ± {amount(width, unit)} "
        f"({100 * rule.level:g} %{kind}{departure}); {target}."
    )
    return Check("interval", holds, text)


def _count_checks(
    rule: StopRule, found: Mapping[str, BoolArray], n_runs: int, n_terms: int, df_pure_error: int
) -> tuple[Check, ...]:
    pure = Check(
        "pure_error",
        bool(found["pure_error"]),
        f"Repeats give {df_pure_error} degrees of freedom of pure error; {rule.min_df_pure_error} are asked for.",
    )
    if rule.guard != "runs":
        return (pure,)
    asked = f"{rule.min_runs(n_terms)} are asked for ({rule.runs_per_term:g} for each term)"
    text = f"{n_runs} runs for {n_terms} terms; {asked}."
    return (Check("runs", bool(found["runs"]), text), pure)


def _effective_p(rule: StopRule, p: float, departure: Departure | None) -> float:
    """P that the rule goes by: 0 lack of fit for certain, 1 none.

    The test against pure error takes the noise at the repeats, which lie at the optimum, for the noise everywhere.
    Where noise is larger at poorer scores it rejects quadratics that are right; and it has little power. The evidence
    of a smooth departure, which allows for such noise, is the better test and has the first word:

    * above its limit there is lack of fit, whatever pure error says;
    * next to none (below `NO_DEPARTURE`) and p < alpha: no lack of fit, unless p is below `NO_CHANCE` with no evidence
      of unequal noise (`UNEQUAL_NOISE`) to explain it: then the departure is rough, and it counts;
    * otherwise p decides.

    Measured with k = 2, 24 runs and k = 3, 30 runs, 2000 data sets each, standard error 1 % or less (the study is
    ``tests/studies/statistics_study.py``, its table ``reports/statistics/README.md``): the rule blocks 5 and 4 % of
    right quadratics with equal noise (the test alone 6 and 5 %); 15 and 24 % where the noise at the optimum is 0.4 of
    that elsewhere (14 and 34 %); smooth departures as large as the noise 69 to 100 and 44 to 100 % (35 to 68 and 21 to
    63 %). Excused are 2 to 3 % of right quadratics with equal noise, 4 and 12 % of those with unequal noise, 1 % or
    less of smooth departures of that size, and 7 % of a rough one. The 95 % prediction interval at the fitted optimum
    covers one future run in 94 to 95 % under equal noise and 97 to 100 % under unequal noise; the mean of five runs in
    35 to 85 % where a smooth departure as large as the noise passes: no test sees all of them.
    """
    if departure is None or not np.isfinite(p):
        return p
    if departure.seen:
        return 0.0
    unlikely = p < NO_CHANCE and departure.noise_evidence < UNEQUAL_NOISE
    excused = p < rule.alpha_lack_of_fit and departure.evidence < NO_DEPARTURE and not unlikely
    return 1.0 if excused else p


def _lack_of_fit_check(rule: StopRule, p: float | None, reason: str, departure: Departure | None) -> Check:
    seen = "" if departure is None else f"evidence {departure.evidence:.1f}, limit {departure.limit:.1f}"
    if departure is not None and departure.seen:
        text = f"The quadratic does not describe this region: a smooth departure from it is seen ({seen})."
        return Check("lack_of_fit", False, text)
    if p is None or not np.isfinite(p):
        return Check("lack_of_fit", None, f"Lack of fit cannot be tested{': ' + reason if reason else ''}.")
    if departure is not None and _effective_p(rule, p, departure) != p:
        why = (
            f"the noise grows where scores are poorer (about {departure.noise_ratio:.1f} times from the best to the "
            f"poorest, evidence {departure.noise_evidence:.1f}), while the repeats lie where they are good"
            if departure.noise_evidence >= UNEQUAL_NOISE
            else "chance gives that to one right quadratic in twenty, and the more powerful test sees nothing"
        )
        text = (
            f"No smooth departure from the quadratic is seen ({seen}). The test against pure error alone gives "
            f"p = {p:.2g}, but {why}."
        )
        return Check("lack_of_fit", True, text)
    holds = p >= rule.alpha_lack_of_fit
    verdict = "not significant" if holds else "significant: the quadratic does not describe this region"
    return Check("lack_of_fit", holds, f"Lack of fit is {verdict} (p = {p:.2g}, limit {rule.alpha_lack_of_fit:g}).")


_SATURATED = Check(
    "lack_of_fit", True, "The model has a term for every setting of the region: there is no lack of fit to test."
)


def _two_looks_check(now: bool, before: bool) -> Check:
    if now and before:
        return Check("two_looks", True, "All of this held at the look before, too.")
    if now:
        return Check("two_looks", False, "All of this holds for the first time; it must hold at two consecutive looks.")
    return Check("two_looks", False, "It must hold at two consecutive looks.")


def _confirmation_check(rule: StopRule, confirmation: Agreement | None) -> Check:
    if confirmation is None:
        text = f"{rule.replicates} fresh runs at the recommended settings have not been made."
        return Check("confirmation", None, text)
    return Check("confirmation", confirmation.agrees, confirmation.text)
