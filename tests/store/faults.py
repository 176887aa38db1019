"""A command that is killed, or meets an error, before the n-th of its file or SQL operations; a fork for each.

Operations are what opens a file to write, renames, removes or makes one (told by Python's audit hooks), each SQL
statement, and each commit. What SQLite does inside a commit is its own: random kills (tests/cli/kill_episodes.py) and
limits of the file system (tests/cli/test_bad_disks.py) meet it there. On PostgreSQL the operations are statements and
commits: the command is killed, its connection is lost (the server ends it) before the operation or after it, so that
only the answer is missing, or the server refuses it. An error comes once, or from that operation on to the end of the
command: the disk stays full, the server stays away.
"""

from __future__ import annotations

import errno
import functools
import json
import os
import shutil
import signal
import sqlite3
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psycopg
import sqlalchemy as sa
import typer.testing
from interleaving import SPEC, command, found, made
from sqlalchemy import event
from sqlalchemy.engine.default import DefaultDialect
from typer.testing import CliRunner

from seqrsm.campaign.campaign import Campaign
from seqrsm.cli.app import app
from seqrsm.errors import StoreError
from seqrsm.store import database

typer.testing._get_command = functools.cache(typer.testing._get_command)  # a third of a short command's time
typer.testing._get_command(app)
KILL, LOST, UNANSWERED, REFUSED = "kill", "lost", "lost after", "refused"
SERVER_HOWS = (KILL, LOST, UNANSWERED, REFUSED)
LASTING = " from then on"
"""End of the name of an error that stays."""
SECRET = "hunter2"
_REFUSALS = {
    "DiskFull": 'could not extend file "base/5/1": No space left on device',
    "LockNotAvailable": "canceling statement due to lock timeout",
    "QueryCanceled": "canceling statement due to statement timeout",
    "SerializationFailure": "could not serialize access due to concurrent update",
    "ReadOnlySqlTransaction": "cannot execute INSERT in a read-only transaction",
}
ERRORS = {"no space": errno.ENOSPC, "i/o": errno.EIO, "read-only": errno.EROFS}
_SQL = {
    "no space": "database or disk is full",
    "i/o": "disk I/O error",
    "read-only": "attempt to write a readonly database",
}
_FILES = ("os.rename", "os.remove", "os.mkdir", "os.rmdir")


class _Injection:
    """Counts operations, and lets one of them fail."""

    def __init__(self, moment: int, how: str, folder: Path) -> None:
        self.moment, self.how, self.folder, self.count = moment, how.removesuffix(LASTING), str(folder), 0
        self.lasts = how.endswith(LASTING)
        sys.addaudithook(self._audit)
        event.listen(sa.Engine, "before_cursor_execute", lambda *_: self._operate(sqlite3.OperationalError))
        event.listen(sa.Engine, "commit", lambda _: self._operate(sqlite3.OperationalError))

    def _audit(self, name: str, arguments: tuple[Any, ...]) -> None:
        writes = name == "open" and isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR)
        if (writes or name in _FILES) and str(arguments[0]).startswith(self.folder):
            self._operate(OSError)

    def _operate(self, kind: type[Exception]) -> None:
        if threading.current_thread() is not threading.main_thread():
            return
        self.count += 1
        if self.count != self.moment and not (self.lasts and self.count > self.moment):
            return
        if self.how == KILL:
            os.kill(os.getpid(), signal.SIGKILL)
        if kind is OSError:
            raise OSError(ERRORS[self.how], os.strerror(ERRORS[self.how]))
        raise kind(_SQL[self.how])


class _ServerInjection:
    """Counts the statements and commits of connections to a server, and lets one of them fail."""

    def __init__(self, moment: int, how: str) -> None:
        self.moment, self.how, self.count = moment, how.removesuffix(LASTING), 0
        self.lasts = how.endswith(LASTING)
        for name, at in (("do_execute", 0), ("do_execute_no_params", 0), ("do_executemany", 0), ("do_commit", None)):
            setattr(DefaultDialect, name, self._failing(getattr(DefaultDialect, name), at))
        real = DefaultDialect.connect

        def connect(dialect: Any, *arguments: Any, **options: Any) -> Any:
            if self.lasts and self.how == LOST and self.count >= self.moment:
                raise psycopg.OperationalError("connection failed: Connection refused")
            return real(dialect, *arguments, **options)

        DefaultDialect.connect = connect
        if self.lasts:
            database.RECONNECT_S = 0.1

    def _failing(self, real: Callable[..., None], at: int | None) -> Callable[..., None]:
        def operate(dialect: Any, first: Any, *rest: Any) -> None:
            if dialect.name != "postgresql":
                real(dialect, first, *rest)
                return
            self.count += 1
            if self.count != self.moment and not (self.lasts and self.count > self.moment):
                real(dialect, first, *rest)
                return
            connection = first.driver_connection if at is None else first.connection
            if self.how == KILL:
                os.kill(os.getpid(), signal.SIGKILL)
            if self.how == REFUSED:
                name = list(_REFUSALS)[self.moment % len(_REFUSALS)]
                raise getattr(psycopg.errors, name)(_REFUSALS[name])
            if self.how == UNANSWERED:
                real(dialect, first, *rest)
            if not connection.closed:
                _end(connection.info)
            if self.how == UNANSWERED:
                connection.close()
                raise psycopg.OperationalError("consuming input failed: server closed the connection unexpectedly")
            real(dialect, first, *rest)

        return operate


