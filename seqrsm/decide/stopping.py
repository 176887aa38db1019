"""The stop rule, what more runs would give, and the decision.

Stopping as soon as an interval is narrow picks the moments when s happens to be too small. Therefore the rule also asks
for a number of runs (or another guard). Where the interval is that of a quadratic alone it asks for pure error and for
no significant lack of fit, too; elsewhere the chance of a surface that is no quadratic is part of the interval.

All half-widths are ``t * s * sqrt(1/m + h)`` with ``h = z0' (Z'WZ)^-1 z0``: m is 1 for one future run (RSL TR 380-1
eq. (2-23), the factor S restored), and inf for the mean response itself.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from seqrsm.arrays import FloatArray
from seqrsm.decide.confirmation import Agreement
from seqrsm.fit.intervals import MIN_DF_PURE_ERROR, t_quantile
from seqrsm.plain import counted

IntervalKind = Literal["prediction", "prediction_mean", "confidence"]
Guard = Literal["runs", "confirmation"]

LACK_OF_FIT_ALPHA = 0.05
"""Lack of fit with a smaller p stops the stopping."""
_RUNS_PER_TERM = 3  # of the guard "runs"
_LEAST_DF = 10
"""Residual degrees of freedom asked for beside it: with fewer a campaign of one factor ends after 9 runs, between which
a kink or a ripple hides."""
_ENOUGH_DF = 20
"""Residual degrees of freedom that do in place of it, with three runs for each term in factors that matter where
another surface is likelier than the quadratic.

So many has a quadratic in three factors at three runs a term. With four, five and six factors campaigns then end after
37, 43 and 50 runs, in place of 45, 63 and 84, and intervals cover as before (`reports/peers`); with 14, 1 to 2 % less.
Of bells in six factors that all matter a third stopped away from the top by degrees of freedom alone."""
_MOST_FLIGHTS = 1000


def interval_names(replicates: int, one_ground: bool = False) -> dict[str, str]:
    """Return the three intervals at the optimum, in words; ``one_ground``: that of the mean has table uncertainty."""
    return {
        "prediction": "prediction interval of one future run",
        "prediction_mean": f"prediction interval of the mean of {replicates} future runs",
        "confidence": f"confidence interval of the mean{' over one ground' * one_ground}",
    }


@dataclass(frozen=True, slots=True)
class StopRule:
    """When a campaign may stop."""

    interval: IntervalKind = "prediction"
    """The interval at the optimum that must be narrow."""
    half_width: float = 1.0
    """Its target half-width, score units, > 0."""
    loss: float = float("inf")
    """What the settings may be expected to lose against the best ones, score units, > 0."""
    level: float = 0.95
    """Two-sided probability of the interval, in (0, 1)."""
    max_runs: int = 80
    """The budget."""
    replicates: int = 5
    """m of "prediction_mean" and of the confirmation set, >= 2."""
    guard: Guard = "runs"
    """What guards against stopping on a lucky s: enough runs, see `min_runs`, or a set of fresh runs that agrees with
    the model."""
    ground_share: float = 0.0
    """Share of a run's variance that is not chance but one ground against another, 0 to below 1: future runs have it in
    common, and no mean of them is without it."""
    counts_ground: bool = True
    """Whether the target is for the whole interval, or for its part by chance."""
    acting_terms: int = 0
    """Terms of the model in the factors that matter, where the surface is more likely none than a quadratic; else 0."""

    @property
    def interval_name(self) -> str:
        """The interval in words."""
        return interval_names(self.replicates, self.counts_ground and self.ground_share > 0.0)[self.interval]

    def replicates_of(self, interval: IntervalKind | None = None) -> float:
        """Independent runs whose mean scatters as what an interval foretells; inf for a mean without scatter.

        By default the rule's own interval.
        """
        kind = interval or self.interval
        own = {"prediction": 1.0, "prediction_mean": 1.0 / self.replicates, "confidence": 0.0}[kind]
        share = own * (1.0 - self.ground_share) + (self.ground_share if self.counts_ground else 0.0)
        return 1.0 / share if share > 0.0 else float("inf")

    def min_runs(self, n_terms: int) -> int:
        """Fewest runs the guard allows for a model of ``n_terms`` terms."""
        if self.guard != "runs":
            return n_terms + 1
        enough = min(max(_RUNS_PER_TERM * n_terms, n_terms + _LEAST_DF), n_terms + _ENOUGH_DF)
        return max(enough, _RUNS_PER_TERM * self.acting_terms)

    def width(
        self, s: ArrayLike, df_residual: ArrayLike, h: ArrayLike, interval: IntervalKind | None = None
    ) -> FloatArray:
        """Half-width that the rule looks at, score units; nan without residual degrees of freedom.

        Of the residual standard deviation ``s``, its degrees of freedom, and ``h = z0' (Z'WZ)^-1 z0``; by default of
        the rule's own interval.
        """
        runs = self.replicates_of(interval)
        return np.asarray(t_quantile(df_residual, self.level) * np.asarray(s) * np.sqrt(1.0 / runs + np.asarray(h)))

    def noise_floor(self, s: float) -> float:
        """Half-width that no number of runs can go below: the noise of the future runs themselves, 0 of their mean."""
        return float(self.width(s, np.inf, 0.0))


AS_REPEATS = 0.4
"""What a further run tells of the mean at the optimum, over a repeat there.

