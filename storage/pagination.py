"""Pages of a list, newest or oldest first, that stay what they are while rows are inserted.

Keyset pagination: the next page holds the rows beyond ``(created_at, id)`` of the last one seen
(https://use-the-index-luke.com/no-offset).
"""

from __future__ import annotations

import base64
import binascii
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Generic, TypeVar

from sqlalchemy import Select, func, literal, or_, tuple_
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Narrowing:
    """Which rows of a list are wanted: those that meet all of it.

    ``name`` is a part of the name, in capital or small letters, or the whole id; ``after`` and ``before`` are instants: a row was
    made at the first or later, and earlier than the second.
    """

    name: str | None = None
    after: datetime | None = None
    before: datetime | None = None

    def of(self, rows: Select[Any], model: type[Any]) -> Select[Any]:
        """Return what is wanted of ``rows``, a selection of ``model``."""
        listed: Any = model
        if self.name is not None:
            # Both by the same hand: what a capital letter is, databases do not agree on.
            escaped = re.sub(r"([%_/])", r"/\1", self.name)
            pattern = literal(f"%{escaped}%", listed.name.type)
            called = func.lower(listed.name).like(func.lower(pattern), escape="/")
            rows = rows.where(or_(called, listed.id == self.name))
        if self.after is not None:
            rows = rows.where(listed.created_at >= self.after)
        if self.before is not None:
            rows = rows.where(listed.created_at < self.before)
        return rows


#: All rows of a list.
EVERY = Narrowing()


def paginate(
    session: Session,
    rows: Select[Any],
    model: type[Any],
    *,
    cursor: str | None,
    limit: int,
    identifier: str = "id",
    oldest_first: bool = False,
) -> Page[Any]:
    """Return one page of ``rows``, a selection of ``model``, in the order of ``created_at``.

    Parameters
    ----------
    identifier : str
        The attribute that tells rows of the same time apart.

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
    order = (listed.created_at, getattr(listed, identifier))
    if cursor is not None:
        last = tuple_(*(literal(value, column.type) for value, column in zip(_decode(cursor), order, strict=True)))
        rows = rows.where(tuple_(*order) > last if oldest_first else tuple_(*order) < last)
    directed = order if oldest_first else tuple(column.desc() for column in order)
    found = session.scalars(rows.order_by(*directed).limit(limit + 1)).all()
    items = found[:limit]
    last_seen = _encode(items[-1], identifier) if len(found) > limit else None
    return Page(items=items, next_cursor=last_seen)


def _encode(row: Any, identifier: str) -> str:
    text = json.dumps([row.created_at.isoformat(), getattr(row, identifier)])
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
