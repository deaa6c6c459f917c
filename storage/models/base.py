"""The declarative base: names of constraints, time in UTC, JSON documents."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any, ClassVar

from sqlalchemy import JSON, DateTime, Dialect, Index, MetaData, String, Text, text
from sqlalchemy.orm import DeclarativeBase
from sqlalchemy.types import TypeDecorator, TypeEngine

from storage.clock import utc_now as utc_now  # noqa: PLC0414 - every topic has it from here, beside its columns
from storage.errors import DocumentError

#: Every constraint has a name, so that a migration can drop it on either database.
NAMING_CONVENTION = {
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "ck": "ck_%(table_name)s_%(constraint_name)s",
    "fk": "fk_%(table_name)s_%(column_0_N_name)s_%(referred_table_name)s",
    "pk": "pk_%(table_name)s",
}

#: Documents are any JSON value; ``Any`` because their shape belongs to who wrote them.
Document = dict[str, Any]


#: The largest number in an integer column; a larger one of a caller's is the same to every comparison.
MAX_INTEGER = 2**31 - 1


class UtcDateTime(TypeDecorator[datetime]):
    """An aware datetime in UTC on every database (SQLite itself keeps no time zone)."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def load_dialect_impl(self, dialect: Dialect) -> TypeEngine[Any]:
        """Let Postgres keep the zone; SQLite gets naive UTC, whose text sorts by time."""
        return dialect.type_descriptor(DateTime(timezone=dialect.name != "sqlite"))

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Refuse a naive time and turn an aware one into UTC."""
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError(f"datetime must be aware of its time zone, got {value!r}")
        value = value.astimezone(UTC)
        return value.replace(tzinfo=None) if dialect.name == "sqlite" else value

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:  # noqa: ARG002 - SQLAlchemy's signature
        """Return an aware time in UTC."""
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)


class PlainText(TypeDecorator[str]):
    """Text as both databases can keep it: Postgres knows no NUL, and UTF-8 no lone surrogate."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:  # noqa: ARG002 - SQLAlchemy's signature
        """Refuse what could be written into one of the two databases only."""
        if value is not None and value != _clean(value):
            raise DocumentError(f"text must be Unicode without NUL, got {value!r}")
        return value


class Token(TypeDecorator[str]):
    """A short word that the software chose itself; a caller's guess with NUL in it matches nothing."""

    impl = String
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:  # noqa: ARG002 - SQLAlchemy's signature
        """Put question marks in place of characters that no token has."""
        return value if value is None else _clean(value)


def _clean(text: str) -> str:
    return text.replace("\0", "?").encode(errors="replace").decode()


Id = Token(40)
Sha256 = Token(64)
Word = Token(64)
ObjectName = Token(100)


def partial_index(*columns: str, where: str) -> Index:
    """Return an index of some rows of a table, used by questions that say so in these words."""
    return Index(None, *columns, postgresql_where=text(where), sqlite_where=text(where))


class Base(DeclarativeBase):
    """The base of all tables. JSON is text on both databases: it keeps the order of keys, JSONB would not."""

    metadata = MetaData(naming_convention=NAMING_CONVENTION)
    type_annotation_map: ClassVar[dict[Any, TypeEngine[Any]]] = {
        datetime: UtcDateTime(),
        dict[str, Any]: JSON(none_as_null=True),
        list[Any]: JSON(none_as_null=True),
        str: PlainText(),
    }
