"""The campaign's memory: runs, scores, looks, and an event for every change.

States: issued -> running -> scored | failed; any -> void. Nothing is ever deleted. Each method is one short
transaction; when it returns, what it recorded survives a crash.

Decisions (batches, looks) rest on what was read before. `Store.mark` says from where on; a decision is refused with
`OvertakenError` when another process has decided since: of several that decide at once one comes through, and the
others look again.

Importing this module imports SQLAlchemy; commands that do not open a store should not import it.
"""

from __future__ import annotations

import os
import secrets
import socket
import sys
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import sqlalchemy as sa

from seqrsm.errors import OvertakenError, Problem, StoreError
from seqrsm.plain import plain
from seqrsm.store.chain import changes, look_digest
from seqrsm.store.database import Database, utc_now
from seqrsm.store.ledger import Ledger
from seqrsm.store.records import (
    EventRecord,
    FileRecord,
    IngestedFile,
    IngestOutcome,
    LookRecord,
    NewRun,
    NewScore,
    RankingRecord,
    RankingSummary,
    RunRecord,
)
from seqrsm.store.schema import EVENTS, FAULTS, FILES, LOOKS, META, RANKINGS, RUNS, STATES
from seqrsm.store.take_in import ingest_files, ranking_summary, rescore_without, void_ranking

STORE_NAME = "campaign.db"
LEASE_S = 900.0
"""A process of another host that was not heard of for so long [s] has lost its runs; the hosts' clocks agree better."""
_TOKEN = secrets.token_hex(4)
_NO_DECISIONS = ("running", "released", "scored", "experiment")
"""Kinds of events that overtake no decision: runs on their way, which were pending when it was made, and from what."""


def _place(location: Path | str, url: str | None) -> Path | str:
    file = STORE_NAME if url is None else url.removeprefix("sqlite:///") if url.startswith("sqlite:///") else ""
    return Path(location) / file if file else str(url)


