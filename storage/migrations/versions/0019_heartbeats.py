"""No index over heartbeats: Postgres wrote each of them into every index of the table; nothing that an earlier version reads changes."""

from __future__ import annotations

from alembic import op

revision = "0019"
down_revision = "0018"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.drop_index("ix_worker_seen_at", "worker")
