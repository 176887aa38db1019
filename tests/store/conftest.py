"""Stores for the tests: SQLite, and PostgreSQL.

The PostgreSQL server is the tests' own (see postgres_server.py), or one that SEQRSM_TEST_POSTGRES names; its data
base is wiped.
"""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
from postgres_server import find_server, running, wipe

from seqrsm.store.store import Store


@pytest.fixture(scope="session")
def postgres() -> Iterator[str]:
    """Address of a data base that may be wiped."""
    pytest.importorskip("psycopg", reason="the driver of PostgreSQL is not installed (extra 'postgres')")
    if named := os.environ.get("SEQRSM_TEST_POSTGRES"):
        yield named
        return
    programs = find_server()
    if programs is None:
        pytest.skip("no PostgreSQL server is installed (Debian: apt-get install postgresql)")
    with running(programs) as address:
        yield address


@pytest.fixture(params=["sqlite", "postgres"])
def url(request: pytest.FixtureRequest) -> str | None:
    """Address of an empty data base, None for the file in the folder."""
    if request.param == "sqlite":
        return None
    address: str = request.getfixturevalue("postgres")
    wipe(address)
    return address


@pytest.fixture
def store(tmp_path, url):
    with Store.open(tmp_path, url=url, create=True, campaign="test", seed=7) as opened:
        yield opened
