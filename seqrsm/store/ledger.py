"""The changes of the campaign's tables, each within a transaction that the store opened."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar, cast

import sqlalchemy as sa

from seqrsm import __version__
from seqrsm.errors import Problem, StoreError
from seqrsm.plain import plain, shallow
from seqrsm.store.chain import event_hash, run_digest, score_digest
from seqrsm.store.database import utc_now
from seqrsm.store.records import CONFIRMATION, WAITING, NewRun, NewScore, RunRecord, ScoreRecord
from seqrsm.store.schema import EVENTS, RUNS, SCORES, TRANSITIONS

T = TypeVar("T")

MAX_SCORE = 1e12
VOID_FIRST = "Check the run id; to put another score in its place, first: seqrsm void DIR RUN_ID --why TEXT"


class Ledger:
    """Reads and writes runs, scores and events over one connection, in a transaction; ``seed`` goes into every event.

    For changes it is one that is alone in writing.
    """

    def __init__(self, connection: sa.Connection, seed: int | None = None) -> None:
        self.connection = connection
        self.seed = seed

    # -- reading --------------------------------------------------------------------------------------------------

    def _number(self, query: sa.Select[Any]) -> int:
        """The number that a query gives, 0 where it gives none."""
        return int(self.connection.execute(query).scalar_one() or 0)

    def next_id(self) -> int:
        """Id of the next run: one more than the last."""
        return self._number(sa.select(sa.func.max(RUNS.c.id))) + 1

    def last_event(self, apart: Sequence[str] = ()) -> int:
        """Number of the latest event, those of some kinds apart; 0 before the first."""
        return self._number(sa.select(sa.func.max(EVENTS.c.id)).where(EVENTS.c.kind.not_in(apart)))

    def n_used(self) -> int:
        """Runs that count against the budget: scored or to be scored, confirmation runs apart."""
        counts = (RUNS.c.state.in_((*WAITING, "scored")), RUNS.c.purpose != CONFIRMATION)
        return self._number(sa.select(sa.func.count()).select_from(RUNS).where(*counts))

    def last_batch(self) -> int:
        """Number of the latest batch, 0 before the first."""
        return self._number(sa.select(sa.func.max(RUNS.c.batch)))

    def states(self, run_ids: Iterable[int]) -> dict[int, str]:
        """State of each run; StoreError for those that do not exist."""
        ids = tuple(run_ids)
        query = sa.select(RUNS.c.id, RUNS.c.state).where(RUNS.c.id.in_(ids)).order_by(RUNS.c.id)
        states = {row.id: row.state for row in self.connection.execute(query)}
        if missing := [run_id for run_id in ids if run_id not in states]:
            remedy = "`seqrsm export` lists them."
            raise StoreError(*(Problem("there is no such run", remedy, field="run", value=i) for i in missing))
        return states

    def ids(self, *where: sa.ColumnElement[bool], most: int | None = None) -> tuple[int, ...]:
        """Ids of the runs that meet the conditions, in order; so many, the first, or all."""
        query = sa.select(RUNS.c.id).where(*where).order_by(RUNS.c.id).limit(most)
        return tuple(self.connection.execute(query).scalars())

    def records(self, kind: Callable[..., T], table: sa.Table, *where: sa.ColumnElement[bool]) -> Iterator[T]:
        """Rows of a table that meet the conditions, in order and one by one, as records whose fields are its columns.

        A field of another name, such as that of an event's number, is the row's number.
        """
        columns = [table.c.get(field.name, table.c.id) for field in fields(cast(Any, kind))]
        return (kind(*row) for row in self.connection.execute(sa.select(*columns).where(*where).order_by(table.c.id)))

    def runs(self, condition: sa.ColumnElement[bool]) -> tuple[RunRecord, ...]:
        """Runs that meet the condition, by id, with their scores."""
        scores: dict[int, list[ScoreRecord]] = {}
        joined = sa.select(SCORES).join(RUNS, SCORES.c.run_id == RUNS.c.id).where(condition).order_by(SCORES.c.id)
        for _, *values in self.connection.execute(joined):
            record = ScoreRecord(*values)
            scores.setdefault(record.run_id, []).append(record)
        rows = self.connection.execute(sa.select(RUNS).where(condition).order_by(RUNS.c.id))
        return tuple(RunRecord(*(*row, tuple(scores.get(row.id, ())))) for row in rows)

    # -- changing -------------------------------------------------------------------------------------------------

    def log(self, kind: str, entries: Sequence[tuple[int | None, Mapping[str, Any]]]) -> None:
        """One event of this kind for each (run id or None, detail)."""
        if entries:
            common = {"at": utc_now(), "version": __version__, "seed": self.seed, "kind": kind}
            rows = [{**common, "run_id": run_id, "detail": plain(detail)} for run_id, detail in entries]
            newest = sa.select(EVENTS.c.id, EVENTS.c.hash).order_by(EVENTS.c.id.desc()).limit(1)
            number, before = self.connection.execute(newest).first() or (0, "")
            for row in rows:
                row["id"] = number = number + 1
                row["hash"] = before = event_hash(before, row)
            self.connection.execute(sa.insert(EVENTS), rows)

    def add_runs(
        self, runs: Sequence[NewRun], *, batch: int, made: Sequence[Mapping[str, Any]] = ()
    ) -> tuple[int, ...]:
        """Insert runs with consecutive ids and issue them; ``made``: columns of those that were made already."""
        now, first = utc_now(), self.next_id()
        rows = [
            {
                **_run_row(run),
                "id": first + i,
                "batch": batch,
                "proposed_at": now,
                **(made[i] if made else {"state": "issued", "issued_at": now}),
            }
            for i, run in enumerate(runs)
        ]
        self.connection.execute(sa.insert(RUNS), rows)
        told = [{"batch": batch, "purpose": row["purpose"], "run_digest": run_digest(row)} for row in rows]
        self.log("proposed", [(row["id"], detail) for row, detail in zip(rows, told, strict=True)])
        if not made:
            self.log("issued", [(row["id"], {"from": "proposed"}) for row in rows])
        return tuple(row["id"] for row in rows)

    def move(
        self,
        run_ids: Iterable[int],
        state: str,
        values: Mapping[str, Any],
        *,
        kind: str = "",
        detail: Mapping[str, Any] | None = None,
    ) -> None:
        """Bring runs into a state, with an event each; StoreError naming every run that may not go there."""
        before = self.states(run_ids)
        problems = [_illegal(run_id, old, state) for run_id, old in before.items() if state not in TRANSITIONS[old]]
        if problems:
            raise StoreError(*problems)
        if before:
            self.connection.execute(sa.update(RUNS).where(RUNS.c.id.in_(tuple(before))).values(state=state, **values))
        self.log(kind or state, [(run_id, {"from": old, **(detail or {})}) for run_id, old in before.items()])

    def new_scores(self, run_id: int, scores: Sequence[NewScore]) -> tuple[list[Problem], list[NewScore]]:
        """What stands against recording these scores, and those that are not in the store yet."""
        state = self.states([run_id])[run_id]
        if state != "scored" and "scored" not in TRANSITIONS[state]:
            return [_illegal(run_id, state, "scored")], []
        rows = self.connection.execute(sa.select(SCORES).where(SCORES.c.run_id == run_id))
        present = {row.application: row for row in rows}
        problems: list[Problem] = []
        fresh: list[NewScore] = []
        for new in scores:
            file, line = new.source_file or None, new.source_row
            old = present.get(new.application)
            if fault := unusable(run_id, new):
                problems.append(fault)
            elif old is None:
                fresh.append(new)
            elif any(getattr(new, key) not in (None, getattr(old, key)) for key in ("score", "se", "n", "correct")):
                message = f"run {run_id} is scored already for '{new.application}' ({old.score:g})"
                problems.append(Problem(message, VOID_FIRST, file=file, line=line, field="score", value=new.score))
        return problems, fresh

    def add_scores(self, run_id: int, scores: Sequence[NewScore], values: Mapping[str, Any]) -> None:
        """Insert scores and make the run scored; ``values``: other columns of the run to set."""
        update = {"state": "scored", "ended_at": utc_now(), "owner": "", "reason": "", "fault": "", **values}
        self.connection.execute(sa.update(RUNS).where(RUNS.c.id == run_id).values(**update))
        self.insert_scores([(run_id, score) for score in scores])

    def log_settings(self, run_id: int, settings: Mapping[str, Any]) -> None:
        """Note the settings at which a run was carried out."""
        self.connection.execute(sa.update(RUNS).where(RUNS.c.id == run_id).values(executed=plain(settings)))
        self.log("flown", [(run_id, {"run_digest": self._digests([run_id])[run_id]})])

    def _digests(self, run_ids: Iterable[int]) -> dict[int, str]:
        query = sa.select(RUNS).where(RUNS.c.id.in_(tuple(run_ids)))
        return {row["id"]: run_digest(dict(row)) for row in self.connection.execute(query).mappings()}

    def insert_scores(self, scores: Sequence[tuple[int, NewScore]]) -> None:
        """Insert scores by run id, with an event each; the state of the runs is the caller's."""
        if problems := [fault for run_id, score in scores if (fault := unusable(run_id, score))]:
            raise StoreError(*problems[:10])
        now = utc_now()
        rows = [{**_score_row(score), "run_id": run_id, "scored_at": now} for run_id, score in scores]
        self.connection.execute(sa.insert(SCORES), rows)
        ids = [row["run_id"] for row in rows]
        digests = self._digests(set(ids))
        told = [{**_scored_detail(row), "run_digest": digests[row["run_id"]]} for row in rows]
        self.log("scored", list(zip(ids, told, strict=True)))