class Store:
    """A campaign's store, open. Use `Store.open`, best in a ``with`` statement.

    ``seed`` is written into every event; ``label`` is its file or address, for messages, without a password; ``note``
    is what is to be known of the place, "" mostly.
    """

    def __init__(self, database: Database, seed: int | None = None) -> None:
        self._database = database
        self.seed = seed
        self.campaign = database.campaign
        self.label = database.label
        kind, self.note = database.network, ""
        if kind:
            self.note = f"the campaign lies on a network file system ({kind}): work on it from one host only"
        self._mark: int | None = None
        self._known: tuple[int, tuple[RunRecord, ...]] = -1, ()  # the runs as they were at an event

    @classmethod
    def open(
        cls,
        location: Path | str,
        *,
        url: str | None = None,
        create: bool = False,
        campaign: str = "",
        seed: int | None = None,
    ) -> Store:
        """Open the store of a campaign: ``campaign.db`` in its folder, or what ``[store] url`` names in place of that.

        An SQLite file's address counts from the folder. ``create``: make the tables when there are none. ``campaign``,
        the name in campaign.toml, is given to a new store, and compared with that of an existing one. StoreError:
        missing, not writable, damaged, written by another version, or another campaign's.
        """
        return cls(Database(_place(location, url), create=create, campaign=campaign), seed)

    @staticmethod
    def exists(location: Path | str, url: str | None) -> bool:
        """Whether there is a store to open, or a server to ask: who only reads makes none."""
        place = _place(location, url)
        return not isinstance(place, Path) or place.exists()

    def close(self) -> None:
        """Close all connections."""
        self._database.close()

    def leave(self) -> None:
        """Close for good; a file that this process made, into which nobody wrote, goes again."""
        self._database.leave()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # -- proposing and carrying out -------------------------------------------------------------------------------

    def add_batch(self, runs: Sequence[NewRun], *, budget: int | None = None) -> tuple[int, ...]:
        """Issue proposals as one batch; all or none; return run ids in the order given. A decision, see `mark`.

        Equal settings are repeats and stay apart. ``budget`` is that of the whole campaign, confirmation runs apart;
        StoreError if it would be passed: nothing was changed.
        """
        if not runs:
            return ()
        with self._decide() as ledger:
            if budget is not None and (used := ledger.n_used()) + len(runs) > budget:
                message = f"{used} of the {budget} runs of the budget are used: there is no room for {len(runs)}"
                raise StoreError(message, "Raise [stop] max_runs.", field="max_runs", value=budget)
            return ledger.add_runs(runs, batch=ledger.last_batch() + 1)

    def retry(self, run_ids: Sequence[int] = (), attempts: int | None = None) -> tuple[int, ...]:
        """Issue failed runs again, named ones or all whose failure did not lie with their settings; return their ids.

        ``attempts``: of all only those that were begun less often; without it attempts are counted anew. StoreError
        where a run that is named did not fail.
        """
        failed = [RUNS.c.state == "failed", RUNS.c.fault != "settings"]
        if attempts is not None:
            failed.append(RUNS.c.attempts < attempts)
        with self._write() as ledger:
            ids = tuple(run_ids) or ledger.ids(*failed)
            if wrong := [i for i, state in ledger.states(ids).items() if state != "failed"]:
                raise StoreError(*(Problem("this run has not failed", field="run", value=i) for i in wrong))
            values = {"owner": "", "reason": "", "fault": ""} | ({"attempts": 0} if attempts is None else {})
            ledger.move(ids, "issued", values, kind="retried")
            return ids

    def claim(self, most: int | None = None) -> tuple[RunRecord, ...]:
        """Take issued simulations, now "running", for this process to carry out; no two processes get the same run.

        ``most``: so many at once, the first; all by default.
        """
        with self._write() as ledger:
            ids, now = ledger.ids(RUNS.c.state == "issued", RUNS.c.source == "simulation", most=most), utc_now()
            values = {"started_at": now, "seen_at": now, "owner": _this_process(), "attempts": RUNS.c.attempts + 1}
            ledger.move(ids, "running", values, detail={"owner": _this_process()})
            return ledger.runs(RUNS.c.id.in_(ids))

    def record_scores(self, run_id: int, scores: Sequence[NewScore]) -> bool:
        """Record the scores of a run's applications, each once, together; durable when this returns.

        False when the run had exactly these scores already (a worker that was thought dead came back). StoreError of an
        unknown or void run, another score there already, or a number that is no score.
        """
        with self._write() as ledger:
            problems, fresh = ledger.new_scores(run_id, scores)
            if problems:
                raise StoreError(*problems)
            if fresh:
                ledger.add_scores(run_id, fresh, {})
            return bool(fresh)

    def fail(self, run_id: int, reason: str, fault: str = "unknown") -> None:
        """Note that an issued or running run could not be carried out, and where that lies (`FAULTS`)."""
        assert fault in FAULTS
        with self._write() as ledger:
            values = {"ended_at": utc_now(), "reason": reason, "fault": fault, "owner": ""}
            ledger.move([run_id], "failed", values, detail={"reason": reason, "fault": fault})

    def void(self, run_ids: int | Sequence[int], why: str) -> None:
        """Take runs out of the fit, all or none; their scores stay in the store."""
        _need_reason(why)
        ids = (run_ids,) if isinstance(run_ids, int) else run_ids
        with self._write() as ledger:
            ledger.move(ids, "void", {"reason": why}, detail={"reason": why})
            for run_id in ids:
                rescore_without(ledger, run_id)

    def release(self) -> tuple[int, ...]:
        """Issue again the runs that this process still holds; returns their ids."""
        with self._write() as ledger:
            ids = ledger.ids(*_held())
            ledger.move(ids, "issued", {"owner": ""}, kind="released")
            return ids

    def beat(self) -> None:
        """Say that this process is alive: nobody else takes its runs for another `LEASE_S`."""
        with self._write() as ledger:
            ledger.connection.execute(sa.update(RUNS).where(*_held()).values(seen_at=utc_now()))

    def release_stale(self) -> tuple[int, ...]:
        """Issue again the runs whose process died; return their ids.

        A run is stale when its process ran on this host and is gone, or when nothing was heard of the process for more
        than `LEASE_S`. Should it come back after all, its scores are those of any other process, and are kept once.
        """
        limit = utc_now(LEASE_S)
        with self._write() as ledger:
            columns = (RUNS.c.id, RUNS.c.owner, RUNS.c.started_at, RUNS.c.seen_at)
            query = sa.select(*columns).where(RUNS.c.state == "running")
            ids = tuple(
                row.id
                for row in ledger.connection.execute(query.order_by(RUNS.c.id))
                if _is_gone(row.owner) or (row.seen_at or row.started_at or "") < limit
            )
            ledger.move(ids, "issued", {"owner": ""}, kind="released")
            return ids

    def ingest_files(self, files: Sequence[IngestedFile], *, dry_run: bool = False) -> tuple[IngestOutcome, ...]:
        """Take in files of measured scores and rankings, in order; all of them or none.

        One whose content was taken in before changes nothing. ``dry_run``: do everything, then undo it. StoreError with
        every row that cannot be taken in; nothing was changed.
        """
        with self._write() as ledger:
            outcomes = ingest_files(ledger, files)
            if dry_run:
                ledger.connection.rollback()
        return outcomes

    def void_ranking(self, ranking: int, why: str) -> None:
        """Take an interpreter's ranking out; the scores follow from the others, and the ranking stays in the store."""
        _need_reason(why)
        with self._write() as ledger:
            void_ranking(ledger, ranking, why)

    # -- looks and events -----------------------------------------------------------------------------------------

    def record_look(self, after_run: int, application: str, summary: Mapping[str, Any]) -> int:
        """Record what a look at the data found; returns its number. A decision, see `mark`.

        ``after_run``: scored runs it was based on.
        """
        with self._decide() as ledger:
            row = {"after_run": after_run, "application": application, "summary": plain(summary)}
            insert = sa.insert(LOOKS).values(**row, looked_at=utc_now()).returning(LOOKS.c.id)
            number = int(ledger.connection.execute(insert).scalar_one())
            told = {name: row[name] for name in ("after_run", "application")}
            ledger.log("look", [(None, {"look": number, **told, "look_digest": look_digest(plain(summary))})])
            return number

    def add_event(self, kind: str, detail: Mapping[str, Any], *, once: Sequence[str] = ()) -> None:
        """Note something that is no change of a run: a stop, a report, an interruption.

        ``once``: keys of the detail; where an event of this kind has the same values of them, none is added.
        """
        detail = plain(detail)
        with self._write() as ledger:
            told = ledger.connection.execute(sa.select(EVENTS.c.detail).where(EVENTS.c.kind == kind)).scalars()
            if not (once and any(all(old.get(key) == detail[key] for key in once) for old in told)):
                ledger.log(kind, [(None, detail)])

    def mark(self) -> None:
        """From here on what is read is what the next decision rests on; own decisions move the mark."""
        with self._read() as ledger:
            self._mark = ledger.last_event(_NO_DECISIONS)

    def see_mark(self) -> None:
        """Refuse to conclude anything from what was read, with `OvertakenError`, if another process decided since."""
        with self._read() as ledger:
            self._see_mark(ledger)

    # -- reading --------------------------------------------------------------------------------------------------

    def runs(self, states: Iterable[str] | None = None, *, source: str | None = None) -> tuple[RunRecord, ...]:
        """Runs with their scores, by id; only those of the given states and source."""
        wanted = STATES if states is None else (states,) if isinstance(states, str) else tuple(states)
        with self._read() as ledger:
            event, runs = ledger.last_event(), self._known[1]
            if self._known[0] != event or any(run.state == "running" for run in runs):  # a heartbeat is no event
                runs = ledger.runs(sa.true())
                self._known = event, runs
        return tuple(run for run in runs if run.state in wanted and source in (None, run.source))

    def looks(self, application: str | None = None) -> tuple[LookRecord, ...]:
        """Looks in order; only those of one application."""
        of_one = () if application is None else (LOOKS.c.application == application,)
        with self._read() as ledger:
            return tuple(ledger.records(LookRecord, LOOKS, *of_one))

    def events(self, *, kind: str | None = None) -> tuple[EventRecord, ...]:
        """Events in order; only those of one kind."""
        of_one = () if kind is None else (EVENTS.c.kind == kind,)
        with self._read() as ledger:
            return tuple(ledger.records(EventRecord, EVENTS, *of_one))

    def n_used(self) -> int:
        """Runs that count against the budget: scored or to be scored, confirmation runs apart."""
        with self._read() as ledger:
            return ledger.n_used()

    def files(self) -> tuple[FileRecord, ...]:
        """Files taken in, in order."""
        with self._read() as ledger:
            return tuple(ledger.records(FileRecord, FILES))

    def rankings(self) -> tuple[RankingRecord, ...]:
        """Every rank that an interpreter gave, in order, those that do not count included."""
        with self._read() as ledger:
            return tuple(ledger.records(RankingRecord, RANKINGS))

    def ranking_summaries(self) -> tuple[RankingSummary, ...]:
        """What the rankings of each ranked application say."""
        with self._read() as ledger:
            names = dict.fromkeys(row.application for row in ledger.records(RankingRecord, RANKINGS) if not row.reason)
            return tuple(ranking_summary(ledger, name) for name in names)

    def verify(self) -> None:
        """See that runs, scores and events are what was written; StoreError tells what was changed by others."""
        with self._read() as ledger:
            self._known = ledger.last_event(), ledger.runs(sa.true())
            looks, events = tuple(ledger.records(LookRecord, LOOKS)), ledger.records(EventRecord, EVENTS)
            found = list(changes(self._known[1], looks, events))
        if found:
            remedy = "Restore the database from a copy."
            raise StoreError(*(Problem(text, remedy, file=self.label) for text in found[:5]))

    def info(self) -> dict[str, str]:
        """``campaign``, ``created_at`` and ``created_version``."""
        with self._read() as ledger:
            return {row.key: row.value for row in ledger.connection.execute(sa.select(META).order_by(META.c.key))}

    # -- transactions ---------------------------------------------------------------------------------------------

    @contextmanager
    def _read(self) -> Iterator[Ledger]:
        with self._database.read() as connection:
            yield Ledger(connection, self.seed)

    @contextmanager
    def _write(self) -> Iterator[Ledger]:
        with self._database.write() as connection:
            yield Ledger(connection, self.seed)

    @contextmanager
    def _decide(self) -> Iterator[Ledger]:
        """Write what rests on the state at the mark, if it is still the state but for this process's own decisions."""
        with self._write() as ledger:
            self._see_mark(ledger)
            yield ledger
            made = ledger.last_event(_NO_DECISIONS)
        if self._mark is not None:
            self._mark = made

    def _see_mark(self, ledger: Ledger) -> None:
        if self._mark not in (None, ledger.last_event(_NO_DECISIONS)):
            raise OvertakenError


