"""Connections to the campaign's database: opening, creating, and short transactions.

SQLite runs in WAL mode with synchronous FULL, so a score that was acknowledged survives a loss of power; PostgreSQL
does the same by default. Writers take one lock each (``BEGIN IMMEDIATE``, or the row of ``alembic_version``), so that
the same code is right on both, and none writes into tables of another version. On a network
file system, where the hosts cannot share WAL's memory, SQLite keeps a rollback journal. A file that may not be written
is read as it is.
"""

from __future__ import annotations

import json
import logging
import os
import secrets
import signal
import sqlite3
import threading
import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy import event, exc

from seqrsm import __version__
from seqrsm.errors import StoreError
from seqrsm.plain import plain
from seqrsm.store.schema import EVENTS, META, METADATA, VERSION

BUSY_TIMEOUT_S = 30.0
RECONNECT_S = 60.0
"""How long a server that was there may be away, as when it is started again, before a transaction is given up [s]."""
_SERVER_LIMITS = f"-c lock_timeout={BUSY_TIMEOUT_S:.0f}s -c statement_timeout=120s"
"""Further limits of a server: 10 s to connect, 60 s for what was sent to arrive."""


def utc_now(ago_s: float = 0.0) -> str:
    """The time, ``ago_s`` [s] before now, as ISO 8601 text, UTC, microseconds."""
    return (datetime.now(UTC) - timedelta(seconds=ago_s)).isoformat(timespec="microseconds").replace("+00:00", "Z")


def _to_json(value: Any) -> str:
    return json.dumps(plain(value), allow_nan=False, ensure_ascii=False)


