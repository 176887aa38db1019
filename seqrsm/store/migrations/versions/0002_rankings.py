"""Interpreters' rankings as they were handed in, and when the process that holds a run was last heard of."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("runs", sa.Column("seen_at", sa.String(32)))
    op.create_table(
        "rankings",
        sa.Column("id", sa.Integer, nullable=False),
        sa.Column("ranking", sa.Integer, nullable=False),
        sa.Column("run_id", sa.Integer, nullable=False),
        sa.Column("application", sa.String(128), nullable=False),
        sa.Column("interpreter", sa.Text, nullable=False),
        sa.Column("session", sa.Text, nullable=False),
        sa.Column("rank", sa.Double, nullable=False),
        sa.Column("metadata", sa.JSON, nullable=False),
        sa.Column("source_file", sa.Text, nullable=False),
        sa.Column("source_row", sa.Integer),
        sa.Column("reason", sa.Text, nullable=False),
        sa.Column("ranked_at", sa.String(32), nullable=False),
        sa.ForeignKeyConstraint(["run_id"], ["runs.id"], name="fk_rankings_run_id"),
        sa.PrimaryKeyConstraint("id", name="pk_rankings"),
        sa.UniqueConstraint("ranking", "run_id", name="uq_rankings_ranking"),
    )
