"""What simulated scores are scores of: program, simulator, utilities and the files behind them, one for all runs.

Scores from before and after a change would be fitted as one surface. An event keeps what the runs so far were made
from; who changes it hears so before another run is made.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from seqrsm import __version__
from seqrsm.errors import Problem, StoreError
from seqrsm.plain import plain
from seqrsm.spec.read import CampaignSpec, placed
from seqrsm.store.records import RunRecord
from seqrsm.store.store import Store

EXPERIMENT = "experiment"
"""Kind of the event that keeps what simulated scores are made from."""


def experiment_of(spec: CampaignSpec) -> dict[str, str]:
    """What simulated scores rest on, by name: keys of ``[simulator]`` and its tables, utilities, digests of files.

    Errors of `task_of`.
    """
    from seqrsm.campaign.simulation import files_of, task_of

    task = task_of(spec, 0, {})
    assert spec.simulator is not None
    # Its tolerance moves no score by more than is accepted; scene and table are files.
    simulator = spec.simulator
    found: dict[str, object] = {"seqrsm": __version__, "[simulator] engine": simulator.engine}
    found["[simulator] common_random_numbers"] = None  # earlier versions had it: where it was used scores differ
    if simulator.calendar_shift_days:
        found["[simulator] calendar_shift_days"] = simulator.calendar_shift_days
    found |= {f"[simulator.fixed] {key}": value for key, value in simulator.fixed.items()}
    for member, own in simulator.members.items():
        found |= {f"[simulator.members.{member}] {key}": value for key, value in own.items()}
    found |= {f"utility of {one.name}": one.utility for one in spec.applications}
    for path in sorted(files_of(task)):
        place = Path(path)
        name = place.relative_to(spec.folder) if place.is_relative_to(spec.folder) else place.name
        found[f"file {name}"] = _digest(path, place.stat().st_mtime_ns) if place.is_file() else ""
    return {key: value if isinstance(value, str) else json.dumps(plain(value)) for key, value in found.items()}


def see_experiment(store: Store, spec: CampaignSpec, *, accept: bool = False, note: bool = True) -> None:
    """Note what simulated scores rest on, where it is new or ``accept``; refuse what differs from before.

    Without ``note`` nothing is written. A new application is no change, nor is a fixed parameter that became a factor,
    or a factor that became fixed: earlier runs keep the values that they had. StoreError tells what differs, with the
    values before and now; nothing is noted.
    """
    before, now, changed = _since(store, spec)
    if changed and not accept:
        raise StoreError(*(_problem(spec, key, before.get(key, ""), now.get(key, "")) for key in changed))
    if note and before != now:
        store.add_event(EXPERIMENT, {EXPERIMENT: now})


def changed_since(store: Store, spec: CampaignSpec) -> tuple[str, ...]:
    """Names of what differs from what the simulated scores so far rest on."""
    return tuple(key.removeprefix("file ") for key in _since(store, spec)[2])


def _since(store: Store, spec: CampaignSpec) -> tuple[dict[str, str], dict[str, str], list[str]]:
    """What the simulated scores so far rest on, what further ones would, and keys of what no longer holds of both."""
    before, now = _before(store), experiment_of(spec)
    # A file that is away is no other file: its runs fail by the machine, and are made once it is back.
    now |= {key: before[key] for key, value in now.items() if key.startswith("file ") and not value and key in before}
    if before == now or not before:
        return before, now, []
    fresh, gone = now.keys() - before.keys(), before.keys() - now.keys()
    made = store.runs("scored", source="simulation")
    held = set.intersection(*(set(run.settings) for run in made)) if made else set()
    apart = {f"[simulator.fixed] {name}" for name in held.union(factor.name for factor in spec.factors)}
    apart |= {key for key in fresh | gone if key.startswith("utility of ")}
    if any(key.startswith("utility of ") for key in fresh):  # with code of its own
        apart |= {key for key in fresh if key.startswith("file ")}
    changed = sorted({key for key, _ in before.items() ^ now.items()} - apart)
    return before, now, changed if made else []


def see_utilities(store: Store, spec: CampaignSpec, runs: Sequence[RunRecord]) -> None:
    """Refuse simulated scores of another utility than the application has now: they would be told as scores of it."""
    before, made = _before(store), any(run.state == "scored" and run.source == "simulation" for run in runs)
    now = {f"utility of {one.name}": one.utility for one in spec.applications}
    if changed := [key for key in now if made and before.get(key, now[key]) != now[key]]:
        raise StoreError(*(_problem(spec, key, before[key], now[key]) for key in changed))


def _before(store: Store) -> dict[str, str]:
    """What the simulated scores so far rest on; nothing where there are none."""
    told = [event.detail[EXPERIMENT] for event in store.events(kind=EXPERIMENT) if event.detail]
    return told[-1] if told else {}


def _problem(spec: CampaignSpec, key: str, before: str, now: str) -> Problem:
    remedy = "Restore it, or start a new campaign; if it cannot change any score, run with --accept."
    if key.startswith("file "):
        message = "the file differs from the one earlier runs were simulated from"
        if not before:
            message = "earlier runs were simulated without this file"
        elif not now:
            message = "earlier runs were simulated from this file, which is no longer used"
        return Problem(message, remedy, file=key.removeprefix("file "))
    message = f"{key} was {before or 'not given'} for earlier runs and is now {now or 'not given'}"
    if key == "seqrsm":
        return Problem(message, remedy)
    head, _, name = key.partition("] ")
    path: tuple[str | int, ...] = (*head.removeprefix("[").split("."), name)
    for k, one in enumerate(spec.applications):
        if key == f"utility of {one.name}":
            path = ("application", k, "utility")
            remedy = "Restore it. An application added for the new utility is scored from the earlier simulations, too."
    return placed(spec, Problem(message, remedy), *path)


@lru_cache(maxsize=32)
def _digest(path: str, modified_ns: int) -> str:
    """SHA-256 of a file, read once as long as it stays."""
    del modified_ns
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
