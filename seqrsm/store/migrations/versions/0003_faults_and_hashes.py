"""Where a failure lies, and a hash of each event and those before it; older failures and events have none."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("runs", sa.Column("fault", sa.String(16), nullable=False, server_default=""))
    op.add_column("events", sa.Column("hash", sa.String(64), nullable=False, server_default=""))
