"""Alembic's entry point: migrates over the connection, and within the transaction, that the caller handed in."""

from __future__ import annotations

from alembic import context

from seqrsm.store.schema import METADATA

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=METADATA,
    # SQLite cannot alter a table: batch mode copies it.
    render_as_batch=True,
)
with context.begin_transaction():
    context.run_migrations()