def _end(info: Any) -> None:
    """Let the server end a connection, and wait until it has."""
    with psycopg.connect(host=info.host, dbname="postgres", user=info.user, autocommit=True) as other:
        other.execute("SELECT pg_terminate_backend(%s, 5000)", (info.backend_pid,))


@dataclass(frozen=True)
class Case:
    """A command: how its folder is made, its arguments, whether it is done, and what is compared at the end."""

    prepare: Callable[[Path, str | None], None]
    arguments: Callable[[Path], list[object]]
    done: Callable[[Path], bool]
    result: Callable[[Path], Any]


def _n_runs(folder: Path) -> int:
    return len(found(folder / "c")[0])


def _content(name: str) -> Callable[[Path], Any]:
    def read(folder: Path) -> Any:
        return (folder / name).read_text(encoding="utf-8")

    return read


def _campaign(folder: Path, url: str | None) -> None:
    made(folder / "c", SPEC.replace("max_runs = 16", "max_runs = 11"), url)


def _proposed(folder: Path, url: str | None) -> None:
    _campaign(folder, url)
    command("propose", folder / "c")


def _scored(folder: Path, url: str | None) -> None:
    _proposed(folder, url)
    command("simulate", folder / "c")
    (folder / "s.csv").write_text("x,score\n" + "".join(f"{k / 10},{k}\n" for k in range(2)), encoding="utf-8")


def _state(run: int, state: str) -> Callable[[Path], bool]:
    return lambda folder: found(folder / "c")[0][run - 1][3] == state


CASES = {
    "run": Case(_campaign, lambda f: ["run", f / "c"], lambda f: False, lambda f: found(f / "c")),
    "simulate": Case(_proposed, lambda f: ["simulate", f / "c"], lambda f: False, lambda f: found(f / "c")),
    "propose": Case(
        _campaign,
        lambda f: ["propose", f / "c", "--source", "flight", "--csv", f / "form.csv"],
        lambda f: _n_runs(f) > 0,
        lambda f: found(f / "c"),
    ),
    "propose more": Case(
        _scored, lambda f: ["propose", f / "c", "-n", 2, "--source", "flight"], lambda f: _n_runs(f) > 9,
        lambda f: found(f / "c"),
    ),
    "ingest": Case(
        _scored, lambda f: ["ingest", f / "c", f / "s.csv"], lambda f: False, lambda f: found(f / "c")
    ),
    "void": Case(
        _scored, lambda f: ["void", f / "c", 3, "--why", "clouds"], _state(3, "void"), lambda f: found(f / "c")
    ),
    "init": Case(
        lambda folder, url: None,
        lambda f: ["init", f / "new", "--template", "flevoland"],
        lambda f: (f / "new" / "campaign.toml").exists(),
        _content("new/campaign.toml"),
    ),
    "export": Case(
        _scored, lambda f: ["export", f / "c", f / "all.csv"], lambda f: False, _content("all.csv")
    ),
    "report": Case(
        _scored, lambda f: ["report", f / "c", "--html", f / "r.html"], lambda f: False,
        _content("r.html"),
    ),
    "status": Case(_scored, lambda f: ["status", f / "c"], lambda f: False, lambda f: found(f / "c")),
}  # fmt: skip


SERVER_CASES = tuple(name for name in CASES if name != "init")  # it makes no data base


def prepared(name: str, folder: Path, url: str | None = None) -> None:
    """The state before a command, and that after it undisturbed, each in a folder (and data base) of its own."""
    for place in ("before", "calm"):
        (folder / place).mkdir(parents=True)
    if url is not None:
        _data_base(url, "before")
    CASES[name].prepare(folder / "before", _named(url, "before"))
    _copied(folder, "calm", url)
    done = CliRunner().invoke(app, [str(one) for one in CASES[name].arguments(folder / "calm")])
    assert done.exit_code in (0, 3), done.output


def _named(url: str | None, place: str) -> str | None:
    """Address of the data base of a place, with a password that no output may hold."""
    return url and url.replace("seqrsm@/postgres", f"seqrsm:{SECRET}@/{place}")


