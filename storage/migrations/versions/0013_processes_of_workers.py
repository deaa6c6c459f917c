"""The process of a worker, so that those on its machine see at once that it has ended."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("worker", sa.Column("process", sa.Text(), nullable=True))
