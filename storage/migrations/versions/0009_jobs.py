"""Priorities, deadlines, pauses, parts and states of jobs; what the operator's counters read."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("job", sa.Column("ticket", sa.String(length=64), nullable=True))
    op.add_column("job", sa.Column("round", sa.Integer(), server_default="0", nullable=False))
    op.add_column("job", sa.Column("priority", sa.Integer(), server_default="2", nullable=False))
    op.add_column("job", sa.Column("paused", sa.Boolean(), server_default=sa.false(), nullable=False))
    op.add_column("job", sa.Column("time_limit", sa.Double(), nullable=True))
    op.add_column("job", sa.Column("deadline", sa.DateTime(timezone=True), nullable=True))
    # Without a foreign key, for which SQLite would copy the table: the parts of a job are deleted with it.
    op.add_column("job", sa.Column("parent_id", sa.String(length=40), nullable=True))
    op.add_column("job", sa.Column("part", sa.Integer(), nullable=True))
    op.create_index(op.f("ix_job_parent_id_part"), "job", ["parent_id", "part"], unique=False)
    # Workers find that these tickets are none of the present queue, and give the jobs new ones.
    op.execute("UPDATE job SET ticket = id WHERE status IN ('queued', 'running')")
    op.add_column("worker", sa.Column("warm_up", sa.Double(), nullable=True))
    op.create_table(
        "job_state",
        sa.Column("job_id", sa.String(length=40), nullable=False),
        sa.Column("attempt", sa.Integer(), nullable=False),
        sa.Column("state", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(["job_id"], ["job.id"], name=op.f("fk_job_state_job_id_job"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("job_id", name=op.f("pk_job_state")),
    )
    op.create_table(
        "job_tally",
        sa.Column("kind", sa.String(length=64), nullable=False),
        sa.Column("status", sa.String(length=64), nullable=False),
        sa.Column("count", sa.BigInteger(), nullable=False),
        sa.Column("seconds", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("kind", "status", name=op.f("pk_job_tally")),
    )
