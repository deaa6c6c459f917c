"""Measurements on rigs: agents, rigs, templates, acquisitions with their attempts and what follows them."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "acquisition_template",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("workspace_id", sa.String(length=40), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("document", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("revision", sa.Integer(), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(
            ["workspace_id"], ["workspace.id"], name=op.f("fk_acquisition_template_workspace_id_workspace")
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_acquisition_template")),
    )
    op.create_index(
        op.f("ix_acquisition_template_workspace_id_created_at_id"),
        "acquisition_template",
        ["workspace_id", "created_at", "id"],
        unique=False,
    )
    op.create_table(
        "rig",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("workspace_id", sa.String(length=40), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("document", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("agent_id", sa.String(length=40), nullable=True),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(["workspace_id"], ["workspace.id"], name=op.f("fk_rig_workspace_id_workspace")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_rig")),
        sa.UniqueConstraint("workspace_id", "name", name=op.f("uq_rig_workspace_id_name")),
    )
    op.create_index(
        op.f("ix_rig_workspace_id_created_at_id"), "rig", ["workspace_id", "created_at", "id"], unique=False
    )
    op.create_table(
        "acquisition",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("workspace_id", sa.String(length=40), nullable=False),
        sa.Column("rig_id", sa.String(length=40), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("document", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("attempt", sa.Integer(), nullable=False),
        sa.Column("status", sa.String(length=64), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.CheckConstraint(
            "status IN ('queued', 'claimed', 'running', 'uploading', 'done', 'failed', 'lost', 'cancelled')",
            name=op.f("ck_acquisition_status"),
        ),
        sa.ForeignKeyConstraint(["rig_id"], ["rig.id"], name=op.f("fk_acquisition_rig_id_rig")),
        sa.ForeignKeyConstraint(["workspace_id"], ["workspace.id"], name=op.f("fk_acquisition_workspace_id_workspace")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_acquisition")),
    )
    op.create_index(op.f("ix_acquisition_rig_id"), "acquisition", ["rig_id"], unique=False)
    op.create_index(
        op.f("ix_acquisition_workspace_id_created_at_id"),
        "acquisition",
        ["workspace_id", "created_at", "id"],
        unique=False,
    )
    op.create_table(
        "agent",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("workspace_id", sa.String(length=40), nullable=False),
        sa.Column("rig_id", sa.String(length=40), nullable=False),
        sa.Column("instance", sa.String(length=64), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("version", sa.Text(), nullable=False),
        sa.Column("seen_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(["rig_id"], ["rig.id"], name=op.f("fk_agent_rig_id_rig")),
        sa.ForeignKeyConstraint(["workspace_id"], ["workspace.id"], name=op.f("fk_agent_workspace_id_workspace")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_agent")),
        sa.UniqueConstraint("rig_id", "instance", name=op.f("uq_agent_rig_id_instance")),
    )
    op.create_index(op.f("ix_agent_rig_id"), "agent", ["rig_id"], unique=False)
    op.create_index(
        op.f("ix_agent_workspace_id_created_at_id"), "agent", ["workspace_id", "created_at", "id"], unique=False
    )
    op.create_table(
        "acquisition_attempt",
        sa.Column("acquisition_id", sa.String(length=40), nullable=False),
        sa.Column("number", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("status", sa.String(length=64), nullable=False),
        sa.Column("job_id", sa.String(length=40), nullable=False),
        sa.Column("agent_id", sa.String(length=40), nullable=True),
        sa.Column("lease_until", sa.DateTime(timezone=True), nullable=True),
        sa.Column("dataset_id", sa.String(length=40), nullable=True),
        sa.Column("facts", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("error", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("late", sa.Boolean(), nullable=False),
        sa.Column("claimed_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("ended_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.CheckConstraint(
            "status IN ('queued', 'claimed', 'running', 'uploading', 'done', 'failed', 'lost', 'cancelled')",
            name=op.f("ck_acquisition_attempt_status"),
        ),
        sa.ForeignKeyConstraint(
            ["acquisition_id"],
            ["acquisition.id"],
            name=op.f("fk_acquisition_attempt_acquisition_id_acquisition"),
            ondelete="CASCADE",
        ),
        sa.ForeignKeyConstraint(["agent_id"], ["agent.id"], name=op.f("fk_acquisition_attempt_agent_id_agent")),
        sa.ForeignKeyConstraint(
            ["dataset_id"], ["dataset.id"], name=op.f("fk_acquisition_attempt_dataset_id_dataset"), ondelete="SET NULL"
        ),
        sa.ForeignKeyConstraint(["job_id"], ["job.id"], name=op.f("fk_acquisition_attempt_job_id_job")),
        sa.PrimaryKeyConstraint("acquisition_id", "number", name=op.f("pk_acquisition_attempt")),
    )
    op.create_index(op.f("ix_acquisition_attempt_agent_id"), "acquisition_attempt", ["agent_id"], unique=False)
    op.create_index(op.f("ix_acquisition_attempt_dataset_id"), "acquisition_attempt", ["dataset_id"], unique=False)
    op.create_index(op.f("ix_acquisition_attempt_job_id"), "acquisition_attempt", ["job_id"], unique=False)
    op.create_index(op.f("ix_acquisition_attempt_status"), "acquisition_attempt", ["status"], unique=False)
    op.create_table(
        "follow_up",
        sa.Column("acquisition_id", sa.String(length=40), nullable=False),
        sa.Column("attempt", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("number", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("kind", sa.String(length=64), nullable=False),
        sa.Column("body", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("status", sa.String(length=64), nullable=False),
        sa.Column("job_id", sa.String(length=40), nullable=True),
        sa.Column("result", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("detail", sa.Text(), nullable=True),
        sa.CheckConstraint(
            "status IN ('waiting', 'running', 'done', 'failed', 'skipped')", name=op.f("ck_follow_up_status")
        ),
        sa.ForeignKeyConstraint(
            ["acquisition_id", "attempt"],
            ["acquisition_attempt.acquisition_id", "acquisition_attempt.number"],
            name=op.f("fk_follow_up_acquisition_id_attempt_acquisition_attempt"),
            ondelete="CASCADE",
        ),
        sa.ForeignKeyConstraint(["job_id"], ["job.id"], name=op.f("fk_follow_up_job_id_job"), ondelete="SET NULL"),
        sa.PrimaryKeyConstraint("acquisition_id", "attempt", "number", name=op.f("pk_follow_up")),
    )
    op.create_index(op.f("ix_follow_up_job_id"), "follow_up", ["job_id"], unique=False)
    op.create_index(op.f("ix_follow_up_status"), "follow_up", ["status"], unique=False)
