"""Inserts a row unless its key is there already, atomically, on either database."""

from __future__ import annotations

from typing import Any

from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from storage.models.base import Base


def insert_if_absent(session: Session, model: type[Base], **values: Any) -> bool:
    """Insert a row and return True, or return False when a row with the same key exists.

    A concurrent transaction that inserts the same key is waited for (so the answer is final).
    """
    dialect = sqlite if session.get_bind().dialect.name == "sqlite" else postgresql
    table = model.__table__
    inserted = dialect.insert(table).values(**values).on_conflict_do_nothing().returning(*table.primary_key)
    return session.execute(inserted).one_or_none() is not None
