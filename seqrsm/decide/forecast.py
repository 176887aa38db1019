"""What more runs would give: floors, runs needed, and reasons not to go on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from seqrsm.arrays import FloatArray
from seqrsm.decide.intervals import IntervalKind, anytime_half_width, half_width, noise_floor
from seqrsm.decide.rule import StopRule

MODEL_ALPHA = 0.05
"""Probability above which all terms together are not seen to matter."""


@dataclass(frozen=True, slots=True)
class Forecast:
    """What the interval of a rule can still become.

    Attributes
    ----------
    noise_floor : float
        Half-width that no number of runs can go below, score units.
    attainable_half_width : float
        Half-width expected when the budget is spent, score units.
    attainable_mean_half_width : float
        The same for the mean of ``replicates`` runs, score units.
    runs_needed : int or None
        Estimated total number of runs until the rule holds; None: out of reach.
    """

    noise_floor: float
    attainable_half_width: float
    attainable_mean_half_width: float
    runs_needed: int | None


def forecast(rule: StopRule, *, n_runs: int, n_terms: int, s: float, h: float) -> Forecast:
    """Forecast from one fit, with ``h = z0' (Z'WZ)^-1 z0`` falling as 1/n.

    Campaigns that focus on the optimum do better than 1/n; ``seqrsm rehearse`` tells by how much.

    Parameters
    ----------
    rule : StopRule
    n_runs, n_terms : int
    s : float
        Residual standard deviation, score units; nan gives nan and None.
    h : float

    Returns
    -------
    Forecast
    """
    if not np.isfinite(s) or not np.isfinite(h):
        return Forecast(float("nan"), float("nan"), float("nan"), None)
    last = max(rule.max_runs, n_runs, n_terms + 1)
    first = max(n_runs, rule.min_runs(n_terms), n_terms + 1)
    counts = np.unique(np.concatenate([np.arange(first, first + 2000), np.geomspace(first, 1e6, 400).astype(np.int64)]))
    widths = _width_after(rule, rule.interval, s, counts, n_terms, h * n_runs / counts)
    enough = counts[widths <= rule.half_width]
    h_last = h * n_runs / last
    return Forecast(
        noise_floor=noise_floor(rule.interval, s, rule.level, rule.replicates),
        attainable_half_width=float(_width_after(rule, rule.interval, s, last, n_terms, h_last)),
        attainable_mean_half_width=float(_width_after(rule, "prediction_mean", s, last, n_terms, h_last)),
        runs_needed=int(enough[0]) if len(enough) else None,
    )


def futility(
    rule: StopRule, ahead: Forecast, *, n_terms: int, df_residual: int, model_p: float | None, width: float, unit: str
) -> tuple[str, ...]:
    """Why going on may be useless, in sentences.

    Parameters
    ----------
    rule : StopRule
    ahead : Forecast
    n_terms, df_residual : int
    model_p : float or None
        p of the F test that no term but the intercept matters; 1 where all scores are equal.
    width : float
        Half-width now.
    unit : str
        Unit of the score.

    Returns
    -------
    tuple of str
    """
    found = []
    if rule.half_width < ahead.noise_floor:
        found.append(
            f"The target of ± {amount(rule.half_width, unit)} is below the noise floor of "
            f"± {amount(ahead.noise_floor, unit)}: no number of runs narrows the {rule.interval_name} further. "
            f"The mean of {rule.replicates} runs could be predicted to "
            f"± {amount(ahead.attainable_mean_half_width, unit)}."
        )
    elif (
        (ahead.runs_needed is None or ahead.runs_needed > rule.max_runs)
        and np.isfinite(ahead.attainable_half_width)
        and not width <= rule.half_width
    ):
        need = "more than a million" if ahead.runs_needed is None else f"about {ahead.runs_needed}"
        found.append(
            f"The budget of {rule.max_runs} runs is unlikely to reach the target: {need} runs are needed; "
            f"± {amount(ahead.attainable_half_width, unit)} is attainable."
        )
    # With fewer residual degrees of freedom a test of all terms says little about any of them.
    if width == 0.0 and model_p == 1.0:
        found.append("All scores are equal: no parameter matters, and every setting is as good.")
    elif model_p is not None and model_p > MODEL_ALPHA and df_residual >= max(4, n_terms // 2):
        found.append(f"No parameter matters as far as these runs can tell (F test of all terms: p = {model_p:.2g}).")
    return tuple(found)


def target_problem(rule: StopRule, sigma: float, n_terms: int, unit: str = "") -> str:
    """Why a rule can never hold with noise ``sigma``; empty when it might.

    Refused is only what is impossible: the variance of the mean at any settings is at least that of ``max_runs``
    repeats there, ``h >= 1 / max_runs``. The attainable half-width quoted has the average leverage
    ``h = p / max_runs``.

    Parameters
    ----------
    rule : StopRule
    sigma : float
        Standard deviation of one run, score units.
    n_terms : int
        Terms of the model.
    unit : str
        Unit of the score, for the sentence.

    Returns
    -------
    str
        A sentence with the attainable half-width and what the mean of ``replicates`` runs would give.
    """
    needed = rule.min_runs(n_terms)
    if rule.guard == "runs" and rule.max_runs < needed:
        return (
            f"The stop rule asks for at least {needed} runs ({rule.runs_per_term:g} for each of {n_terms} terms), more "
            f"than max_runs = {rule.max_runs}."
        )
    runs = rule.max_runs
    if runs <= n_terms:
        return f"max_runs = {runs} leaves no degree of freedom for a model of {n_terms} terms."
    if float(_width_after(rule, rule.interval, sigma, runs, n_terms, 1.0 / runs)) <= rule.half_width:
        return ""
    floor = noise_floor(rule.interval, sigma, rule.level, rule.replicates)
    target = amount(rule.half_width, unit)
    if rule.half_width < floor:
        head = (
            f"A half-width of {target} is below the noise floor: with a standard deviation of {amount(sigma, unit)} a "
            f"run the {rule.interval_name} cannot fall below ± {amount(floor, unit)} with any number of runs"
        )
    else:
        head = f"A half-width of {target} is out of reach of {runs} runs"
    typical = float(_width_after(rule, rule.interval, sigma, runs, n_terms, n_terms / runs))
    tail = f"; about ± {amount(typical, unit)} is attainable with {runs} runs"
    if rule.interval == "prediction":
        mean = float(_width_after(rule, "prediction_mean", sigma, runs, n_terms, n_terms / runs))
        tail += f", and ± {amount(mean, unit)} for the mean of {rule.replicates} runs"
    return f"{head}{tail}."


def amount(value: float, unit: str) -> str:
    """Three digits and the unit."""
    return f"{value:.3g} {unit}".rstrip()


def _width_after(
    rule: StopRule, interval: IntervalKind, s: float, n_runs: ArrayLike, n_terms: int, h: ArrayLike
) -> FloatArray:
    df = np.asarray(n_runs) - n_terms
    if rule.guard == "anytime":
        planned = rule.planned_information(n_terms)
        return anytime_half_width(interval, s, df, h, rule.level, planned, rule.replicates)
    return half_width(interval, s, df, h, rule.level, rule.replicates)
