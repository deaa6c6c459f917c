"""Limits of workspaces, keys that expire, sign-ins, tickets, the audit log."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

#: What a workspace stores already: segments, documents, and the bodies and arrays of results.
STORED = """
UPDATE workspace SET stored_bytes =
    COALESCE((SELECT SUM(s.size) FROM dataset_segment s JOIN dataset d ON d.id = s.dataset_id
              WHERE d.workspace_id = workspace.id), 0)
  + COALESCE((SELECT SUM(LENGTH(CAST(r.document AS TEXT))) FROM system_revision r JOIN system y ON y.id = r.system_id
              WHERE y.workspace_id = workspace.id), 0)
  + COALESCE((SELECT SUM(LENGTH(CAST(t.body AS TEXT))) FROM result t WHERE t.workspace_id = workspace.id), 0)
  + COALESCE((SELECT SUM(b.size) FROM blob b JOIN result_array a ON a.sha256 = b.sha256
              JOIN result t ON t.id = a.result_id WHERE t.workspace_id = workspace.id), 0)
"""


def upgrade() -> None:
    op.add_column("api_key", sa.Column("expires_at", sa.DateTime(timezone=True), nullable=True))
    op.add_column("workspace", sa.Column("revision", sa.Integer(), server_default="1", nullable=False))
    op.add_column("workspace", sa.Column("limits", sa.JSON(none_as_null=True), nullable=True))
    op.add_column("workspace", sa.Column("stored_bytes", sa.BigInteger(), server_default="0", nullable=False))
    op.execute(STORED)

    op.create_table(
        "sign_in",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("workspace_id", sa.String(length=40), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("key_id", sa.String(length=40), nullable=True),
        sa.Column("scopes", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("expires_at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(["key_id"], ["api_key.id"], name=op.f("fk_sign_in_key_id_api_key")),
        sa.ForeignKeyConstraint(["workspace_id"], ["workspace.id"], name=op.f("fk_sign_in_workspace_id_workspace")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_sign_in")),
        sa.UniqueConstraint("sha256", name=op.f("uq_sign_in_sha256")),
    )
    op.create_index(op.f("ix_sign_in_expires_at"), "sign_in", ["expires_at"], unique=False)
    op.create_index(op.f("ix_sign_in_key_id"), "sign_in", ["key_id"], unique=False)
    op.create_index(op.f("ix_sign_in_workspace_id"), "sign_in", ["workspace_id"], unique=False)

    op.create_table(
        "ticket",
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("workspace_id", sa.String(length=40), nullable=False),
        sa.Column("principal", sa.String(length=40), nullable=False),
        sa.Column("scopes", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("expires_at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(["workspace_id"], ["workspace.id"], name=op.f("fk_ticket_workspace_id_workspace")),
        sa.PrimaryKeyConstraint("sha256", name=op.f("pk_ticket")),
    )
    op.create_index(op.f("ix_ticket_expires_at"), "ticket", ["expires_at"], unique=False)
    op.create_index(op.f("ix_ticket_workspace_id"), "ticket", ["workspace_id"], unique=False)

    op.create_table(
        "audit_entry",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("workspace_id", sa.String(length=40), nullable=False),
        sa.Column("principal", sa.String(length=40), nullable=False),
        sa.Column("request_id", sa.String(length=64), nullable=True),
        sa.Column("action", sa.String(length=64), nullable=False),
        sa.Column("target", sa.String(length=64), nullable=False),
        sa.Column("detail", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(["workspace_id"], ["workspace.id"], name=op.f("fk_audit_entry_workspace_id_workspace")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_audit_entry")),
    )
    op.create_index(op.f("ix_audit_entry_created_at"), "audit_entry", ["created_at"], unique=False)
    op.create_index(
        op.f("ix_audit_entry_workspace_id_created_at_id"),
        "audit_entry",
        ["workspace_id", "created_at", "id"],
        unique=False,
    )
