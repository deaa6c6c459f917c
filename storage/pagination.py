"""Pages of a list, newest first, that stay what they are while rows are inserted.

Keyset pagination: the next page holds the rows before ``(created_at, id)`` of the last one seen
(https://use-the-index-luke.com/no-offset).
"""

from __future__ import annotations

import base64
import binascii
import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Generic, TypeVar

from sqlalchemy import Select, and_, or_
from sqlalchemy.orm import Session

from storage.errors import InvalidCursorError

#: The most rows on one page.
MAX_LIMIT = 1000


Row = TypeVar("Row")


@dataclass(frozen=True, slots=True, kw_only=True)
class Page(Generic[Row]):
    """Some rows and, unless they are the last ones, the cursor of the next page."""

    items: Sequence[Row]
    next_cursor: str | None


def paginate(session: Session, rows: Select[Any], model: type[Any], *, cursor: str | None, limit: int) -> Page[Any]:
    """Return one page of ``rows``, a selection of ``model`` (which has ``id`` and ``created_at``), newest first.

    Raises
    ------
    InvalidCursorError
        When ``cursor`` is not one that this function made.
    ValueError
        When ``limit`` is not in 1 ... `MAX_LIMIT`.
    """
    if not 1 <= limit <= MAX_LIMIT:
        raise ValueError(f"limit must be from 1 to {MAX_LIMIT}, got {limit}")
    listed: Any = model
    if cursor is not None:
        created_at, identifier = _decode(cursor)
        same_time = and_(listed.created_at == created_at, listed.id < identifier)
        rows = rows.where(or_(listed.created_at < created_at, same_time))
    found = session.scalars(rows.order_by(listed.created_at.desc(), listed.id.desc()).limit(limit + 1)).all()
    items = found[:limit]
    return Page(items=items, next_cursor=_encode(items[-1]) if len(found) > limit else None)


def _encode(row: Any) -> str:
    text = json.dumps([row.created_at.isoformat(), row.id])
    return base64.urlsafe_b64encode(text.encode()).decode().rstrip("=")


def _decode(cursor: str) -> tuple[datetime, str]:
    try:
        padded = cursor + "=" * (-len(cursor) % 4)
        created_at, identifier = json.loads(base64.b64decode(padded, altchars=b"-_", validate=True))
        time = datetime.fromisoformat(created_at)
    except (ValueError, TypeError, binascii.Error) as error:
        raise InvalidCursorError(cursor) from error
    if time.tzinfo is None or not isinstance(identifier, str):
        raise InvalidCursorError(cursor)
    return time.astimezone(UTC), identifier
