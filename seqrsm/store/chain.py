"""What changed behind the program's back: each event carries a hash of itself and of the one before, and tells digests.

The hashes show that an event was changed, lost or put in; the digests that a run or a score is no longer what its
events say.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter, itemgetter
from typing import Any

from seqrsm.store.records import DERIVED, EventRecord, LookRecord, RunRecord, misfit
from seqrsm.store.schema import STATES

_EVENT = ("at", "version", "seed", "run_id", "kind", "detail")
_RUN = ("batch", "purpose", "why", "source", "proposed", "executed", "block", "cost")
_SCORE = ("application", "score", "se", "n", "correct", "metadata", "source_file", "source_row")
_STATES = {"released": "issued", "retried": "issued"} | {kind: kind for kind in STATES}
_event_columns, _run_columns, _score_columns = attrgetter("event", *_EVENT), attrgetter(*_RUN), attrgetter(*_SCORE)
_text = json.JSONEncoder(sort_keys=True, ensure_ascii=False, allow_nan=False).encode


def event_hash(before: str, event: Mapping[str, Any]) -> str:
    """SHA-256 of an event, by its columns, and of the hash of the one before."""
    return _chained(before, itemgetter("id", *_EVENT)(event))


def _chained(before: str, columns: Sequence[Any]) -> str:
    return hashlib.sha256(f"{before}{_text(columns)}".encode()).hexdigest()


def run_digest(run: Mapping[str, Any]) -> str:
    """Digest of what a run is, its state and times apart; of its columns."""
    return _digest(itemgetter(*_RUN)(run))


def score_digest(score: Mapping[str, Any]) -> str:
    """Digest of a score, the time apart; of its columns."""
    return _digest(itemgetter(*_SCORE)(score))


def look_digest(summary: Mapping[str, Any]) -> str:
    """Digest of what a look found."""
    return _digest([summary])


def _digest(values: Sequence[Any]) -> str:
    return hashlib.sha256(_text(values).encode()).hexdigest()[:16]


@dataclass(slots=True)
class _Told:
    """What the events say of a run: its state ("" where they do not), its digest, and those of its scores."""

    state: str = ""
    run: str = ""
    scores: dict[str, str] = field(default_factory=dict)

    def hear(self, event: EventRecord) -> None:
        self.state = "" if event.kind == "unscored" else _STATES.get(event.kind, self.state)
        self.run = event.detail.get("run_digest", self.run)
        if event.kind == "unscored":
            self.scores.pop(event.detail["application"], None)
        elif "score_digest" in event.detail:
            self.scores[event.detail["application"]] = event.detail["score_digest"]


def changes(runs: Iterable[RunRecord], looks: Iterable[LookRecord], events: Iterable[EventRecord]) -> Iterator[str]:
    """What is not as it was written, in words; scores that are results, `DERIVED`, are not compared."""
    before = ""
    told: dict[int, _Told] = {}
    seen: dict[int, str] = {}
    for event in events:
        if name := misfit(event):
            yield f"{name} of event {event.event} is {getattr(event, name)!r}"
            return
        if event.hash != _chained(before, _event_columns(event)):
            yield f"event {event.event} ({event.kind}) or one before it was changed, lost or put in"
            return
        before = event.hash
        if event.kind == "look":
            seen[event.detail["look"]] = event.detail["look_digest"]
        if event.run_id is not None:
            told.setdefault(event.run_id, _Told()).hear(event)
    for look in looks:
        if misfit(look) or seen.get(look.look) != look_digest(look.summary):
            yield f"look {look.look} is not the one that was recorded"
    for run in runs:
        for record in (run, *run.scores):
            if name := misfit(record):
                yield f"{name} of run {run.run_id} is {getattr(record, name)!r}"
                return
        yield from _changes_of(run, told.pop(run.run_id, _Told()))
    yield from (f"run {run_id} was lost" for run_id in told)


def _changes_of(run: RunRecord, told: _Told) -> Iterator[str]:
    if told.run != _digest(_run_columns(run)):
        yield f"run {run.run_id} is not what was proposed and carried out"
    if told.state not in ("", run.state):
        yield f"run {run.run_id} is {run.state}, and was {told.state}"
    scores = {score.application: score for score in run.scores}
    if lost := told.scores.keys() - scores.keys():
        yield f"run {run.run_id} has lost its score of '{min(lost)}'"
    for name, score in scores.items():
        if score.metadata.get("derived") != DERIVED and told.scores.get(name) != _digest(_score_columns(score)):
            yield f"the score of run {run.run_id} for '{name}' is not the one that was recorded"
