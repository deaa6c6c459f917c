"""What was made from what; of what is there already, as far as its requests tell."""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None

_SOURCE = re.compile(r"(?:ds|job|res|acq)_[0-9a-z]{26}")
_MODEL = re.compile(r"sys_[0-9a-z]{26}")
_BATCH = 1000


def upgrade() -> None:
    edges = op.create_table(
        "lineage_edge",
        sa.Column("workspace_id", sa.String(length=40), nullable=False),
        sa.Column("target", sa.String(length=64), nullable=False),
        sa.Column("source", sa.String(length=64), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(
            ["workspace_id"], ["workspace.id"], name=op.f("fk_lineage_edge_workspace_id_workspace")
        ),
        sa.PrimaryKeyConstraint("workspace_id", "target", "source", name=op.f("pk_lineage_edge")),
    )
    op.create_index(op.f("ix_lineage_edge_workspace_id_source"), "lineage_edge", ["workspace_id", "source"])
    found = [
        {"workspace_id": workspace, "target": target, "source": source, "created_at": datetime.now(UTC)}
        for workspace, target, source in dict.fromkeys(_known(op.get_bind()))
        if source != target
    ]
    for start in range(0, len(found), _BATCH):
        op.bulk_insert(edges, found[start : start + _BATCH])


def _known(connection: sa.Connection) -> Iterator[tuple[str, str, str]]:
    """Give (workspace, target, source) of the revisions, jobs and kept studies that are there."""
    document = sa.JSON(none_as_null=True)
    system = sa.table("system", sa.column("id"), sa.column("workspace_id"), sa.column("revision"))
    job = sa.table(
        "job", sa.column("id"), sa.column("workspace_id"), sa.column("body", document), sa.column("result_id")
    )
    result = sa.table(
        "result",
        sa.column("id"), sa.column("workspace_id"), sa.column("request", document),
        sa.column("system_id"), sa.column("system_revision"),
    )  # fmt: skip
    for row in connection.execute(sa.select(system)):
        for number in range(2, row.revision + 1):
            yield row.workspace_id, f"{row.id}@{number}", f"{row.id}@{number - 1}"
    for row in connection.execute(sa.select(job)):
        for source in _sources(row.body if "request" in row.body else None):
            yield row.workspace_id, row.id, source
    # the result of a job is one node with it
    of_jobs = sa.select(job.c.result_id).where(job.c.result_id.is_not(None))
    for row in connection.execute(sa.select(result).where(result.c.id.not_in(of_jobs))):
        for source in _sources(row.request):
            yield row.workspace_id, row.id, source
        if row.system_id is not None:
            yield row.workspace_id, row.id, f"{row.system_id}@{row.system_revision}"


def _sources(given: Any) -> Iterator[str]:
    pending = [given]
    while pending:
        match pending.pop():
            case {"id": str(system), "revision": int(number)} if _MODEL.fullmatch(system):
                yield f"{system}@{number}"
            case dict() as members:
                pending += members.values()
            case list() as items:
                pending += items
            case str(text) if _SOURCE.fullmatch(text):
                yield text
