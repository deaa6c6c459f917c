"""Chunks of blobs may lie in an object store."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0018"
down_revision = "0017"
branch_labels = None
depends_on = None

_THERE = sa.text("object IS NOT NULL")


def upgrade() -> None:
    op.add_column("blob_chunk", sa.Column("object", sa.String(length=100), nullable=True))
    op.create_index(
        op.f("ix_blob_chunk_object"), "blob_chunk", ["object"], postgresql_where=_THERE, sqlite_where=_THERE
    )
