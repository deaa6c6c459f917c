"""Alembic's entry: runs migrations on the connection that it is handed (or on ``SERVOTUNE_DATABASE_URL``)."""

from __future__ import annotations

import os
from typing import Literal

from alembic import context
from sqlalchemy import Connection, create_engine

from storage.migrations.filter import is_ours
from storage.models import Base
from storage.models.base import PlainText, Token, UtcDateTime


def _render(kind: str, item: object, _context: object) -> str | Literal[False]:
    """Write plain SQLAlchemy types into migrations, so that these do not change when our own types do."""
    if kind != "type" or not isinstance(item, UtcDateTime | PlainText | Token):
        return False
    return f"sa.{item.impl!r}"


def _run(connection: Connection) -> None:
    context.configure(
        connection=connection,
        target_metadata=Base.metadata,
        include_name=is_ours,
        render_item=_render,
        # SQLite changes tables by copying them.
        render_as_batch=connection.dialect.name == "sqlite",
    )
    with context.begin_transaction():
        context.run_migrations()


_connection: Connection | None = context.config.attributes.get("connection")
if _connection is not None:
    _run(_connection)
else:  # a developer's `alembic -c storage/alembic.ini revision --autogenerate`
    _engine = create_engine(os.environ["SERVOTUNE_DATABASE_URL"])
    with _engine.begin() as _own:
        _run(_own)
    _engine.dispose()
