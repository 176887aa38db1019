"""Stores for the tests: SQLite always; PostgreSQL too where SEQRSM_TEST_POSTGRES names an empty data base."""

from __future__ import annotations

import os

import pytest
import sqlalchemy as sa

from seqrsm.campaign.store import Store

POSTGRES = os.environ.get("SEQRSM_TEST_POSTGRES")


def wipe(url: str) -> None:
    engine = sa.create_engine(url)
    with engine.begin() as connection:
        connection.execute(sa.text("DROP SCHEMA public CASCADE"))
        connection.execute(sa.text("CREATE SCHEMA public"))
    engine.dispose()


@pytest.fixture(params=["sqlite", "postgres"] if POSTGRES else ["sqlite"])
def url(request):
    """Address of an empty data base, None for the file in the folder."""
    if request.param == "sqlite":
        return None
    wipe(POSTGRES)
    return POSTGRES


@pytest.fixture
def store(tmp_path, url):
    with Store.open(tmp_path, url=url, create=True, campaign="test", seed=7) as opened:
        yield opened
