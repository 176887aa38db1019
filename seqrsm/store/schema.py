"""Tables of the campaign's data base, the same for SQLite and PostgreSQL.

Times are UTC in ISO 8601, as text: they sort, and both data bases keep every digit.
"""

from __future__ import annotations

import sqlalchemy as sa

#: States of a run, and the states that each may pass into.
TRANSITIONS: dict[str, frozenset[str]] = {
    "proposed": frozenset({"issued", "running", "scored", "void"}),
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

RUNS = sa.Table(
    "runs",
    METADATA,
    sa.Column("id", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("batch", sa.Integer, nullable=False),
    sa.Column("purpose", sa.String(64), nullable=False),
    sa.Column("why", sa.Text, nullable=False),
    sa.Column("source", sa.String(16), nullable=False),
    sa.Column("state", sa.String(16), nullable=False, index=True),
    sa.Column("proposed", sa.JSON, nullable=False),
    sa.Column("executed", sa.JSON(none_as_null=True)),
    sa.Column("block", sa.Text, nullable=False),
    sa.Column("cost", sa.Double, nullable=False),
    sa.Column("reason", sa.Text, nullable=False),
    sa.Column("attempts", sa.Integer, nullable=False),
    sa.Column("owner", sa.Text, nullable=False),
    sa.Column("replaces", sa.Integer, sa.ForeignKey("runs.id")),
    sa.Column("proposed_at", sa.String(32), nullable=False),
    sa.Column("issued_at", sa.String(32)),
    sa.Column("started_at", sa.String(32)),
    sa.Column("ended_at", sa.String(32)),
    sa.Column("seen_at", sa.String(32)),
    sa.Column("fault", sa.String(16), nullable=False, server_default=""),
    sa.CheckConstraint("id >= 1"),
)

SCORES = sa.Table(
    "scores",
    METADATA,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("run_id", sa.Integer, sa.ForeignKey("runs.id"), nullable=False),
    sa.Column("application", sa.String(128), nullable=False),
    sa.Column("score", sa.Double, nullable=False),
    sa.Column("se", sa.Double),
    sa.Column("n", sa.Integer),
    sa.Column("correct", sa.Integer),
    sa.Column("metadata", sa.JSON, nullable=False),
    sa.Column("source_file", sa.Text, nullable=False),
    sa.Column("source_row", sa.Integer),
    sa.Column("scored_at", sa.String(32), nullable=False),
    sa.UniqueConstraint("run_id", "application"),
)

# One row for each image in a ranking; ``ranking`` counts rankings from 1, ``reason`` tells why one does not count.
RANKINGS = sa.Table(
    "rankings",
    METADATA,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("ranking", sa.Integer, nullable=False),
    sa.Column("run_id", sa.Integer, sa.ForeignKey("runs.id"), nullable=False),
    sa.Column("application", sa.String(128), nullable=False),
    sa.Column("interpreter", sa.Text, nullable=False),
    sa.Column("session", sa.Text, nullable=False),
    sa.Column("rank", sa.Double, nullable=False),
    sa.Column("metadata", sa.JSON, nullable=False),
    sa.Column("source_file", sa.Text, nullable=False),
    sa.Column("source_row", sa.Integer),
    sa.Column("reason", sa.Text, nullable=False),
    sa.Column("ranked_at", sa.String(32), nullable=False),
    sa.UniqueConstraint("ranking", "run_id"),
)

LOOKS = sa.Table(
    "looks",
    METADATA,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("after_run", sa.Integer, nullable=False),
    sa.Column("application", sa.String(128), nullable=False),
    sa.Column("summary", sa.JSON, nullable=False),
    sa.Column("looked_at", sa.String(32), nullable=False),
)

EVENTS = sa.Table(
    "events",
    METADATA,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("at", sa.String(32), nullable=False),
    sa.Column("version", sa.String(32), nullable=False),
    sa.Column("seed", sa.BigInteger),
    sa.Column("run_id", sa.Integer, sa.ForeignKey("runs.id")),
    sa.Column("kind", sa.String(64), nullable=False),
    sa.Column("detail", sa.JSON, nullable=False),
    sa.Column("hash", sa.String(64), nullable=False, server_default=""),
)

FILES = sa.Table(
    "files",
    METADATA,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("name", sa.Text, nullable=False),
    sa.Column("sha256", sa.String(64), nullable=False, unique=True),
    sa.Column("row_count", sa.Integer, nullable=False),
    sa.Column("ingested_at", sa.String(32), nullable=False),
)

VERSION = "0003"
"""Of the tables above: to be raised with any change of them."""