def _data_base(url: str, place: str, template: str = "template1") -> None:
    engine = sa.create_engine(url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(sa.text(f'DROP DATABASE IF EXISTS "{place}" WITH (FORCE)'))
        connection.execute(sa.text(f'CREATE DATABASE "{place}" TEMPLATE "{template}"'))
    engine.dispose()


def _copied(folder: Path, place: str, url: str | None) -> Path:
    """The state before the command, once more."""
    shutil.rmtree(folder / place, ignore_errors=True)
    shutil.copytree(folder / "before", folder / place)
    if url is not None:
        _data_base(url, place, "before")
        spec = folder / place / "c" / "campaign.toml"
        spec.write_text(spec.read_text(encoding="utf-8").replace("@/before", f"@/{place}"), encoding="utf-8")
    return folder / place


def injected(name: str, folder: Path, moment: int, how: str, url: str | None = None) -> bool:
    """Let the ``moment``-th operation of a command fail, see what must hold, and carry the command to its end.

    False when the command has no so many operations.
    """
    case, place = CASES[name], _copied(folder, "now", url)
    code, count, said = _forked(case.arguments(place), moment, how, place, url)
    met = count >= moment or code == -signal.SIGKILL
    where = f"{name}, {how} before operation {moment}: {said}"
    assert code in ((0, 3, -signal.SIGKILL) if how == KILL or not met else (0, 2, 3)), where
    assert "Traceback" not in said, where
    assert "Pipeline" not in said, where
    if url is not None:
        _left_nothing(url, place, where)
        assert how not in (LOST, UNANSWERED) or code != 2 or "not known: see what `seqrsm status`" in said, where
    left = _left(place, url)
    if left is not None and (name, left) in _CARRIED_ON:
        return met
    if not case.done(place):
        code, _, said = _forked(case.arguments(place), 0, KILL, place, url)
        assert code in (0, 3), f"{where}; again: {said}"
    assert case.result(place) == case.result(folder / "calm"), where
    _CARRIED_ON.add((name, left))
    return met


_CARRIED_ON: set[tuple[str, str | None]] = set()
"""States from which commands were given again: each once."""


def _left(place: Path, url: str | None) -> str | None:
    """What a command left in store and files, times and owners apart; None where there is no store yet."""
    if url is None and not ((place / "c" / "campaign.db").exists() and (place / "c" / "campaign.db").stat().st_size):
        return None
    if (place / "new").exists():
        return None
    with suppress(StoreError):  # not made yet
        store = Campaign.open(place / "c").store  # sound, and every hash and digest is right
        runs = [
            (*(getattr(run, name) for name in ("run_id", "batch", "purpose", "state", "attempts", "reason", "fault")),
             run.proposed, run.executed, [(score.application, score.score) for score in run.scores])
            for run in store.runs()
        ]  # fmt: skip
        looks = [(look.after_run, look.application, look.summary) for look in store.looks()]
        events = [(one.kind, one.run_id) for one in store.events()]
        taken = [one.name for one in store.files()]
        store.close()
        files = {
            str(path.relative_to(place)): path.read_bytes()
            for path in sorted(place.rglob("*"))
            if path.is_file() and not path.name.startswith("campaign.db")
        }
        return repr((runs, looks, events, taken, files))
    return None


def _left_nothing(url: str, place: Path, where: str) -> None:
    """No connection is left on the server a moment after a command, and its output and files hold no password."""
    assert SECRET not in where
    for path in (one for one in place.rglob("*") if one.is_file() and one.name != "campaign.toml"):
        assert SECRET.encode() not in path.read_bytes(), path
    engine = sa.create_engine(url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        count, end = sa.text("SELECT count(*) FROM pg_stat_activity WHERE datname = 'now'"), time.monotonic() + 10.0
        while (left := connection.execute(count).scalar()) and time.monotonic() < end:
            time.sleep(0.01)
    engine.dispose()
    assert not left, where


def _forked(arguments: list[object], moment: int, how: str, place: Path, url: str | None) -> tuple[int, int, str]:
    """Exit code of a command in a fork, the operations that it counted, and what it said."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read)
        injection = _Injection(moment, how, place) if url is None else _ServerInjection(moment, how)
        result = CliRunner().invoke(app, [str(one) for one in arguments])
        said = result.output + (f"Traceback {result.exc_info!r}" if result.exit_code == 1 else "")
        with os.fdopen(write, "w", encoding="utf-8") as stream:
            json.dump((injection.count, said), stream)
        os._exit(result.exit_code)
    os.close(write)
    with os.fdopen(read, encoding="utf-8") as stream:
        text = stream.read()
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    count, said = json.loads(text) if text else (0, "")
    return code, count, said