def unusable(run_id: int, new: NewScore) -> Problem | None:
    """What is wrong with the numbers of a score; squares beyond `MAX_SCORE` would lose all digits."""
    if abs(new.score) <= MAX_SCORE and (new.se is None or 1.0 / MAX_SCORE <= new.se <= MAX_SCORE):
        return None
    message = f"the score of run {run_id} or its standard error is not a usable number"
    remedy = f"Scores up to {MAX_SCORE:g} are, and standard errors from {1.0 / MAX_SCORE:g} to that: change the unit."
    return Problem(message, remedy, file=new.source_file or None, line=new.source_row, value=(new.score, new.se))


def _run_row(run: NewRun) -> dict[str, Any]:
    told = {"proposed" if name == "settings" else name: value for name, value in shallow(run).items()}
    fresh = {"executed": None, "reason": "", "fault": "", "attempts": 0, "owner": "", "replaces": None}
    return {**plain(told), "cost": float(run.cost), **fresh}


def _score_row(score: NewScore) -> dict[str, Any]:
    # As the database gives them back: a digest tells 1 from 1.0.
    return {**plain(shallow(score)), "score": float(score.score), "se": None if score.se is None else float(score.se)}


def _scored_detail(row: Mapping[str, Any]) -> dict[str, Any]:
    """What an event tells of a score; of a measured one also the file and its line."""
    detail = {**{name: row[name] for name in ("application", "score", "se")}, "score_digest": score_digest(row)}
    return {**detail, "file": row["source_file"], "line": row["source_row"]} if row["source_file"] else detail


def _illegal(run_id: int, old: str, new: str) -> Problem:
    if old == new:
        return Problem(f"run {run_id} is {old} already")
    allowed = ", ".join(sorted(TRANSITIONS[old])) or "nothing else"
    return Problem(f"run {run_id} is {old} and cannot become {new}", f"From {old} it can become: {allowed}.")
