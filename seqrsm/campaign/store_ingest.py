"""Measured scores and rankings into the store, within one transaction: matched, added, recognised, or all refused."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import sqlalchemy as sa

from seqrsm.campaign.records import (
    EqualRow,
    FileRecord,
    IngestedFile,
    IngestedRun,
    IngestOutcome,
    NewRun,
    NewScore,
    RunRecord,
    ScoreRecord,
)
from seqrsm.campaign.schema import FILES, RANKINGS, RUNS
from seqrsm.campaign.store_connection import utc_now
from seqrsm.campaign.store_ledger import VOID_FIRST, Ledger
from seqrsm.campaign.store_rankings import add_rankings, score_rankings
from seqrsm.errors import Problem, StoreError
from seqrsm.plain import plain


def ingest_files(ledger: Ledger, files: Sequence[IngestedFile]) -> tuple[IngestOutcome, ...]:
    """Match measured scores to runs, make runs for those nobody proposed; StoreError with every problem."""
    problems: list[Problem] = []
    outcomes = tuple(_ingest(ledger, file, problems) for file in files)
    if problems:
        raise StoreError(*problems)
    return outcomes


def _ingest(ledger: Ledger, file: IngestedFile, problems: list[Problem]) -> IngestOutcome:
    same = ledger.connection.execute(sa.select(FILES).where(FILES.c.sha256 == file.sha256)).first()
    if same is not None:
        return IngestOutcome(already=FileRecord(same.name, same.sha256, same.row_count, same.ingested_at))
    before = len(problems)
    matched: list[int] = []
    created: list[int] = []
    replaced: list[tuple[int, int]] = []
    unchanged: list[int] = []
    equal: list[EqualRow] = []
    moved: list[int] = []
    batch = ledger.last_batch() + 1
    known = _KnownRuns(ledger.runs(sa.true())) if any(run.run_id is None for run in file.runs) else None
    fresh: list[tuple[IngestedRun, RunRecord | None]] = []
    first = ledger.next_id()
    ranked_already = _ranked_applications(ledger)
    for run in file.runs:
        twin = known.take(run) if known is not None and run.run_id is None else None
        wanted = run.run_id if twin is None else twin.run_id
        found = () if wanted is None else ledger.runs(RUNS.c.id == wanted)
        old = found[0] if found else None
        _refuse_ranked(ranked_already, run, file.name, problems)
        if twin is not None:
            equal += [EqualRow(score.source_row, twin.run_id, twin.state) for score in run.scores]
        if twin is not None and twin.state == "void":
            unchanged.append(twin.run_id)
        elif wanted is not None and old is None:
            problems.append(_unknown_run(wanted, file.name, run.scores[0].source_row))
        elif old is None or old.state == "void":
            created.append(first + len(fresh))
            fresh.append((run, old))
            if old is not None:
                replaced.append((old.run_id, created[-1]))
        elif _match(ledger, run, old, file.name, problems):
            matched.append(old.run_id)
            if dict(run.settings) != old.proposed:
                moved.append(old.run_id)
        else:
            unchanged.append(old.run_id)
    _create(ledger, fresh, batch)
    numbers, ranked_runs = add_rankings(ledger, file, problems)
    if len(problems) > before:
        return IngestOutcome()
    applications = dict.fromkeys(ranking.application for ranking in file.rankings)
    ranked = tuple(score_rankings(ledger, application) for application in applications) if numbers else ()
    row = {"name": file.name, "sha256": file.sha256, "row_count": file.row_count}
    ledger.connection.execute(sa.insert(FILES).values(**row, ingested_at=utc_now()))
    detail = {**row, "matched": matched, "created": created, **({"rankings": numbers} if numbers else {})}
    ledger.log("ingested", [(None, detail)])
    return IngestOutcome(
        matched=tuple(matched) + ranked_runs,
        created=tuple(created),
        replaced=tuple(replaced),
        unchanged=tuple(unchanged),
        equal=tuple(equal),
        moved=tuple(moved),
        rankings=numbers,
        ranked=ranked,
    )


class _KnownRuns:
    """Measured runs of earlier files, each to be taken once by a row that says the same.

    A file that was saved anew, or has grown, or has lost its run ids, brings its rows again: a row that has the same
    settings, block, scores, errors and counts, and the same text in every column that both have, is that row. Real
    repeats differ, at least in the date or a note, or stand in one file, where each row takes another run.
    """

    def __init__(self, runs: Iterable[RunRecord]) -> None:
        self._free: dict[object, list[RunRecord]] = {}
        for run in runs:
            for key in {_key(run.settings, score) for score in run.scores if score.source_file}:
                self._free.setdefault(key, []).append(run)
        self._taken: set[int] = set()

    def take(self, new: IngestedRun) -> RunRecord | None:
        """The run that ``new`` repeats; it is not given again."""
        for run in self._free.get(_key(new.settings, new.scores[0]), ()):
            if run.run_id not in self._taken and new.block in ("", run.block) and _repeats(new.scores, run):
                self._taken.add(run.run_id)
                return run
        return None


def _key(settings: Mapping[str, float | str], score: NewScore | ScoreRecord) -> object:
    return tuple(sorted(settings.items())), score.application, score.score


def _repeats(scores: Sequence[NewScore], run: RunRecord) -> bool:
    """Whether a run has these scores, as far as it has scores of their applications."""
    pairs = [(new, old) for new in scores if (old := run.score_of(new.application)) is not None]
    return bool(pairs) and all(
        (new.score, new.se, new.n, new.correct) == (old.score, old.se, old.n, old.correct)
        and all(old.metadata[name] == value for name, value in new.metadata.items() if name in old.metadata)
        for new, old in pairs
    )


def _match(ledger: Ledger, run: IngestedRun, old: RunRecord, name: str, problems: list[Problem]) -> bool:
    """Add measured scores to a proposed run; False when they are there already or cannot be added."""
    faults, fresh = ledger.new_scores(old.run_id, run.scores)
    if old.executed is not None and dict(run.settings) != old.executed:
        message = f"run {old.run_id} was carried out with other settings"
        faults.append(Problem(message, VOID_FIRST, file=name, line=run.scores[0].source_row, value=old.executed))
    problems += faults
    if faults or not fresh:
        return False
    values = {"executed": plain(run.settings), "source": run.source or old.source, "block": run.block or old.block}
    ledger.add_scores(old.run_id, fresh, values)
    return True


def _create(ledger: Ledger, fresh: Sequence[tuple[IngestedRun, RunRecord | None]], batch: int) -> None:
    """Insert runs that nobody proposed, and runs in the place of void ones, with their scores."""
    if not fresh:
        return
    made, values = [], []
    for run, old in fresh:
        if old is None:
            made.append(NewRun(run.settings, "measured", "measured without a proposal", run.source or "flight"))
        else:
            why = f"takes the place of run {old.run_id}, which is void"
            made.append(NewRun(old.proposed, old.purpose, why, run.source or old.source))
        other: dict[str, Any] = {
            "state": "scored",
            "ended_at": utc_now(),
            "executed": plain(run.settings),
            "block": run.block or ("" if old is None else old.block),
            "cost": float(run.cost),
            "replaces": None if old is None else old.run_id,
        }
        values.append(other)
    ids = ledger.add_runs(made, batch=batch, values=values)
    ledger.insert_scores([(run_id, score) for run_id, (run, _) in zip(ids, fresh, strict=True) for score in run.scores])


def _ranked_applications(ledger: Ledger) -> frozenset[str]:
    return frozenset(ledger.connection.execute(sa.select(RANKINGS.c.application).distinct()).scalars())


def _refuse_ranked(ranked: frozenset[str], run: IngestedRun, name: str, problems: list[Problem]) -> None:
    """An application's scores are measured, or follow from rankings; they cannot be both."""
    for score in run.scores:
        if score.application in ranked:
            message = f"the scores of '{score.application}' follow from rankings"
            remedy = "Give rankings: run_id, interpreter, rank."
            problems.append(Problem(message, remedy, file=name, line=score.source_row, field="score"))


def _unknown_run(run_id: int, name: str, line: int | None) -> Problem:
    return Problem(
        "there is no such run",
        "Give the id of a proposed run, or leave the cell empty for a run nobody proposed.",
        file=name,
        line=line,
        field="run_id",
        value=run_id,
    )
