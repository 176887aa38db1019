"""``seqrsm status``: where a campaign stands."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from statistics import median
from typing import Any

from seqrsm.analysis.ground import MEASURED, Ground, measured_ground
from seqrsm.analysis.runs import evidence, see_names
from seqrsm.campaign.guards import see_meaning
from seqrsm.errors import FitError, UserError
from seqrsm.plain import plain
from seqrsm.remember import remembered
from seqrsm.spec.read import CampaignSpec, load_spec
from seqrsm.spec.tables import ApplicationSpec
from seqrsm.store.records import EventRecord, RunRecord, Settings
from seqrsm.store.store import Store


def campaign_status(folder: Path, *, history: bool = False) -> dict[str, Any]:
    """Runs by state and source, what the scores say so far of each application, and whether to stop.

    ``history`` adds every event.
    """
    spec = load_spec(folder)
    runs = tuple[RunRecord, ...]()
    events = bundles = tuple[EventRecord, ...]()
    if Store.exists(spec.folder, spec.store_url):
        with Store.open(spec.folder, url=spec.store_url, create=True, campaign=spec.name, seed=spec.seed) as store:
            store.verify()
            runs = store.runs()
            see_meaning(store, spec, runs)
            events = store.events() if history else ()
            bundles = store.events(kind=MEASURED)
    applications = [latest_look(spec, one, runs, measured_ground(bundles, one.name)) for one in spec.applications]
    last = {one["name"]: one["last_look"] for one in applications}
    for one in applications:
        if look := one["last_look"]:
            one["warnings"] += sensor_warnings(spec, look["optimum"]["settings"])
    result: dict[str, Any] = {
        "campaign": spec.name,
        "runs": dict(Counter(run.state for run in runs)),
        "sources": dict(Counter(run.source for run in runs if run.state == "scored")),
        "max_runs": spec.stop.max_runs,
        "interval": spec.stop.interval,
        "level": spec.stop.level,
        "units": {factor.name: factor.unit for factor in spec.factors},
        **costs(runs),
        "cost_unit": spec.cost.told_unit,
        "simulated_by": simulated_by(runs),
        "applications": applications,
        "held": bool(last) and all((last.get(app.name) or {}).get("held", False) for app in spec.applications),
        "failed": [
            {"run_id": run.run_id, "reason": run.reason, "fault": run.fault} for run in runs if run.state == "failed"
        ],
    }
    if history:
        result["history"] = plain(events)
    return result


def costs(runs: Sequence[RunRecord]) -> dict[str, float]:
    """Cost of scored runs, and of voided ones that had scores: flown in vain, or a slip that was never flown.

    Not of those whose place a corrected run took.
    """
    replaced = {run.replaces for run in runs}
    voided = (run for run in runs if run.state == "void" and run.scores and run.run_id not in replaced)
    return {
        "cost_spent": sum(run.cost for run in runs if run.state == "scored"),
        "cost_voided": sum(run.cost for run in voided),
    }


def simulated_by(runs: Sequence[RunRecord]) -> list[dict[str, Any]]:
    """On which data bases the scored runs were simulated, the finest first.

    ``averaged``: cells along a side of the blocks that were one cell, 1 as it is; ``runs``: how many; ``seconds``: the
    median run took.
    """
    seconds: dict[int, list[float]] = {}
    for run in runs:
        kept = next((score.metadata["fidelity"] for score in run.scores if "fidelity" in score.metadata), None)
        if run.state == "scored" and isinstance(kept, Mapping):
            seconds.setdefault(int(kept.get("averaged", 1)), []).append(float(kept.get("seconds", 0.0)))
    return [{"averaged": k, "runs": len(own), "seconds": median(own)} for k, own in sorted(seconds.items())]


def latest_look(
    spec: CampaignSpec, application: ApplicationSpec, runs: Sequence[RunRecord], ground: Ground | None = None
) -> dict[str, Any]:
    """What the scores say of an application, by the specification as it is now; remembered, not recorded.

    ``name``, ``unit``, ``target_half_width``, ``target_loss`` (None without a limit), ``last_look`` (a look's summary,
    or None where there is no fit), ``warnings`` (of that fit), ``reason`` (why scores give none).
    """
    from seqrsm.analysis.conclude import LOOK_DRAWS, analyse
    from seqrsm.analysis.to_json import look_summary

    found: dict[str, Any] = {"name": application.name, "unit": application.score_unit}
    stop = spec.stop_of(application.name)
    found |= {"target_half_width": stop.half_width, "target_loss": stop.loss, "last_look": None, "warnings": []}
    try:
        see_names(spec, runs, application.name)
        if any(run.state == "scored" and run.score_of(application.name) for run in evidence(runs)):
            made_of = (spec.spec_hash, application.name, runs, ground)

            def look() -> Any:
                analysis = analyse(spec, application, runs, ground=ground, n_draws=LOOK_DRAWS)
                return plain({"last_look": look_summary(analysis), "warnings": analysis.warnings})

            found |= remembered(look, made_of)
    except FitError as error:
        found["reason"] = str(error)
    return found


def sensor_warnings(spec: CampaignSpec, settings: Settings) -> tuple[str, ...]:
    """Warnings of settings at which a sensor is not to be used; none where they cannot be simulated now.

    Remembered, as it takes the engines; results do not need it.
    """
    if spec.simulator is None:
        return ()

    def look() -> tuple[str, ...]:
        from seqrsm.campaign.simulator_checks import not_to_be_used

        return not_to_be_used(spec, settings)

    with suppress(UserError, OSError):
        return remembered(look, ("not to be used", spec.spec_hash, dict(settings)))
    return ()