class Database:
    """One campaign's database, open: an SQLite file, or a URL such as ``postgresql+psycopg://host/name``.

    ``create``: make the tables when there are none; otherwise their absence is an error. ``campaign`` is the name that
    a new database gets; an existing one of another name is refused when this is not empty. StoreError where it cannot
    be opened: missing, read-only, damaged, of another version, or another campaign's.
    """

    def __init__(self, location: Path | str, *, create: bool = False, campaign: str = "") -> None:
        self.path = location if isinstance(location, Path) else None
        self.network, self.read_only = "", False
        self._identity: tuple[int, int] | None = None
        self._rescued = ""
        self._made = False
        if self.path is not None:
            _check_path(self.path, create)
            if not self.path.exists():
                self._make_file(self.path, campaign)
            with suppress(OSError):
                mounts = _MOUNTS.read_text(encoding="utf-8", errors="replace")
                self.network = network_file_system(self.path.parent.resolve(), mounts)
            self.read_only = self.path.exists() and not (_may_write(self.path) and _may_write(self.path.parent))
        self.label = str(self.path) if self.path is not None else _hide_password(str(location))
        self._engine = self._make_engine(location)
        weakref.finalize(self, self._engine.dispose)  # of what a notebook leaves open
        try:
            with self._explained():
                self._open(create, campaign)
        except BaseException:
            self.close()
            raise
        self._identity = self._found()

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()

    def leave(self) -> None:
        """Close for good; see `seqrsm.store.store.Store.leave`."""
        with suppress(exc.DBAPIError, sqlite3.Error, OSError, StoreError):
            if self._made and self.path is not None:
                with self.read() as connection:
                    used = connection.execute(sa.select(EVENTS.c.id).limit(1)).first()
                self.close()
                if not used and not _has_log(self.path):  # the last to close takes the log away
                    self.path.unlink()
        self.close()

    @contextmanager
    def read(self) -> Iterator[sa.Connection]:
        """A transaction that sees one consistent state."""
        with _interrupted_later(), self._explained(), self._connected() as connection:
            if connection.dialect.name == "postgresql":
                connection = connection.execution_options(isolation_level="REPEATABLE READ")
            with connection.begin():
                yield connection

    @contextmanager
    def write(self) -> Iterator[sa.Connection]:
        """A transaction that is alone in writing; durable when the block ends, undone when it raises."""
        if self.read_only:
            raise StoreError("the database may not be written", _RIGHTS, file=self.label)
        with _interrupted_later(), self._explained(), self._connected() as connection:
            connection = connection.execution_options(seqrsm_write=True)
            with connection.begin():
                # As the last writer left it; no other writes before this transaction's end.
                self._check_version(str(connection.execute(sa.select(_VERSION).with_for_update()).scalar()))
                yield connection
            self._see_file()

    @contextmanager
    def _connected(self) -> Iterator[sa.Connection]:
        """A connection; a server that was there and is not is waited for."""
        self._see_file()
        deadline = time.monotonic() + RECONNECT_S
        while True:
            try:
                connection = self._engine.connect()
                break
            except exc.OperationalError:
                if self.path is not None or time.monotonic() > deadline:
                    raise
                time.sleep(0.5)
        with connection:
            yield connection

    def _found(self) -> tuple[int, int] | None:
        """Device and number of the file at the database's path."""
        if self.path is None:
            return None
        with suppress(OSError):
            found = self.path.stat()
            return found.st_dev, found.st_ino
        return (0, 0)

    def _see_file(self) -> None:
        """Refuse to go on where SQLite would write into a file that nobody finds again."""
        if self._found() == self._identity:
            return
        assert self.path is not None
        if not self._rescued and self.path.parent.is_dir():
            stamp = utc_now().replace(":", "").replace("-", "")
            place = self.path.with_name(f"{self.path.name}.{stamp}.rescued")
            with suppress(exc.DBAPIError, sqlite3.Error), self._engine.connect() as connection:
                _copy_into(connection, place)
                self._rescued = f"What it held is in {place}."
        message = "the database is no longer the file that was opened: it was moved, deleted or replaced"
        raise StoreError(message, f"Restore it. {self._rescued}".strip(), file=self.label)

    # -- opening --------------------------------------------------------------------------------------------------

    def _make_engine(self, location: Path | str) -> sa.Engine:
        if self.path is None:
            try:
                url = sa.make_url(str(location))
                limits = {"connect_timeout": 10, "tcp_user_timeout": 60_000} | dict(url.query)
                limits["options"] = f"{_SERVER_LIMITS} {url.query.get('options', '')}".strip()
                logging.getLogger("psycopg").addHandler(logging.NullHandler())  # what it says is in the errors
                engine = sa.create_engine(url, json_serializer=_to_json, pool_pre_ping=True, connect_args=limits)
            except (exc.ArgumentError, exc.NoSuchModuleError, ValueError):
                message, remedy = "the address of the database is not usable", f'Write url = "{_SERVER}user@host/name".'
                raise StoreError(message, remedy, field="[store] url", value=self.label) from None
            except ImportError as error:
                message = f"the driver of the database is missing ({error})"
                raise StoreError(message, 'Run: pip install "seqrsm[postgres]"') from None
        else:
            query = {"uri": "true"} | ({"mode": "ro", "immutable": "1"} if self.read_only else {"mode": "rw"})
            url = sa.URL.create("sqlite", database=self.path.absolute().as_uri(), query=query)
            engine = sa.create_engine(url, json_serializer=_to_json, connect_args={"timeout": BUSY_TIMEOUT_S})
            mode = "" if self.read_only else "DELETE" if self.network else "WAL"
            event.listen(engine, "connect", partial(_prepare_sqlite, mode))
            event.listen(engine, "begin", _begin_sqlite)
        return engine

    def _open(self, create: bool, campaign: str) -> None:
        with self._engine.connect() as connection:
            version = _schema_version(connection)
        if version is None:
            if not create or self.path is not None:
                raise StoreError(_NO_TABLES, _NEW_OR_COPY, file=self.label)
            self._create(campaign)
        else:
            self._check_version(version)
        with self._engine.connect() as connection:
            name = connection.execute(sa.select(META.c.value).where(META.c.key == "campaign")).scalar()
        if name is None:
            raise StoreError("the database has no campaign name", "Restore it from a copy.", file=self.label)
        if campaign and name != campaign:
            message = f"the database belongs to the campaign '{name}', not '{campaign}'"
            remedy = "Give each campaign a folder or database of its own, or restore the name in campaign.toml."
            raise StoreError(message, remedy, file=self.label)
        self.campaign = name

    def _check_version(self, version: str) -> None:
        if version != VERSION:
            known = f"schema {version}; seqrsm {__version__} has {VERSION}"
            message = f"the database was written by another version of seqrsm ({known})"
            raise StoreError(message, "Use the version that wrote it.", file=self.label)

    def _create(self, campaign: str) -> None:
        with self._engine.connect() as connection, connection.begin():
            connection.execute(sa.text("SELECT pg_advisory_xact_lock(1381190961)"))
            # Another process may have made the tables since we looked.
            if _schema_version(connection) is None:
                _fill(connection, campaign)

    def _make_file(self, path: Path, campaign: str) -> None:
        """A whole database or none, whoever else makes it, and whenever this process is killed."""
        draft = path.with_name(f"{path.name}.{secrets.token_hex(4)}.new")
        engine = sa.create_engine(sa.URL.create("sqlite", database=str(draft)))
        try:
            with engine.begin() as connection:
                _fill(connection, campaign)
            engine.dispose()
            with suppress(FileExistsError):
                _name(draft, path)
                self._made = True
        except (OSError, exc.DBAPIError) as error:
            why = error.orig if isinstance(error, exc.DBAPIError) else error.strerror
            raise StoreError(
                f"the database cannot be made ({why})", "Check that its folder may be written.", file=str(path)
            ) from None
        finally:
            draft.unlink(missing_ok=True)

    # -- errors ---------------------------------------------------------------------------------------------------

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Turn the database's own exceptions into a StoreError with a remedy."""
        try:
            yield
        except (exc.DBAPIError, sqlite3.Error) as error:
            text = str(error.orig if isinstance(error, exc.DBAPIError) else error).partition("\n")[0]
            if isinstance(error, exc.DBAPIError) and error.connection_invalidated:  # a commit's answer may be missing
                message = f"the connection to the database was lost ({text})"
                raise StoreError(message, _LOST, file=self.label) from error
            # What a log holds is not missing: where the disk was full, the header may be ahead of the file.
            if self.path is not None and not _log_size(self.path) and (missing := _cut_off(self.path)):
                message = f"the database is damaged: {missing} bytes are missing at its end ({text})"
                raise StoreError(message, _RESTORE, file=self.label) from error
            for sign, message, remedy in _EXPLANATIONS:
                if sign in text.lower():
                    raise StoreError(f"{message} ({text})", remedy, file=self.label) from error
            remedy = "Nothing was changed; try again."
            raise StoreError(f"the database refused ({text})", remedy, file=self.label) from error
        except (json.JSONDecodeError, UnicodeDecodeError) as error:
            raise StoreError(f"the database holds damaged text ({error})", _RESTORE, file=self.label) from error


