"""The online check of the fidelity planner: what a campaign learnt about its bounds, and which runs that concerns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from statistics import median
from typing import TYPE_CHECKING, Any

from seqrsm.spec.read import CampaignSpec
from seqrsm.store.records import EventRecord, RunRecord

if TYPE_CHECKING:
    from seqrsm.campaign.simulation import FidelityCheck

VIOLATED = "fidelity bound violated"
"""Kind of the event."""

LEAST_STEP = 1.25
"""Factor by which a violated bound is widened at least, so that few violations settle it."""


def widening_of(events: Iterable[EventRecord]) -> dict[str, float]:
    """Factor of each rung's bound that the campaign found, by rung; empty where no bound was violated."""
    factors: dict[str, float] = {}
    for event in events:
        if event.kind == VIOLATED:
            rung = str(event.detail["rung"])
            factors[rung] = max(factors.get(rung, 1.0), float(event.detail["factor"]))
    return factors


def violation(check: FidelityCheck, widening: Mapping[str, float]) -> dict[str, Any]:
    """Details of the event of a violated bound, the limit being that of the bound as widened so far."""
    factor = widening.get(check.rung, 1.0) * max(abs(check.difference) / check.limit, LEAST_STEP)
    return {
        "rung": check.rung,
        "by": check.by,
        "application": check.application,
        "difference": check.difference,
        "limit": check.limit,
        "factor": factor,
    }


def fidelity_of(run: RunRecord) -> dict[str, Any]:
    """What was kept of the planner's decision with a run's score; empty for flights and older runs."""
    found = next((score.metadata["fidelity"] for score in run.scores if "fidelity" in score.metadata), None)
    return dict(found) if isinstance(found, dict) else {}


def to_repeat(spec: CampaignSpec, runs: Sequence[RunRecord], widening: Mapping[str, float]) -> tuple[int, ...]:
    """Scored runs whose bound, as it is known now, does not meet the tolerance: ids.

    A rung that was asked for by name is not put in question.
    """
    if spec.simulator is None or spec.simulator.fidelity != "auto" or not widening:
        return ()
    found = []
    for run in runs:
        kept = fidelity_of(run) if run.state == "scored" and run.source == "simulation" else {}
        if kept:
            now = widening.get(str(kept["rung"]), 1.0) / float(kept.get("widening", 1.0))
            if now > 1.0 and now * float(kept["bound"]) > spec.simulator.tolerance:
                found.append(run.run_id)
    return tuple(found)


def simulated_by(runs: Iterable[RunRecord], violations: Sequence[EventRecord]) -> dict[str, Any] | None:
    """By which rungs the scored runs were simulated, and what the checks found; None where none was simulated.

    Returns
    -------
    dict or None
        ``rungs``: for each in use the ``runs``, the largest ``bound`` [score units], what is ``left_out``, and the
        median ``seconds`` of a run; ``checks`` and ``violations``: how many.
    """
    kept = [found for run in runs if run.state == "scored" and (found := fidelity_of(run))]
    if not kept:
        return None
    rungs = {}
    for rung in sorted({str(found["rung"]) for found in kept}):
        own = [found for found in kept if found["rung"] == rung]
        rungs[rung] = {
            "runs": len(own),
            "bound": max(float(found["bound"]) for found in own),
            "left_out": sorted({str(name) for found in own for name in found["left_out"]}),
            "seconds": median(float(found.get("seconds", 0.0)) for found in own),
        }
    return {"rungs": rungs, "checks": sum("check" in found for found in kept), "violations": len(violations)}