def _need_reason(why: str) -> None:
    if not why.strip():
        raise StoreError("voiding needs a reason", 'Give one: --why "clouds", in Python why="clouds"', field="why")


def _this_process() -> str:
    return f"{socket.gethostname()}:{os.getpid()}:{_TOKEN}"


def _held() -> tuple[sa.ColumnElement[bool], ...]:
    """Of the runs that this process carries out."""
    return RUNS.c.state == "running", RUNS.c.owner == _this_process()


def _is_gone(owner: str) -> bool:
    """Whether the process "host:pid:token" ran here and is no more; on Windows, where asking would kill, never."""
    host, pid, token = owner.rsplit(":", 2) if owner.count(":") >= 2 else ("", "", "")
    if host != socket.gethostname() or not pid.isdigit() or sys.platform == "win32":
        return False
    if int(pid) == os.getpid():
        # In a container every program may be process 1: the token tells us from the one before.
        return token != _TOKEN
    try:
        os.kill(int(pid), 0)
    except OSError as error:  # it is there, too, where it is another user's
        return isinstance(error, ProcessLookupError)
    return False


BEAT_S = 60.0
"""Much less than `seqrsm.store.store.LEASE_S`."""


@contextmanager
def heartbeat(store: Store) -> Iterator[None]:
    """Let a thread say every `BEAT_S` seconds that this process is alive while the block runs."""
    done = threading.Event()

    def beat() -> None:
        while not done.wait(BEAT_S):
            with suppress(StoreError):  # a busy or absent database: the next beat may get through
                store.beat()

    thread = threading.Thread(target=beat, daemon=True, name="heartbeat")
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join(timeout=5.0)
