"""Tables as a later version of the software leaves them, which keeps to the rule for migrations: it has added to them."""

from __future__ import annotations

import sqlalchemy as sa
from alembic.migration import MigrationContext
from alembic.operations import Operations
from sqlalchemy import text

from storage import Database


def expand(database: Database) -> None:
    """Add columns, a table and a later revision, and drop an index."""
    with database.engine.begin() as connection:
        op = Operations(MigrationContext.configure(connection))
        for table in ("job", "worker", "dataset", "job_event"):
            op.add_column(table, sa.Column("of_later", sa.Text(), nullable=True))
            op.add_column(table, sa.Column("counted_later", sa.Integer(), nullable=False, server_default="0"))
        op.create_table("of_later", sa.Column("id", sa.Text(), primary_key=True))
        op.drop_index("ix_job_finished_at", "job")
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
