"""Tells our tables from those of the job engine, which live in the same database."""

from __future__ import annotations

from typing import Any

from storage.models import Base


def is_ours(name: str | None, kind: str, _parents: Any) -> bool:
    """Return whether Alembic should look at a thing of this name."""
    return kind != "table" or name in Base.metadata.tables
