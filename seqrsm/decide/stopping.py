"""The decision: the chosen interval is narrow enough, and there is reason to believe it.

Stopping as soon as an interval is narrow picks the moments when s happens to be too small. Therefore the rule also asks
for a number of runs (or another guard). Where the interval is that of a quadratic alone it asks for pure error and for
no significant lack of fit, too; elsewhere the chance of a surface that is no quadratic is part of the interval.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from seqrsm.decide.forecast import Forecast, amount, forecast, futility
from seqrsm.decide.intervals import Agreement
from seqrsm.decide.intervals import half_width as interval_half_width
from seqrsm.decide.rule import StopRule, rule_half_width


@dataclass(frozen=True, slots=True)
class Check:
    """One part of the rule.

    Attributes
    ----------
    name : str
        "interval", "runs", "pure_error", "lack_of_fit" or "confirmation".
    holds : bool or None
        None: it cannot be tested yet, which counts as not holding.
    text : str
        One sentence with the numbers.
    """

    name: str
    holds: bool | None
    text: str


@dataclass(frozen=True, slots=True)
class Decision(Forecast):
    """Stop or go on, and why; with what more runs would give.

    Attributes
    ----------
    held : bool
        The whole rule holds: stop.
    checks : tuple of Check
        Every part of the rule.
    half_width : float
        Half-width the rule looked at (with the guard "anytime" the wider one), score units.
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
    checks: tuple[Check, ...]
    half_width: float
    budget_spent: bool
    wants_confirmation: bool
    futility: tuple[str, ...]
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Look:
    """What one look at the scores says of the interval at the optimum.

    Attributes
    ----------
    n_runs, n_terms : int
        Scored runs and terms of the model.
    s, df_residual : float, int
        Residual standard deviation (nan without degrees of freedom) and its degrees of freedom.
    df_pure_error : int
        Degrees of freedom of pure error.
    h : float
        ``z0' (Z'WZ)^-1 z0`` at the optimum.
    half_width : float, optional
        Half-width of the rule's Student interval in score units, where the fit is on another scale than the scores; by
        default computed from ``s`` and ``h``. Floors and forecasts are scaled by it.
    model_p : float, optional
        p of the F test that no term but the intercept matters.
    n_before : int
        Scored runs at the look before, 0 where there was none.
    """

    n_runs: int
    n_terms: int
    s: float
    df_residual: int
    df_pure_error: int
    h: float
    half_width: float | None = None
    model_p: float | None = None
    n_before: int = 0


@dataclass(frozen=True, slots=True)
class Adequacy:
    """Whether the model describes the region.

    Attributes
    ----------
    p : float or None
        p of the lack-of-fit test; None where it cannot be made, for ``reason``.
    reason : str
    weighed : bool
        A surface that is no quadratic is part of the intervals, by its probability: then neither lack of fit nor pure
        error is asked about.
    saturated : bool
        The model has a term for every setting of the region: there is no lack of fit to test.
    """

    p: float | None
    reason: str = ""
    weighed: bool = False
    saturated: bool = False


