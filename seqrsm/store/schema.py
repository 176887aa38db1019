"""Tables of the campaign's data base, the same for SQLite and PostgreSQL.

Times are UTC in ISO 8601, as text: they sort, and both data bases keep every digit.
"""

from __future__ import annotations

from types import NoneType
from typing import Any

import sqlalchemy as sa

from seqrsm.store.records import EventRecord, FileRecord, LookRecord, RankingRecord, RunRecord, ScoreRecord, typed

#: States of a run, and the states that each may pass into.
TRANSITIONS: dict[str, frozenset[str]] = {
    "issued": frozenset({"running", "scored", "failed", "void"}),
    "running": frozenset({"issued", "scored", "failed", "void"}),
    "scored": frozenset({"void"}),
    "failed": frozenset({"issued", "running", "void"}),
    "void": frozenset(),
}
STATES = tuple(TRANSITIONS)
FAULTS = ("settings", "machine", "unknown")
"""Where a failure lies; only one of the settings is final."""

METADATA = sa.MetaData()

# key -> value: "campaign", "created_at", "created_version".
META = sa.Table(
    "meta", METADATA, sa.Column("key", sa.String(64), primary_key=True), sa.Column("value", sa.Text, nullable=False)
)

_TYPES: dict[type, sa.types.TypeEngine[Any]] = {
    str: sa.Text(),
    int: sa.BigInteger(),
    float: sa.Double(),
    dict: sa.JSON(none_as_null=True),
}


def _table(
    name: str, record: type, *constraints: sa.CheckConstraint | sa.UniqueConstraint, number: str = ""
) -> sa.Table:
    """A column for each field of a record, after its number, which may be one of the fields."""
    columns: list[sa.Column[Any]] = [sa.Column("id", sa.Integer, primary_key=True, autoincrement=name != "runs")]
    for field, kinds in typed(record):
        if field not in (number, "scores"):
            of_run = (sa.ForeignKey("runs.id"),) if field in ("run_id", "replaces") else ()
            nullable, index = NoneType in kinds, field == "state"
            columns.append(sa.Column(field, _TYPES[kinds[0]], *of_run, nullable=nullable, index=index))
    return sa.Table(name, METADATA, *columns, *constraints)


RUNS = _table("runs", RunRecord, sa.CheckConstraint("id >= 1"), number="run_id")
SCORES = _table("scores", ScoreRecord, sa.UniqueConstraint("run_id", "application"))
# One row for each image in a ranking; ``ranking`` counts rankings from 1, ``reason`` tells why one does not count.
RANKINGS = _table("rankings", RankingRecord, sa.UniqueConstraint("ranking", "run_id"))
LOOKS = _table("looks", LookRecord, number="look")
EVENTS = _table("events", EventRecord, number="event")
FILES = _table("files", FileRecord, sa.UniqueConstraint("sha256"))

VERSION = "0003"
"""Of the tables above: to be raised with any change of them."""
