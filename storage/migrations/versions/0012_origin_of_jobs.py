"""The request that asked for a job, and the span of its trace, so that what a worker logs and traces leads back to it."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("job", sa.Column("request_id", sa.String(length=64), nullable=True))
    op.add_column("job", sa.Column("traceparent", sa.String(length=64), nullable=True))
