"""``seqrsm rehearse``: what the stop rule would do, on truths drawn from what is known now."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from seqrsm.analysis.conclude import stop_rule
from seqrsm.analysis.posterior import draw_coefficients
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.next_runs import CENTRE_REPEATS, start_size
from seqrsm.decide.campaigns import Stage
from seqrsm.decide.rehearsal import Rehearsal, rehearse, share_se
from seqrsm.design.optimal import start_design


def rehearse_campaign(campaign: Campaign, n_campaigns: int, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Rehearse the first application's campaign from the current posterior.

    Returns
    -------
    dict
        ``campaigns``; ``rows``: label and text; ``notes``; and the plain numbers under ``numbers``.

    Raises
    ------
    FitError
        Too few scores to know anything yet.
    """
    spec = campaign.spec
    analysis = campaign.analyse_all(spec.applications[0].name)[0]
    rule = stop_rule(spec)
    draws = draw_coefficients(spec, analysis.fitted, sampler="exact", n_draws=2000)
    start = start_design(analysis.model, analysis.region, start_size(analysis.model, spec), CENTRE_REPEATS, spec.seed)
    stage = Stage(analysis.model, analysis.region, start, rule, spec.batch, analysis.goal)
    # Where blocks are random, each run of the rehearsal falls into one of its own.
    sigma = draws.sigma if draws.sigma_block is None else np.hypot(draws.sigma, draws.sigma_block)
    result = rehearse(stage, draws.terms, sigma_draws=sigma, n_campaigns=n_campaigns, seed=spec.seed, progress=progress)
    found = _summary(
        result,
        spec.cost.simulation if spec.simulator is not None else spec.cost.flight,
        analysis.score_unit,
        rule.interval_name,
        spec.model.response,
    )
    if draws.sigma_block is not None:
        found["notes"].append("Each run of the rehearsal falls into a block of its own, with its block's scatter.")
    if spec.model.weights != "equal":
        found["notes"].append("All runs scatter alike in the rehearsal, as one of average weight does.")
    return found


def _summary(result: Rehearsal, run_cost: float, unit: str, interval_name: str, response: str) -> dict[str, Any]:
    low, middle, high = (int(x) for x in np.quantile(result.runs, [0.1, 0.5, 0.9]))
    numbers = {
        "stopped": float(np.mean(result.stopped)),
        "runs_p10": low,
        "runs_median": middle,
        "runs_p90": high,
        "cost_median": float(np.median(result.runs * run_cost)),
        "coverage_rule": float(np.mean(result.covers_rule)),
        "coverage_new_run": float(np.mean(result.covers_new_run)),
        "coverage_mean": float(np.mean(result.covers_mean)),
        "coverage_confirmation": float(np.mean(result.covers_confirmation)),
        "regret_median": float(np.median(result.regret)),
        "regret_p95": float(np.quantile(result.regret, 0.95)),
    }

    def share(name: str) -> str:
        p = numbers[name]
        return f"{100 * p:.1f} % ± {100 * share_se(p, len(result.runs)):.1f}"

    rows = [
        ("campaigns that stop before the budget", share("stopped")),
        ("runs needed, median (10 % to 90 %)", f"{middle} ({low} to {high})"),
        ("cost, median", f"{numbers['cost_median']:g}"),
        (f"coverage of the {interval_name}", share("coverage_rule")),
        ("coverage of one new run at the optimum", share("coverage_new_run")),
        ("coverage of the mean at the optimum", share("coverage_mean")),
        ("coverage of the confirmation interval", share("coverage_confirmation")),
        (
            "utility lost, median (95 %)",
            f"{numbers['regret_median']:.3g} ({numbers['regret_p95']:.3g}) {unit}".rstrip(),
        ),
    ]
    notes = [
        "Truths are quadratics drawn from the current posterior, errors are normal; ± is a Monte Carlo standard error.",
    ]
    if response != "identity":
        notes.append(f"Figures are on the scale of the fit ({response}).")
    return {"campaigns": len(result.runs), "rows": rows, "notes": notes, "numbers": numbers}