def decide(
    rule: StopRule,
    look: Look,
    adequacy: Adequacy,
    confirmation: Agreement | None = None,
    unit: str = "",
) -> Decision:
    """Apply the rule to one look.

    Parameters
    ----------
    rule : StopRule
    look : Look
    adequacy : Adequacy
    confirmation : Agreement, optional
        Test of fresh runs at the recommended settings.
    unit : str
        Unit of the score, for the sentences.

    Returns
    -------
    Decision
    """
    n_runs, n_terms, s, df_residual, h = look.n_runs, look.n_terms, look.s, look.df_residual, look.h
    student = float(interval_half_width(rule.interval, s, df_residual, h, rule.level, rule.replicates))
    scale = 1.0
    if look.half_width is not None and student > 0.0 and np.isfinite(student) and np.isfinite(look.half_width):
        scale = look.half_width / student
    width = float("nan")
    if df_residual > 0:
        width = float(rule_half_width(rule, s, df_residual, h, n_terms, n_runs=n_runs, n_before=look.n_before))
        width *= scale
    checks = [_interval_check(rule, width, unit)]
    if rule.guard == "runs":
        asked = f"{rule.min_runs(n_terms)} are asked for ({rule.runs_per_term:g} for each term)"
        enough = n_runs >= rule.min_runs(n_terms)
        checks.append(Check("runs", enough, f"{n_runs} runs for {n_terms} terms; {asked}."))
    if not adequacy.weighed:
        checks += [_pure_error_check(rule, look.df_pure_error), _lack_of_fit_check(rule, adequacy)]
    before_confirmation = all(check.holds is True for check in checks)
    if rule.guard == "confirmation":
        checks.append(_confirmation_check(rule, confirmation))
    held = all(check.holds is True for check in checks)
    ahead = forecast(rule, n_runs=n_runs, n_terms=n_terms, s=s * scale, h=h)
    useless = futility(
        rule, ahead, n_terms=n_terms, df_residual=df_residual, model_p=look.model_p, width=width, unit=unit
    )
    budget_spent = n_runs >= rule.max_runs
    reasons = [check.text for check in checks if check.holds is not True]
    if held:
        reasons = [f"The stop rule holds after {n_runs} runs.", *(check.text for check in checks)]
    elif budget_spent:
        reasons.append(f"The budget of {rule.max_runs} runs is spent before the stop rule held.")
    if confirmation is not None and not confirmation.agrees and rule.guard != "confirmation":
        reasons.append(confirmation.text)
    return Decision(
        held=held,
        checks=tuple(checks),
        half_width=width,
        **asdict(ahead),
        budget_spent=budget_spent,
        wants_confirmation=rule.guard == "confirmation" and before_confirmation and confirmation is None,
        futility=() if held else useless,
        reasons=tuple(reasons if held else [*reasons, *useless]),
    )


def _interval_check(rule: StopRule, width: float, unit: str) -> Check:
    target = f"the target is ± {amount(rule.half_width, unit)}"
    if not np.isfinite(width):
        return Check("interval", None, f"The {rule.interval_name} has no finite half-width yet; {target}.")
    kinds = {"anytime": ", valid at every look", "spending": ", its error spent over the looks"}
    kind = kinds.get(rule.guard, "")
    now = f"± {amount(width, unit)} ({100 * rule.level:g} %{kind})"
    text = f"The {rule.interval_name} at the optimum is {now}; {target}."
    return Check("interval", width <= rule.half_width, text)


def _pure_error_check(rule: StopRule, df: int) -> Check:
    asked = rule.min_df_pure_error
    text = f"Repeats give {df} degrees of freedom of pure error; {asked} are asked for."
    return Check("pure_error", df >= asked, text)


def _lack_of_fit_check(rule: StopRule, adequacy: Adequacy) -> Check:
    p = adequacy.p
    if adequacy.saturated:
        text = "The model has a term for every setting of the region: there is no lack of fit to test."
        return Check("lack_of_fit", True, text)
    if p is None or not np.isfinite(p):
        return Check(
            "lack_of_fit", None, f"Lack of fit cannot be tested{': ' + adequacy.reason if adequacy.reason else ''}."
        )
    holds = p >= rule.alpha_lack_of_fit
    verdict = "not significant" if holds else "significant: the quadratic does not describe this region"
    return Check("lack_of_fit", holds, f"Lack of fit is {verdict} (p = {p:.2g}, limit {rule.alpha_lack_of_fit:g}).")


def _confirmation_check(rule: StopRule, confirmation: Agreement | None) -> Check:
    if confirmation is None:
        text = f"{rule.replicates} fresh runs at the recommended settings have not been made."
        return Check("confirmation", None, text)
    return Check("confirmation", confirmation.agrees, confirmation.text)
