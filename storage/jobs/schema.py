"""The job engine's own tables, in the same database as ours."""

from __future__ import annotations

from dbos import DBOS
from sqlalchemy import Engine

from storage.jobs import private_calls


def upgrade(url: str) -> None:
    """Create or update the job engine's tables."""
    DBOS.migrate(url)


def is_current(engine: Engine) -> bool:
    """Return whether the job engine's tables are as this version of it needs them."""
    return private_calls.tables_are_current(engine)
