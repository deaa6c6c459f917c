"""Indices for lists, counts and sweeps over a million jobs and recordings; nothing that an earlier version reads changes."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0015"
down_revision = "0014"
branch_labels = None
depends_on = None

_INDICES: dict[str, tuple[tuple[str, ...], ...]] = {
    "job": (
        ("workspace_id", "status", "created_at", "id"),
        ("workspace_id", "kind", "created_at", "id"),
        ("workspace_id", "kind", "status", "created_at", "id"),
        ("finished_at",),
    ),
    "dataset": (("workspace_id", "name", "status", "created_at", "id"),),
    "result": (("workspace_id", "kind", "created_at", "id"),),
}
#: Most jobs are no schedule's, and no parts: SQLite took the index of parts to find whatever is none, which is the whole table.
_OF_FEW: tuple[tuple[str, ...], ...] = (
    ("schedule_id", "created_at", "id"),
    ("schedule_id", "status", "created_at", "id"),
    ("parent_id", "part"),
)


def upgrade() -> None:
    for table, indices in _INDICES.items():
        for columns in indices:
            op.create_index(_name(table, columns), table, list(columns))
    op.drop_index("ix_job_schedule_id", "job")
    op.drop_index("ix_job_parent_id_part", "job")
    for columns in _OF_FEW:
        _create_partial("job", columns, f"{columns[0]} IS NOT NULL")
    _create_partial("job_event", ("at",), "type <> 'status'")


def _create_partial(table: str, columns: tuple[str, ...], where: str) -> None:
    condition = sa.text(where)
    op.create_index(
        _name(table, columns), table, list(columns), postgresql_where=condition, sqlite_where=condition
    )  # fmt: skip


def _name(table: str, columns: tuple[str, ...]) -> str:
    return f"ix_{table}_{'_'.join(columns)}"
