"""``seqrsm status``: where a campaign stands, from the store alone, without a fit."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

from seqrsm.campaign.spec import load_spec
from seqrsm.campaign.store import Store


def campaign_status(folder: Path, *, history: bool = False) -> dict[str, Any]:
    """Runs by state and source, the last look of each application, and whether to stop.

    Parameters
    ----------
    folder : Path
        The campaign's folder.
    history : bool
        Add every event.

    Raises
    ------
    SpecError, StoreError
    """
    spec = load_spec(folder)
    with Store.open(spec.folder, url=spec.store_url, create=True, campaign=spec.name, seed=spec.seed) as store:
        runs, looks, events = store.runs(), store.looks(), store.events()
    last = {look.application: look.summary for look in looks}
    applications = [
        {"name": application.name, "unit": application.unit, "last_look": last.get(application.name)}
        for application in spec.applications
    ]
    result: dict[str, Any] = {
        "campaign": spec.name,
        "runs": dict(Counter(run.state for run in runs)),
        "sources": dict(Counter(run.source for run in runs if run.state == "scored")),
        "max_runs": spec.stop.max_runs,
        "interval": spec.stop.interval,
        "target_half_width": spec.stop.half_width,
        "level": spec.stop.level,
        "cost_spent": sum(run.cost for run in runs if run.state == "scored"),
        "applications": applications,
        "held": bool(last) and all((last.get(app.name) or {}).get("held", False) for app in spec.applications),
        "failed": [{"run_id": run.run_id, "reason": run.reason} for run in runs if run.state == "failed"],
    }
    if history:
        result["history"] = [asdict(event) for event in events]
    return result
