"""Schedules, their runs, and which schedule a job belongs to."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    # Without a foreign key: a job remembers its schedule longer than that exists, and SQLite would copy the table for one.
    op.add_column("job", sa.Column("schedule_id", sa.String(length=40), nullable=True))
    op.create_index(op.f("ix_job_schedule_id"), "job", ["schedule_id"], unique=False)

    op.create_table(
        "schedule",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("workspace_id", sa.String(length=40), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("cron", sa.Text(), nullable=False),
        sa.Column("time_zone", sa.Text(), nullable=False),
        sa.Column("kind", sa.String(length=64), nullable=False),
        sa.Column("body", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("overlap", sa.String(length=64), nullable=False),
        sa.Column("missed", sa.String(length=64), nullable=False),
        sa.Column("paused", sa.Boolean(), nullable=False),
        sa.Column("revision", sa.Integer(), nullable=False),
        sa.Column("next_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.CheckConstraint("overlap IN ('skip', 'queue', 'cancel_previous')", name=op.f("ck_schedule_overlap")),
        sa.CheckConstraint("missed IN ('none', 'one', 'all')", name=op.f("ck_schedule_missed")),
        sa.ForeignKeyConstraint(["workspace_id"], ["workspace.id"], name=op.f("fk_schedule_workspace_id_workspace")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_schedule")),
    )
    op.create_index(op.f("ix_schedule_next_at"), "schedule", ["next_at"], unique=False)
    op.create_index(
        op.f("ix_schedule_workspace_id_created_at_id"), "schedule", ["workspace_id", "created_at", "id"], unique=False
    )

    op.create_table(
        "schedule_run",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("schedule_id", sa.String(length=40), nullable=False),
        sa.Column("due_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("outcome", sa.String(length=64), nullable=False),
        sa.Column("job_id", sa.String(length=40), nullable=True),
        sa.Column("detail", sa.Text(), nullable=True),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.CheckConstraint(
            "outcome IN ('started', 'waiting', 'skipped', 'missed', 'refused')", name=op.f("ck_schedule_run_outcome")
        ),
        sa.ForeignKeyConstraint(["job_id"], ["job.id"], name=op.f("fk_schedule_run_job_id_job"), ondelete="SET NULL"),
        sa.ForeignKeyConstraint(
            ["schedule_id"], ["schedule.id"], name=op.f("fk_schedule_run_schedule_id_schedule"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_schedule_run")),
    )
    op.create_index(op.f("ix_schedule_run_job_id"), "schedule_run", ["job_id"], unique=False)
    op.create_index(op.f("ix_schedule_run_outcome"), "schedule_run", ["outcome"], unique=False)
    op.create_index(
        op.f("ix_schedule_run_schedule_id_created_at_id"),
        "schedule_run",
        ["schedule_id", "created_at", "id"],
        unique=False,
    )