_VERSION = sa.table("alembic_version", sa.column("version_num"))  # so named when alembic migrated
_SERVER = "postgresql+psycopg://"
_LOST = "Whether the last change was kept is not known: see what `seqrsm status` tells, then give the command again."
_RIGHTS = "Obtain write permission for the file and its folder, or copy the folder to a writable place."
_ABSENT_REMEDY = "Make a campaign with `seqrsm init`, or start this one with `seqrsm run`."
_NO_TABLES = "this is no campaign's database: it has no tables"
_NEW_OR_COPY = "Restore the file from a copy, or delete it if the campaign is new."
_RESTORE = "Restore the file from a copy; what can be read comes out with: sqlite3 campaign.db .recover"
_EXPLANATIONS = (
    ("not a database", "the file is not a database, or its beginning is damaged", _RESTORE),
    ("malformed", "the database is damaged", _RESTORE),
    ("disk i/o error", "the disk could not be read or written", "Check the disk and its free space, then try again."),
    ("disk is full", "the disk is full", "Free some space; nothing acknowledged was lost."),
    ("no space left", "the server's disk is full", "Free some space; nothing acknowledged was lost."),
    ("readonly", "the database may not be written", _RIGHTS),
    ("unable to open", "the database cannot be opened", "Check that file and folder exist and may be written."),
    (
        "locked",
        f"another process held the database for {BUSY_TIMEOUT_S:.0f} s",
        "Wait for it to finish, then try again.",
    ),
    ("timeout", "the database server did not answer in time", "Wait for other commands to finish, then try again."),
    ("no such table", "the database lacks a table", _RESTORE),
    ("no such column", "the database lacks a column", _RESTORE),
    ("connection failed", "the database server does not answer", "Check host, name, user and network."),
    ("could not connect", "the database server does not answer", "Check host, name, user and network."),
)


