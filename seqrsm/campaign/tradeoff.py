"""``seqrsm tradeoff``: speed against accuracy of this campaign's own simulations and numbers, measured.

Some configurations spread over the region are simulated on the same occasions by every rung of the fidelity ladder;
what each rung loses against the full simulation is set against the time it saves. Each configuration is kept as soon as
it is measured, in ``tradeoff.json`` of the campaign's folder: the same command goes on where it was interrupted.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from seqrsm import __version__
from seqrsm.analysis.fitted import fit_application
from seqrsm.arrays import FloatArray
from seqrsm.campaign.simulation import plan_of, score_by, task_of
from seqrsm.campaign.tradeoff_numerics import precision_rows, sampler_rows, search_rows, some_configurations
from seqrsm.errors import FitError, UserError
from seqrsm.fit.optimum import Goal, sign_of
from seqrsm.plain import plain
from seqrsm.simulate.fidelity import MEANINGS, RUNGS
from seqrsm.spec.read import CampaignSpec
from seqrsm.store.store import STORE_NAME, Store

FILE: Final = "tradeoff.json"

FIRST_RUN: Final = 2**30
"""Run id of the first occasion: far beyond any campaign's."""

RESTARTS: Final = (1, 2, 4)
"""Local searches in a design search that are compared: of few, each costs seconds."""

AUTO: Final = "auto"
"""In the place of a rung: what the planner chooses."""

Progress = Callable[[int, int], None]


def _silent(done: int, total: int) -> None:
    del done, total


def measure_tradeoff(
    spec: CampaignSpec,
    *,
    configurations: int = 8,
    occasions: int = 6,
    numerics: bool = True,
    progress: Progress = _silent,
) -> dict[str, Any]:
    """Measure, or go on measuring, the trade-off of a campaign.

    Parameters
    ----------
    spec : CampaignSpec
    configurations : int
        Settings spread over the region, the centre among them.
    occasions : int
        Occasions on which each is simulated by every rung, the same for all rungs and configurations.
    numerics : bool
        Sampler, single against double precision, and design search, too.
    progress : callable
        Told of (done, all) pieces of work.

    Returns
    -------
    dict
        Plain values; also written to `FILE`.
    """
    path = spec.folder / FILE
    key = {"spec": spec.spec_hash, "version": __version__, "configurations": configurations, "occasions": occasions}
    kept = _read(path, key)
    parts = 3 if numerics else 0
    total = parts + (configurations if spec.simulator is not None else 0)
    if spec.simulator is not None:
        settings = some_configurations(spec, configurations)
        for done, own in enumerate(settings):
            if done >= len(kept["rows"]):
                kept["rows"].append(_measured(spec, own, occasions))
                _write(path, kept)
            progress(done + 1, total)
        kept["simulation"] = _summary(spec, kept["rows"])
    else:
        kept["simulation"] = None
        kept["why"] = "this campaign has no simulator: its scores are measured, and there is nothing to simulate faster"
    if numerics:
        makers: dict[str, Callable[[], Any]] = {
            "sampler": lambda: _sampler(spec),
            "precision": lambda: _precision(spec, kept["rows"]),
            "design_search": lambda: search_rows(spec, restarts=RESTARTS, searches=3),
        }
        for done, (name, make) in enumerate(makers.items()):
            if name not in kept["numerics"] or name == "sampler":
                kept["numerics"][name] = plain(make())
                _write(path, kept)
            progress(total - parts + done + 1, total)
    _write(path, kept)
    return {name: value for name, value in kept.items() if name != "rows"}


def _read(path: Path, key: Mapping[str, Any]) -> dict[str, Any]:
    """What was measured before under the same circumstances, else nothing."""
    empty: dict[str, Any] = {"key": dict(key), "rows": [], "numerics": {}, "simulation": None}
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return empty
    return found if isinstance(found, dict) and found.get("key") == key else empty


