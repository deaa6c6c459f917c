"""Inserts a row unless its key is there already, atomically, on either database."""

from __future__ import annotations

from typing import Any

from sqlalchemy import CursorResult
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from storage.models.base import Base


def insert_if_absent(session: Session, model: type[Base], **values: Any) -> bool:
    """Insert a row and return True, or return False when a row with the same key exists.

    A concurrent transaction that inserts the same key is waited for (so the answer is final).
    """
    dialect = sqlite if session.get_bind().dialect.name == "sqlite" else postgresql
    result = session.execute(dialect.insert(model).values(**values).on_conflict_do_nothing())
    assert isinstance(result, CursorResult)
    return result.rowcount == 1
