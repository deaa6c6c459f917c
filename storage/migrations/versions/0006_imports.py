"""Imports: what was noticed in a recording, the job that reads its file, and which import may write."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None


def upgrade() -> None:
    # Without a foreign key: SQLite would copy the table for one, and a dataset may outlive its job.
    op.add_column("dataset", sa.Column("report", sa.JSON(none_as_null=True), nullable=True))
    op.add_column("dataset", sa.Column("job_id", sa.String(length=40), nullable=True))
    op.add_column("dataset", sa.Column("writer", sa.String(length=40), nullable=True))
    op.create_index(op.f("ix_dataset_job_id"), "dataset", ["job_id"], unique=False)
