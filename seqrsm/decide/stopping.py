"""The decision: the chosen interval is narrow enough, and there is reason to believe it.

Stopping as soon as an interval is narrow picks the moments when s happens to be too small. Therefore the rule also asks
for a number of runs (or another guard), pure error, and no significant lack of fit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from seqrsm.arrays import BoolArray
from seqrsm.decide.forecast import Forecast, amount, forecast, futility
from seqrsm.decide.intervals import Agreement
from seqrsm.decide.intervals import half_width as interval_half_width
from seqrsm.decide.rule import StopRule, conditions, rule_half_width

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
    """Whether the quadratic describes the region.

    Attributes
    ----------
    p : float or None
        p of the lack-of-fit test; None where it cannot be made, for ``reason``.
    reason : str
    departure : Departure, optional
        Evidence of a smooth departure from the model, see `_effective_p` for what it decides.
    saturated : bool
        The model has a term for every setting of the region: there is no lack of fit to test.
    """

    p: float | None
    reason: str = ""
    departure: Departure | None = None
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
    found = conditions(
        rule,
        n_runs=n_runs,
        n_terms=n_terms,
        df_pure_error=look.df_pure_error,
        lack_of_fit_p=_effective_p(rule, adequacy),
        half_width=width,
    )
    checks = [
        _interval_check(rule, bool(found["interval"]), width, unit),
        *_count_checks(rule, found, look),
        _lack_of_fit_check(rule, adequacy),
    ]
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


def _interval_check(rule: StopRule, holds: bool, width: float, unit: str) -> Check:
    target = f"the target is ± {amount(rule.half_width, unit)}"
    if not np.isfinite(width):
        return Check("interval", None, f"The {rule.interval_name} has no finite half-width yet; {target}.")
    kinds = {"anytime": ", valid at every look", "spending": ", its error spent over the looks"}
    kind = kinds.get(rule.guard, "")
    now = f"± {amount(width, unit)} ({100 * rule.level:g} %{kind})"
    text = f"The {rule.interval_name} at the optimum is {now}; {target}."
    return Check("interval", holds, text)


def _count_checks(rule: StopRule, found: Mapping[str, BoolArray], look: Look) -> tuple[Check, ...]:
    pure = Check(
        "pure_error",
        bool(found["pure_error"]),
        f"Repeats give {look.df_pure_error} degrees of freedom of pure error; {rule.min_df_pure_error} are asked for.",
    )
    if rule.guard != "runs":
        return (pure,)
    asked = f"{rule.min_runs(look.n_terms)} are asked for ({rule.runs_per_term:g} for each term)"
    text = f"{look.n_runs} runs for {look.n_terms} terms; {asked}."
    return (Check("runs", bool(found["runs"]), text), pure)


def _effective_p(rule: StopRule, adequacy: Adequacy) -> float:
    """P that the rule goes by: 0 lack of fit for certain, 1 none; nan where there is no test.

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
    departure = adequacy.departure
    if adequacy.saturated:
        return 1.0
    p = np.nan if adequacy.p is None else adequacy.p
    if departure is None or not np.isfinite(p):
        return p
    if departure.seen:
        return 0.0
    unlikely = p < NO_CHANCE and departure.noise_evidence < UNEQUAL_NOISE
    excused = p < rule.alpha_lack_of_fit and departure.evidence < NO_DEPARTURE and not unlikely
    return 1.0 if excused else p


def _lack_of_fit_check(rule: StopRule, adequacy: Adequacy) -> Check:
    p, departure = adequacy.p, adequacy.departure
    if adequacy.saturated:
        text = "The model has a term for every setting of the region: there is no lack of fit to test."
        return Check("lack_of_fit", True, text)
    seen = "" if departure is None else f"evidence {departure.evidence:.1f}, limit {departure.limit:.1f}"
    if departure is not None and departure.seen:
        text = f"The quadratic does not describe this region: a smooth departure from it is seen ({seen})."
        return Check("lack_of_fit", False, text)
    if p is None or not np.isfinite(p):
        return Check(
            "lack_of_fit", None, f"Lack of fit cannot be tested{': ' + adequacy.reason if adequacy.reason else ''}."
        )
    if departure is not None and _effective_p(rule, adequacy) != p:
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


def _confirmation_check(rule: StopRule, confirmation: Agreement | None) -> Check:
    if confirmation is None:
        text = f"{rule.replicates} fresh runs at the recommended settings have not been made."
        return Check("confirmation", None, text)
    return Check("confirmation", confirmation.agrees, confirmation.text)