Measured on five kinds of `tests/studies/kinds.py`: the median forecast of a first look is 0.75 to 1.1 times the
half-width that the budget gives; were h to fall as 1/n, up to 2.5 times."""
BUDGET_SPENT = "was spent before the stop rule was met."
MODEL_ALPHA = 0.05
"""Probability above which all terms together are not seen to matter."""


@dataclass(frozen=True, slots=True)
class Forecast:
    """What the interval of a rule can still become."""

    noise_floor: float
    """Half-width that no number of runs can go below, score units."""
    attainable_half_width: float
    """Half-width expected when the budget is spent, score units."""
    attainable_mean_half_width: float
    """The same for the mean of ``replicates`` runs, score units."""
    runs_needed: int | None
    """Estimated total number of runs until the rule holds; None: out of reach."""


def forecast(rule: StopRule, *, n_runs: int, n_terms: int, s: float, h: float) -> Forecast:
    """Forecast from one fit, with ``h = z0' (Z'WZ)^-1 z0`` falling as by repeats at the optimum, `AS_REPEATS` of a run.

    ``s`` is the residual standard deviation, score units; nan gives nan and None.
    """
    if not np.isfinite(s) or not np.isfinite(h):
        return Forecast(float("nan"), float("nan"), float("nan"), None)
    last = max(rule.max_runs, n_runs, n_terms + 1)
    first = max(n_runs, rule.min_runs(n_terms), n_terms + 1)
    counts = np.unique(np.concatenate([np.arange(first, first + 2000), np.geomspace(first, 1e6, 400).astype(np.int64)]))
    h_later, h_last = (h / (1.0 + AS_REPEATS * h * (n - n_runs)) for n in (counts, last))
    enough = counts[rule.width(s, counts - n_terms, h_later) <= rule.half_width]
    return Forecast(
        noise_floor=rule.noise_floor(s),
        attainable_half_width=float(rule.width(s, last - n_terms, h_last)),
        attainable_mean_half_width=float(rule.width(s, last - n_terms, h_last, "prediction_mean")),
        runs_needed=int(enough[0]) if len(enough) else None,
    )


def target_problem(rule: StopRule, sigma: float, n_terms: int, unit: str = "") -> str:
    """Why a rule can never hold with noise ``sigma``, score units, for ``n_terms`` of the model; empty when it might.

    Refused is only what is impossible: the variance of the mean at any settings is at least that of ``max_runs``
    repeats there, ``h >= 1 / max_runs``. What is attainable in ``unit`` for the mean of
    ``replicates`` runs has the average leverage ``h = p / max_runs``; for the interval `seqrsm.campaign.budget` tells.
    """
    needed = rule.min_runs(n_terms)
    if rule.guard == "runs" and rule.max_runs < needed:
        return (
            f"The stop rule needs at least {needed} runs for a model of {n_terms} terms, more than max_runs = "
            f"{rule.max_runs}."
        )
    runs = rule.max_runs
    if runs <= n_terms:
        return f"max_runs = {runs} leaves no degree of freedom for a model of {n_terms} terms."
    if float(rule.width(sigma, runs - n_terms, 1.0 / runs)) <= rule.half_width:
        return ""
    floor = rule.noise_floor(sigma)
    target = amount(rule.half_width, unit)
    if rule.half_width < floor:
        head = (
            f"A half-width of {target} is below the noise floor: with a run-to-run standard deviation of "
            f"{amount(sigma, unit)}, no number of runs brings the {rule.interval_name} below ± {amount(floor, unit)}"
        )
    else:
        head = f"{runs} runs cannot reach a half-width of {target}"
    if rule.interval == "prediction":
        mean = float(rule.width(sigma, runs - n_terms, n_terms / runs, "prediction_mean"))
        head += f"; about ± {amount(mean, unit)} is attainable for the mean of {rule.replicates} runs"
    return f"{head}."


def flights_needed(rule: StopRule, sigma: float) -> int | None:
    """Flights at the recommended settings from which on their own interval is as narrow as the target.

    Flights meet the real ground, of which they leave nothing unknown: only chance is left, in their mean and in what it
    foretells. ``sigma`` is the standard deviation of one simulated run, score units. At least 2; None where
    `_MOST_FLIGHTS` do not suffice.
    """
    chance = sigma * np.sqrt(1.0 - rule.ground_share)
    n = np.arange(2, _MOST_FLIGHTS + 1)
    enough = n[replace(rule, ground_share=0.0).width(chance, n - 1, 1.0 / n) <= rule.half_width]
    return int(enough[0]) if len(enough) else None


def amount(value: float, unit: str, target: float = float("nan"), digits: int = 3) -> str:
    """So many digits, or as many as show on which side of a target it is, and the unit."""
    text = f"{value:.{telling(value, target, digits)}g}"
    if "e+" in text and abs(value) < 1e7:
        text = f"{float(text):.0f}"
    return f"{text} {unit}".rstrip()


def telling(value: float, target: float, digits: int) -> int:
    """Digits, so many at least, with which a value is told on its own side of its target."""
    return next((d for d in range(digits, 9) if (float(f"{value:.{d}g}") > target) == (value > target)), 9)


@dataclass(frozen=True, slots=True)
class Check:
    """One part of the rule."""

    name: str
    """One of "interval", "loss", "runs", "guess", "pure_error", "lack_of_fit" or "confirmation"."""
    holds: bool | None
    """None: it cannot be tested yet, which counts as not holding."""
    text: str
    """One sentence with the numbers."""


@dataclass(frozen=True, slots=True)
class Decision(Forecast):
    """Stop or go on, and why; with what more runs would give."""

    held: bool
    """The whole rule holds: stop."""
    checks: tuple[Check, ...]
    """Every part of the rule."""
    half_width: float
    """Half-width the rule looked at, score units."""
    budget_spent: bool
    """``n_runs >= max_runs``."""
    wants_confirmation: bool
    """Nothing but the fresh runs is missing."""
    futility: tuple[str, ...]
    """Why going on may be useless."""
    reasons: tuple[str, ...]
    """The decision in sentences: what is missing, floors, budget, futility."""


@dataclass(frozen=True, slots=True)
class Look:
    """What one look at the scores says of the interval at the optimum, and whether the model describes the region."""

    n_runs: int
    n_terms: int
    """Scored runs and terms of the model."""
    s: float
    df_residual: int
    """Standard deviation of a future run at the optimum, score units (nan without degrees of freedom), and the residual
    degrees of freedom."""
    df_pure_error: int
    """Degrees of freedom of pure error."""
    h: float
    """Variance of the mean there in its square."""
    lack_of_fit: float | str
    """p of the lack-of-fit test, or why it cannot be made."""
    loss: float = 0.0
    """What the recommended settings are expected to lose, score units."""
    half_width: float = float("nan")
    """Half-width of the rule's interval, score units; by default Student's of ``s`` and ``h``. What it has beyond the
    scatter of future runs is forecast to fall with more runs."""
    model_p: float | None = None
    """p of the F test that no term but the intercept matters; 1 where all scores are equal."""
    guess: float | None = None
    """What would be scored without an image; None where it is not known."""
    known_map: bool = False
    """That is the score of a map that exists, not of guessing."""
    lead: float = float("inf")
    """By how much the mean at the optimum is better than that, score units."""
    weighed: bool = False
    """A surface that is no quadratic is part of the intervals, by its probability: then neither lack of fit nor pure
    error is asked about."""
    saturated: bool = False
    """The model has a term for every setting of the region: there is no lack of fit to test."""
    n_confirmation: int = 0
    """Confirmation runs among the runs, which are beyond the budget."""
    n_flights: int | None = None
    """Flights among the runs where simulations are others: more simulations do not tell how flights differ."""
    one_block: bool = False
    """Future runs are in a new block, and all of these are in one."""


def futility(rule: StopRule, look: Look, ahead: Forecast, width: float, unit: str) -> tuple[str, ...]:
    """Why going on may be useless, in sentences; ``width`` is the half-width now, ``unit`` that of the score."""
    found, budget = [], rule.max_runs + look.n_confirmation
    if rule.half_width < ahead.noise_floor:
        found.append(
            f"The target of ± {amount(rule.half_width, unit)} is below the noise floor: by the scatter so far "
            f"({counted(look.df_residual, 'degree of freedom', 'degrees of freedom')}) no number of runs brings the "
            f"{rule.interval_name} below ± {amount(ahead.noise_floor, unit)}."
        )
        if rule.interval == "prediction":
            mean = amount(ahead.attainable_mean_half_width, unit)
            found.append(f"The mean of {rule.replicates} future runs could be predicted to ± {mean}.")
    elif (
        (ahead.runs_needed is None or ahead.runs_needed > budget)
        and np.isfinite(ahead.attainable_half_width)
        and not width <= rule.half_width
    ):
        need = "more than a million" if ahead.runs_needed is None else f"about {ahead.runs_needed}"
        found.append(
            f"The budget of {rule.max_runs} runs is too small for the target: {need} runs are needed; "
            f"± {amount(ahead.attainable_half_width, unit)} is attainable."
        )
    if (needed := _runs_for_loss(rule, look)) > budget:
        which = f"{needed} runs" if look.n_flights is None else f"{needed - look.n_runs} further flights"
        lost = f"an expected loss of {amount(rule.loss, unit)}: about {which} are needed"
        found.append(f"The budget of {rule.max_runs} runs is too small for {lost}.")
    # With fewer residual degrees of freedom a test of all terms says little about any of them.
    if look.model_p == 1.0:
        found.append("All scores are equal: no factor has an effect, and every setting is equally good.")
    elif look.model_p is not None and look.model_p > MODEL_ALPHA and look.df_residual >= max(4, look.n_terms // 2):
        found.append(f"No factor has a significant effect so far (F test of all terms: p = {look.model_p:.2g}).")
    return tuple(found)


def _runs_for_loss(rule: StopRule, look: Look) -> int:
    """Runs until the loss is allowed, if it falls as the variance of the place does; 0 where it is allowed already."""
    if not look.loss > rule.loss:
        return 0
    tell = look.n_runs if look.n_flights is None else look.n_flights
    return look.n_runs - tell + int(np.ceil(tell * look.loss / rule.loss))


def decide(rule: StopRule, look: Look, confirmation: Agreement | None = None, unit: str = "") -> Decision:
    """Apply the rule to one look.

    ``confirmation``: test of fresh runs at the recommended settings; ``unit``: of the score, for the sentences.
    """
    n_runs, n_terms = look.n_runs, look.n_terms
    width, s, h, budget = look.half_width, look.s, look.h, rule.max_runs + look.n_confirmation
    if np.isfinite(width):
        of_runs = 1.0 / rule.replicates_of()
        h = max((width / float(rule.width(s, look.df_residual, 1.0 - of_runs))) ** 2 - of_runs, 0.0)
    else:
        width = float(rule.width(s, look.df_residual, h))
    checks = [_interval_check(rule, width, unit)]
    if np.isfinite(rule.loss):
        limit = f"at most {rule.loss:g} {unit}".rstrip()
        lost = amount(look.loss, unit, rule.loss, 2)  # as everywhere else
        text = f"The settings are expected to lose {lost}; {limit} is allowed."
        checks.append(Check("loss", look.loss <= rule.loss, text))
    if rule.guard == "runs":
        needed = rule.min_runs(n_terms)
        why = f"{needed - n_terms} degrees of freedom"
        if needed == _RUNS_PER_TERM * n_terms:
            why = f"{_RUNS_PER_TERM} per term"
        elif needed > n_terms + _ENOUGH_DF:
            why = f"{_RUNS_PER_TERM} for each of the {rule.acting_terms} terms in factors that matter"
        more = f", more than the budget of {rule.max_runs} runs" if needed > budget else ""
        text = f"{n_runs} runs for {n_terms} terms; {needed} are required ({why}){more}."
        checks.append(Check("runs", n_runs >= needed, text))
    if look.one_block and rule.interval != "confidence":
        text = "All runs are of one block: how much a run in a new one may differ is unknown."
        checks.append(Check("blocks", None, text))
    if look.guess is not None:
        checks.append(_guess_check(look.guess, look, width, unit))
    if not look.weighed:
        asked = f"{MIN_DF_PURE_ERROR} are required"
        have = counted(look.df_pure_error, "degree of freedom", "degrees of freedom")
        text = f"Repeated runs give {have} of pure error; {asked}."
        checks.append(Check("pure_error", look.df_pure_error >= MIN_DF_PURE_ERROR, text))
        checks.append(_lack_of_fit_check(look))
    before_confirmation = all(check.holds is True for check in checks)
    if rule.guard == "confirmation":
        text = "Confirmation runs at the recommended settings are still to be made."
        text = text if before_confirmation else "Confirmation runs follow once all else is met."
        agrees, text = (confirmation.agrees, confirmation.text) if confirmation else (None, text)
        checks.append(Check("confirmation", agrees, text))
    held = all(check.holds is True for check in checks)
    ahead = forecast(rule, n_runs=n_runs, n_terms=n_terms, s=s, h=h)
    ahead = replace(ahead, attainable_half_width=min(ahead.attainable_half_width, width))
    useless = futility(rule, look, ahead, width, unit)
    if ahead.runs_needed is not None:
        ahead = replace(ahead, runs_needed=max(ahead.runs_needed, _runs_for_loss(rule, look)))
    budget_spent = n_runs >= budget
    reasons = [check.text for check in checks if check.holds is not True]
    if held:
        reasons = [f"The stop rule is met after {n_runs} runs.", *(check.text for check in checks)]
    elif budget_spent:
        reasons.append(f"The budget of {rule.max_runs} runs {BUDGET_SPENT}")
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
    target = f"the target is ± {rule.half_width:g} {unit}".rstrip()
    if not np.isfinite(width):
        return Check("interval", None, f"The {rule.interval_name} has no finite half-width yet; {target}.")
    now = f"± {amount(width, unit, rule.half_width)} ({100 * rule.level:g} %)"
    text = f"The {rule.interval_name} at the optimum is {now}; {target}."
    return Check("interval", width <= rule.half_width, text)


def _guess_check(guess: float, look: Look, width: float, unit: str) -> Check:
    what, lead = ("the existing map" if look.known_map else "guessing"), look.lead
    said = f"{'The existing map alone' if look.known_map else 'Guessing without an image'} scores {amount(guess, unit)}"
    if lead > width:
        return Check("guess", True, f"{said}; the optimum is better by {amount(lead, unit)}.")
    away = f"better by {amount(lead, unit)}, less than its half-width" if lead > 0.0 else "no better"
    text = f"{said}; the optimum is {away}, so no setting is shown to beat {what}."
    return Check("guess", False, text)


def _lack_of_fit_check(look: Look) -> Check:
    p = look.lack_of_fit
    if look.saturated:
        text = "The model has a term for every setting of the region, so lack of fit cannot arise."
        return Check("lack_of_fit", True, text)
    if isinstance(p, str):
        return Check("lack_of_fit", None, f"Lack of fit cannot be tested: {p}.")
    holds = p >= LACK_OF_FIT_ALPHA
    verdict = "not significant" if holds else "significant: the model does not describe this region"
    return Check("lack_of_fit", holds, f"Lack of fit is {verdict} (p = {p:.2g}, limit {LACK_OF_FIT_ALPHA:g}).")