_MOUNTS = Path("/proc/mounts")
_NETWORK = ("nfs", "nfs4", "cifs", "smb3", "smbfs", "fuse.sshfs", "fuse.glusterfs")


@contextmanager
def _interrupted_later() -> Iterator[None]:
    """Signals of the user wait for the end of the block: one between two statements would leave a transaction open.

    What releases runs afterwards would then wait for the lock that its own process holds. A thread hears none anyway.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[tuple[int, Any]] = []
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    heard = {number: handler for number, handler in before.items() if callable(handler)}
    try:
        for number in heard:
            signal.signal(number, lambda *given: waiting.append(given))
        yield
    finally:
        for number, handler in heard.items():
            signal.signal(number, handler)
        for given, frame in waiting:
            heard[signal.Signals(given)](given, frame)


def _check_path(path: Path, create: bool) -> None:
    if path.is_dir():
        raise StoreError("a folder stands where the database should be", "Move it.", file=str(path))
    if not path.parent.is_dir():
        raise StoreError("there is no such folder", _ABSENT_REMEDY, file=str(path.parent))
    if not create and not path.exists():
        raise StoreError("there is no database yet", _ABSENT_REMEDY, file=str(path))
    if path.exists() and not path.stat().st_size:
        raise StoreError(_NO_TABLES, _NEW_OR_COPY, file=str(path))
    # Beside a write-ahead log the file may rightly be shorter than its header says.
    if not _has_log(path) and (missing := _cut_off(path)) and not _has_log(path):
        raise StoreError(f"the database is damaged: {missing} bytes are missing at its end", _RESTORE, file=str(path))
    if not _may_write(path.parent) and _log_size(path):
        message = "the database was not closed, and its last changes can only be read where its folder may be written"
        raise StoreError(message, "Copy the folder to a place that may be written.", file=str(path))


def _may_write(path: Path) -> bool:
    return os.access(path, os.W_OK, effective_ids=os.access in os.supports_effective_ids)


def _copy_into(connection: sa.Connection, place: Path) -> None:
    """Copy an SQLite database into a new file."""
    raw = connection.connection.driver_connection
    assert isinstance(raw, sqlite3.Connection)
    try:
        raw.execute("VACUUM INTO ?", (str(place),))
    except sqlite3.Error:
        place.unlink(missing_ok=True)  # half a copy is none
        raise


def network_file_system(folder: Path, mounts: str) -> str:
    """Kind of the network file system that holds a folder, by the lines of ``/proc/mounts``; "" for a local one.

    SQLite's write-ahead log shares memory between processes, which hosts cannot do: there it keeps a rollback journal.
    """
    kinds: dict[Path, str] = {}
    for line in mounts.splitlines():
        words = line.split(" ")
        if len(words) > 2:
            kinds[Path(words[1].replace("\\040", " "))] = words[2]
    place = next((parent for parent in (folder, *folder.parents) if parent in kinds), None)
    kind = "" if place is None else kinds[place]
    return kind if kind in _NETWORK else ""


def _has_log(path: Path) -> bool:
    return path.with_name(path.name + "-wal").exists()


def _log_size(path: Path) -> int:
    try:
        return path.with_name(path.name + "-wal").stat().st_size
    except OSError:  # there is none, or another process has just taken it away
        return 0


def _cut_off(path: Path) -> int:
    """Bytes that an SQLite file lacks by its own header: pages of 2 ** k bytes, and how many of them."""
    try:
        with path.open("rb") as stream:
            head = stream.read(100)
        size = path.stat().st_size
    except OSError:
        return 0
    if not head.startswith(b"SQLite format 3\0"):
        return 0
    if len(head) < 100:
        return 100 - len(head)
    page = int.from_bytes(head[16:18], "big")
    return max(0, (65536 if page == 1 else page) * int.from_bytes(head[28:32], "big") - size)


def _hide_password(url: str) -> str:
    try:
        return sa.make_url(url).render_as_string(hide_password=True)
    except (exc.ArgumentError, ValueError):
        return "(unreadable)"


def _prepare_sqlite(mode: str, connection: sqlite3.Connection, _record: object) -> None:
    # SQLAlchemy's `begin` event below decides how a transaction starts; the driver must not.
    connection.isolation_level = None
    cursor = connection.cursor()
    try:
        cursor.execute(f"PRAGMA busy_timeout = {int(BUSY_TIMEOUT_S * 1000)}")
        cursor.execute("PRAGMA foreign_keys = ON")
        found = _enter(cursor, mode) if mode else mode
        cursor.execute("PRAGMA synchronous = FULL")
    finally:
        cursor.close()
    if found.upper() != mode:
        message = f"the file system does not support SQLite's journal {mode} (journal mode '{found}')"
        remedy = f'Keep the campaign on a local disk, or share it by [store] url = "{_SERVER}...".'
        raise StoreError(message, remedy)


def _enter(cursor: sqlite3.Cursor, mode: str) -> str:
    """Switch to a journal mode. Two processes that do so at once on a new file may meet a lock no timeout heeds."""
    deadline = time.monotonic() + BUSY_TIMEOUT_S
    while True:
        try:
            return str(cursor.execute(f"PRAGMA journal_mode = {mode}").fetchone()[0])
        except sqlite3.OperationalError as error:
            if "locked" not in str(error) or time.monotonic() > deadline:
                raise
            time.sleep(0.01)


def _begin_sqlite(connection: sa.Connection) -> None:
    write = connection.get_execution_options().get("seqrsm_write", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if write else "BEGIN")


def _name(draft: Path, path: Path) -> None:
    """Give a file its name, unless another has it."""
    try:
        os.link(draft, path)
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        if not path.exists():
            draft.rename(path)


def _fill(connection: sa.Connection, campaign: str) -> None:
    METADATA.create_all(connection)
    rows = {"campaign": campaign, "created_at": utc_now(), "created_version": __version__}
    connection.execute(sa.insert(META), [{"key": key, "value": value} for key, value in rows.items()])
    connection.execute(sa.text("CREATE TABLE alembic_version (version_num VARCHAR(32) PRIMARY KEY)"))
    connection.execute(sa.text("INSERT INTO alembic_version VALUES (:head)"), {"head": VERSION})


def _schema_version(connection: sa.Connection) -> str | None:
    """Version of the tables; None where there are none."""
    if not sa.inspect(connection).has_table("alembic_version"):
        if sa.inspect(connection).has_table("runs"):
            raise StoreError("the database has tables but no schema version", _RESTORE)
        return None
    return str(connection.execute(sa.select(_VERSION)).scalar())
