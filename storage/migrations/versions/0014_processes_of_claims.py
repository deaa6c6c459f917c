"""The process that holds an idempotency key, so that the key is free as soon as that has ended."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0014"
down_revision = "0013"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("idempotency", sa.Column("process", sa.Text(), nullable=True))
