"""Connections to the campaign's data base: opening, creating, migrating, and short transactions.

SQLite runs in WAL mode with synchronous FULL, so a score that was acknowledged survives a loss of power; PostgreSQL
does the same by default. Writers take one lock each (``BEGIN IMMEDIATE``, or the row "campaign" of ``meta``), so that
the same code is right on both.
"""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy import event, exc

from seqrsm import __version__
from seqrsm.errors import Problem, StoreError
from seqrsm.plain import plain
from seqrsm.store.schema import HEAD, META, METADATA, REVISIONS

BUSY_TIMEOUT_S = 30.0
MIGRATIONS = Path(__file__).parent / "migrations"
# Identifies a campaign's file to `file` and to us; any constant does.
_APPLICATION_ID = 0x52534D31


def utc_now() -> str:
    """The time as ISO 8601 text, UTC, microseconds."""
    return datetime.now(UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")


def _to_json(value: Any) -> str:
    return json.dumps(plain(value), allow_nan=False, ensure_ascii=False)


class Database:
    """One campaign's data base, open.

    Parameters
    ----------
    location : Path or str
        SQLite file, or an SQLAlchemy URL such as ``postgresql+psycopg://host/name``.
    create : bool
        Make the tables when there are none; otherwise their absence is an error.
    campaign : str
        Name that a new data base gets; an existing one of another name is refused when this is not empty.
    migrations : Path
        Folder of the schema versions (replaced in tests only).
    revisions : sequence of str
        Schema versions, oldest first (replaced in tests only).

    Raises
    ------
    StoreError
        It cannot be opened: missing, read-only, damaged, newer than the program, or another campaign's.
    """

    def __init__(
        self,
        location: Path | str,
        *,
        create: bool = False,
        campaign: str = "",
        migrations: Path = MIGRATIONS,
        revisions: Sequence[str] = REVISIONS,
    ) -> None:
        self.path = location if isinstance(location, Path) else None
        self._migrations = migrations
        self._revisions = tuple(revisions)
        if self.path is not None:
            _check_path(self.path, create)
        self.label = str(self.path) if self.path is not None else _hide_password(str(location))
        self._engine = self._make_engine(location)
        try:
            with self._explained():
                self._open(create, campaign)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()

    @contextmanager
    def read(self) -> Iterator[sa.Connection]:
        """A transaction that sees one consistent state."""
        with self._explained(), self._engine.connect() as connection:
            if connection.dialect.name == "postgresql":
                connection = connection.execution_options(isolation_level="REPEATABLE READ")
            with connection.begin():
                yield connection

    @contextmanager
    def write(self) -> Iterator[sa.Connection]:
        """A transaction that is alone in writing; durable when the block ends, undone when it raises."""
        with self._explained(), self._engine.connect() as connection:
            connection = connection.execution_options(seqrsm_write=True)
            with connection.begin():
                connection.execute(sa.select(META.c.value).where(META.c.key == "campaign").with_for_update())
                yield connection

    # -- opening --------------------------------------------------------------------------------------------------

    def _make_engine(self, location: Path | str) -> sa.Engine:
        if self.path is None:
            try:
                engine = sa.create_engine(str(location), json_serializer=_to_json, pool_pre_ping=True)
            except (exc.ArgumentError, exc.NoSuchModuleError) as error:
                raise StoreError(
                    Problem(
                        f"the address of the data base is not usable ({error})",
                        'Write url = "postgresql+psycopg://user@host/name".',
                        field="[store] url",
                        value=self.label,
                    )
                ) from None
            except ImportError as error:
                raise StoreError(
                    Problem(f"the driver of the data base is missing ({error})", 'Run: pip install "seqrsm[postgres]"')
                ) from None
        else:
            url = sa.URL.create("sqlite", database=str(self.path))
            engine = sa.create_engine(url, json_serializer=_to_json, connect_args={"timeout": BUSY_TIMEOUT_S})
        if engine.dialect.name == "sqlite":
            event.listen(engine, "connect", _prepare_sqlite)
            event.listen(engine, "begin", _begin_sqlite)
        return engine

    def _open(self, create: bool, campaign: str) -> None:
        with self._engine.connect() as connection:
            version = _schema_version(connection)
        if version is None:
            if not create:
                raise StoreError(
                    Problem("this is no campaign's data base: it has no tables", _ABSENT_REMEDY, file=self.label)
                )
            self._create(campaign)
        elif version not in self._revisions:
            raise StoreError(
                Problem(
                    f"the data base was written by a newer seqrsm than this one (schema {version}, known up to"
                    f" {self._revisions[-1]}, program {__version__})",
                    "Upgrade seqrsm: pip install --upgrade seqrsm",
                    file=self.label,
                )
            )
        elif version != self._revisions[-1]:
            self._migrate(version)
        with self._engine.connect() as connection:
            name = connection.execute(sa.select(META.c.value).where(META.c.key == "campaign")).scalar()
        if name is None:
            raise StoreError(Problem("the data base has lost its name", "Restore it from a copy.", file=self.label))
        if campaign and name != campaign:
            raise StoreError(
                Problem(
                    f"the data base belongs to the campaign '{name}', not '{campaign}'",
                    "Give each campaign a folder or data base of its own, or restore the name in campaign.toml.",
                    file=self.label,
                )
            )
        self.campaign = name

    def _create(self, campaign: str) -> None:
        with self._engine.connect() as connection:
            connection = connection.execution_options(seqrsm_write=True)
            with connection.begin():
                if connection.dialect.name == "postgresql":
                    connection.execute(sa.text("SELECT pg_advisory_xact_lock(1381190961)"))
                # Another process may have made the tables since we looked.
                if _schema_version(connection) is not None:
                    return
                METADATA.create_all(connection)
                rows = {"campaign": campaign, "created_at": utc_now(), "created_version": __version__}
                connection.execute(sa.insert(META), [{"key": key, "value": value} for key, value in rows.items()])
                connection.execute(sa.text("CREATE TABLE alembic_version (version_num VARCHAR(32) PRIMARY KEY)"))
                connection.execute(sa.text("INSERT INTO alembic_version VALUES (:head)"), {"head": HEAD})
                if connection.dialect.name == "sqlite":
                    connection.exec_driver_sql(f"PRAGMA application_id = {_APPLICATION_ID}")

    def _migrate(self, version: str) -> None:
        from alembic import command
        from alembic.config import Config

        if self.path is not None:
            stamp = utc_now().replace(":", "").replace("-", "")
            backup = self.path.with_name(f"{self.path.name}.schema-{version}.{stamp}.bak")
            with self._engine.connect() as connection:
                raw = connection.connection.driver_connection
                assert isinstance(raw, sqlite3.Connection)
                try:
                    raw.execute("VACUUM INTO ?", (str(backup),))
                except sqlite3.Error:
                    backup.unlink(missing_ok=True)  # half a copy is none
                    raise
        config = Config()
        config.set_main_option("script_location", str(self._migrations).replace("%", "%%"))
        with self._engine.connect() as connection:
            connection = connection.execution_options(seqrsm_write=True)
            with _unchecked_references(connection), connection.begin():
                # Another process may have migrated while we waited for the lock.
                if _schema_version(connection) == version:
                    config.attributes["connection"] = connection
                    command.upgrade(config, self._revisions[-1])
                    _check_references(connection, self.label)

    # -- errors ---------------------------------------------------------------------------------------------------

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Turn the data base's own exceptions into a StoreError with a remedy."""
        try:
            yield
        except (exc.DBAPIError, sqlite3.Error) as error:
            text = str(error.orig if isinstance(error, exc.DBAPIError) else error)
            if self.path is not None and (missing := _cut_off(self.path)):
                message = f"the data base is damaged: {missing} bytes are missing at its end ({text})"
                raise StoreError(Problem(message, _RESTORE, file=self.label)) from error
            for sign, message, remedy in _EXPLANATIONS:
                if sign in text.lower():
                    raise StoreError(Problem(f"{message} ({text})", remedy, file=self.label)) from error
            raise StoreError(
                Problem(f"the data base refused ({text})", "Nothing was changed; try again.", file=self.label)
            ) from error
        except (json.JSONDecodeError, UnicodeDecodeError) as error:
            raise StoreError(
                Problem(f"the data base holds damaged text ({error})", _RESTORE, file=self.label)
            ) from error


_ABSENT_REMEDY = "Make a campaign with `seqrsm init`, or start this one with `seqrsm run`."
_RESTORE = "Restore the file from a copy; what can be read comes out with: sqlite3 campaign.db .recover"
_EXPLANATIONS = (
    ("not a database", "the file is not a data base, or its beginning is damaged", _RESTORE),
    ("malformed", "the data base is damaged", _RESTORE),
    ("disk i/o error", "the disk could not be read or written", "Check the disk and its free space, then try again."),
    ("disk is full", "the disk is full", "Free some space; nothing acknowledged was lost."),
    ("readonly", "the data base may not be written", "Give yourself the right to write the file and its folder."),
    ("unable to open", "the data base cannot be opened", "Check that file and folder exist and may be written."),
    ("locked", f"another process held the data base for {BUSY_TIMEOUT_S:.0f} s", "Let it end, then try again."),
    ("no such table", "the data base lacks a table", _RESTORE),
    ("no such column", "the data base lacks a column", _RESTORE),
    ("connection failed", "the data base server does not answer", "Check host, name, user and network."),
    ("could not connect", "the data base server does not answer", "Check host, name, user and network."),
)


_MOUNTS = Path("/proc/mounts")
_NETWORK = ("nfs", "nfs4", "cifs", "smb3", "smbfs", "fuse.sshfs", "fuse.glusterfs")


def _check_path(path: Path, create: bool) -> None:
    if path.is_dir():
        raise StoreError(Problem("a folder stands where the data base should be", "Move it away.", file=str(path)))
    if not path.parent.is_dir():
        raise StoreError(Problem("there is no such folder", _ABSENT_REMEDY, file=str(path.parent)))
    if not create and not path.exists():
        raise StoreError(Problem("there is no data base yet", _ABSENT_REMEDY, file=str(path)))
    # Beside a write-ahead log the file may rightly be shorter than its header says.
    if not _has_log(path) and (missing := _cut_off(path)) and not _has_log(path):
        raise StoreError(
            Problem(f"the data base is damaged: {missing} bytes are missing at its end", _RESTORE, file=str(path))
        )
    with suppress(OSError):
        kind = network_file_system(path.parent.resolve(), _MOUNTS.read_text(encoding="utf-8", errors="replace"))
        if kind:
            raise StoreError(
                Problem(
                    f"the folder lies on a network file system ({kind}), where hosts would spoil each other's writing",
                    'Keep the campaign on a local disk, or share it by [store] url = "postgresql+psycopg://...".',
                    file=str(path.parent),
                )
            )


def network_file_system(folder: Path, mounts: str) -> str:
    """Kind of the network file system that holds a folder, by the lines of ``/proc/mounts``; "" for a local one.

    SQLite's write-ahead log shares memory between processes, which hosts cannot do.
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
    except exc.ArgumentError:
        return "(unreadable)"


def _prepare_sqlite(connection: sqlite3.Connection, _record: object) -> None:
    # SQLAlchemy's `begin` event below decides how a transaction starts; the driver must not.
    connection.isolation_level = None
    cursor = connection.cursor()
    try:
        cursor.execute(f"PRAGMA busy_timeout = {int(BUSY_TIMEOUT_S * 1000)}")
        cursor.execute("PRAGMA foreign_keys = ON")
        mode = _enter_wal(cursor)
        cursor.execute("PRAGMA synchronous = FULL")
    finally:
        cursor.close()
    if mode not in ("wal", "memory"):
        raise StoreError(
            Problem(
                f"the file system does not support SQLite's write-ahead log (journal mode '{mode}')",
                'Keep the campaign on a local disk, or share it by [store] url = "postgresql+psycopg://...".',
            )
        )


def _enter_wal(cursor: sqlite3.Cursor) -> str:
    """Switch to WAL. Two processes that do so at once on a new file may meet a lock the busy timeout ignores."""
    deadline = time.monotonic() + BUSY_TIMEOUT_S
    while True:
        try:
            return str(cursor.execute("PRAGMA journal_mode = WAL").fetchone()[0])
        except sqlite3.OperationalError as error:
            if "locked" not in str(error) or time.monotonic() > deadline:
                raise
            time.sleep(0.01)


@contextmanager
def _unchecked_references(connection: sa.Connection) -> Iterator[None]:
    """Batch mode drops and renames tables that others refer to; SQLite ignores this switch inside a transaction."""
    raw = connection.connection.driver_connection
    if not isinstance(raw, sqlite3.Connection):
        yield
        return
    raw.execute("PRAGMA foreign_keys = OFF")
    try:
        yield
    finally:
        raw.execute("PRAGMA foreign_keys = ON")


def _check_references(connection: sa.Connection, label: str) -> None:
    if connection.dialect.name == "sqlite" and connection.exec_driver_sql("PRAGMA foreign_key_check").first():
        raise StoreError(Problem("the migration would break references between tables", _RESTORE, file=label))


def _begin_sqlite(connection: sa.Connection) -> None:
    write = connection.get_execution_options().get("seqrsm_write", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if write else "BEGIN")


def _schema_version(connection: sa.Connection) -> str | None:
    """Version by plain SQL: alembic costs 0.3 s to import and is needed only to migrate."""
    if not sa.inspect(connection).has_table("alembic_version"):
        if sa.inspect(connection).has_table("runs"):
            raise StoreError(Problem("the data base has tables but no schema version", _RESTORE))
        return None
    return str(connection.execute(sa.text("SELECT version_num FROM alembic_version")).scalar())
