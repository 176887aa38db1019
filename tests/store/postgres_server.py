"""A PostgreSQL server of the tests' own, in a temporary folder, reached by a socket in it."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import sqlalchemy as sa


def find_server() -> Path | None:
    """Folder of the server's programs: on the path, or where Debian puts them."""
    on_path = shutil.which("initdb")
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda path: float(path.parts[4]))
    return Path(on_path).parent if on_path else found[-1].parent if found else None


USER = "postgres" if os.geteuid() == 0 else None  # the server refuses to be root


def call(programs: Path, program: str, *arguments: str) -> None:
    command = [str(programs / program), *arguments]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd="/", user=USER, group=USER)


@contextmanager
def restarted(url: str) -> Iterator[None]:
    """Stop the server of `running`, and start it again a moment after the block has begun."""
    programs = find_server()
    assert programs is not None
    data = Path(url.partition("host=")[2]) / "data"
    if not data.exists():
        pytest.skip("a server of somebody else is left alone")
    options = shlex.join(shlex.split((data / "postmaster.opts").read_text(encoding="utf-8"))[3:])
    call(programs, "pg_ctl", "-D", str(data), "-w", "-m", "fast", "stop")
    start = ("pg_ctl", "-D", str(data), "-w", "-l", str(data.parent / "log"), "-o", options, "start")
    again = threading.Timer(2.0, call, (programs, *start))
    again.start()
    try:
        yield
    finally:
        again.join()


@contextmanager
def running(programs: Path) -> Iterator[str]:
    """Address of an empty data base, as long as the block runs."""
    folder = Path(tempfile.mkdtemp(prefix="pg"))  # short: a socket's path has 107 bytes at most
    if USER is not None:
        shutil.chown(folder, USER)
    data = str(folder / "data")
    try:
        call(programs, "initdb", "-D", data, "-U", "seqrsm", "-A", "trust", "-E", "UTF8", "--locale=C", "--no-sync")
        options = f"-c listen_addresses= -c unix_socket_directories={folder} -c fsync=off -c max_connections=60"
        call(programs, "pg_ctl", "-D", data, "-w", "-l", str(folder / "log"), "-o", options, "start")
        try:
            yield f"postgresql+psycopg://seqrsm@/postgres?host={folder}"
        finally:
            call(programs, "pg_ctl", "-D", data, "-w", "-m", "immediate", "stop")
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def wipe(url: str) -> None:
    """Empty a data base."""
    engine = sa.create_engine(url)
    with engine.begin() as connection:
        connection.execute(sa.text("DROP SCHEMA public CASCADE"))
        connection.execute(sa.text("CREATE SCHEMA public"))
    engine.dispose()