def read_tradeoff(folder: Path) -> dict[str, Any] | None:
    """The last trade-off that was measured to its end; None where there is none."""
    try:
        found = json.loads((folder / FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(found, dict):
        return None
    # Without a simulator there are only numbers to compare.
    return found if found.get("simulation") or (found.get("why") and found.get("numerics")) else None


def _write(path: Path, content: Mapping[str, Any]) -> None:
    draft = path.with_name(f".{path.name}.draft")
    draft.write_text(json.dumps(plain(content), indent=1), encoding="utf-8")
    os.replace(draft, path)


def _measured(spec: CampaignSpec, settings: Mapping[str, float | str], occasions: int) -> dict[str, Any]:
    """Score and time of every rung at one configuration, on the same occasions; a refused rung has its reason."""
    task = task_of(spec, FIRST_RUN, settings)
    out: dict[str, Any] = {"settings": dict(settings), "rungs": {}, "refused": {}, "failure": ""}
    try:
        plan, *_ = plan_of(replace(task, demand=replace(task.demand, fidelity="auto")))
    except UserError as error:
        out["failure"] = str(error)
        return out
    out["chosen"], out["bounds"] = plan.chosen.rung, {p.rung: p.bound for p in plan.rungs if not p.refused}
    for rung in RUNGS:
        refused = plan.of(rung).refused
        if refused:
            out["refused"][rung] = refused
            continue
        score_by(task, rung)  # compiles and caches what is not to be timed
        found = [score_by(replace(task, run_id=FIRST_RUN + k), rung) for k in range(occasions)]
        out["rungs"][rung] = {"scores": [scores for scores, _ in found], "seconds": [seconds for _, seconds in found]}
    return out


def _summary(spec: CampaignSpec, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Each rung and the planner's own choice against the full simulation, for every application."""
    good = [row for row in rows if not row["failure"]]
    shown = [
        {"settings": row["settings"], "chosen": row["chosen"], "bounds": row["bounds"], "refused": row["refused"]}
        for row in good
    ]
    applications = {
        application.name: [
            found
            for rung in (*RUNGS, AUTO)
            if (found := _against_top(good, rung, application.name, application.goal)) is not None
        ]
        for application in spec.applications
    }
    refused = {
        rung: reasons[0]
        for rung in RUNGS
        if len(reasons := [row["refused"][rung] for row in good if rung in row["refused"]]) == len(good) and good
    }
    assert spec.simulator is not None
    return {
        "tolerance": spec.simulator.tolerance,
        "configurations": shown,
        "failures": [row["failure"] for row in rows if row["failure"]],
        "applications": applications,
        "refused": refused,
    }


def _against_top(rows: Sequence[Mapping[str, Any]], rung: str, application: str, goal: Goal) -> dict[str, Any] | None:
    """One rung against the top one over the configurations that admit it; None where none does."""
    used = [row for row in rows if rung == AUTO or rung in row["rungs"]]
    if not used:
        return None
    own = [row["chosen"] if rung == AUTO else rung for row in used]

    def scores(rungs: Sequence[str]) -> FloatArray:
        return np.array(
            [[s[application] for s in row["rungs"][r]["scores"]] for row, r in zip(used, rungs, strict=True)]
        )

    def seconds(rungs: Sequence[str]) -> FloatArray:
        return np.array([np.median(row["rungs"][r]["seconds"]) for row, r in zip(used, rungs, strict=True)])

    top = ["F4"] * len(used)
    cheap, full = scores(own), scores(top)
    difference = cheap - full
    n, m = difference.shape
    means = difference.mean(axis=1)
    error = float(np.sqrt(difference.var(axis=1, ddof=1).sum() / m) / n) if m > 1 else float("nan")
    sign = sign_of(goal)
    true, seen = sign * full.mean(axis=1), sign * cheap.mean(axis=1)
    best, picked = int(np.argmax(true)), int(np.argmax(seen))
    lost = full[best] - full[picked]
    spread = float(lost.std(ddof=1) / np.sqrt(m)) if m > 1 else float("nan")
    bounds = [row["bounds"][r] for row, r in zip(used, own, strict=True)]
    return {
        "rung": rung,
        "meaning": "what the planner chooses" if rung == AUTO else MEANINGS[rung],
        "configurations": n,
        "occasions": m,
        "seconds": float(np.median(seconds(own))),
        "time_ratio": float(np.median(seconds(own) / seconds(top))),
        "total_time_ratio": float(seconds(own).sum() / seconds(top).sum()),
        "bias": float(means.mean()),
        "bias_se": error,
        "rms_error": float(np.sqrt(np.mean(difference**2))),
        "largest_error": float(np.abs(difference).max()),
        "bound": float(max(bounds)),
        "rank_correlation": _rank_correlation(true, seen),
        "utility_lost": float(sign * lost.mean()) + 0.0,  # no negative zero
        "utility_lost_se": spread,
        "rungs_chosen": {r: own.count(r) for r in RUNGS if r in own},
    }


def _rank_correlation(one: FloatArray, other: FloatArray) -> float | None:
    """Spearman's; None where it does not exist."""
    from scipy.stats import spearmanr

    if len(one) < 3 or np.ptp(one) == 0.0 or np.ptp(other) == 0.0:
        return None
    return float(spearmanr(one, other).statistic)


def _sampler(spec: CampaignSpec) -> dict[str, Any]:
    """Monte Carlo error of intervals by number of draws, for each application; a reason where there is no fit."""
    if not spec.store_url and not (spec.folder / STORE_NAME).exists():
        return {"why": "no scores yet: there is no posterior to sample"}
    with Store.open(spec.folder, url=spec.store_url, campaign=spec.name, seed=spec.seed) as store:
        runs = store.runs()
    found: dict[str, Any] = {}
    for application in spec.applications:
        try:
            found[application.name] = sampler_rows(spec, application, fit_application(spec, application, runs))
        except FitError as error:
            return {"why": f"no posterior to sample: {error}"}
    return found


def _precision(spec: CampaignSpec, rows: Sequence[Mapping[str, Any]]) -> Any:
    """Single against double precision at some of the configurations."""
    if spec.simulator is None:
        return {"why": "no simulator"}
    chosen = [row["settings"] for row in rows if not row["failure"]][:4]
    return precision_rows(spec, chosen)
