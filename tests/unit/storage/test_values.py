"""Identifiers, times, cursors and URLs."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta, timezone

import pytest
from sqlalchemy.dialects import postgresql, sqlite

from storage import ids, open_database
from storage.errors import DatabaseUrlError, DocumentError, InvalidCursorError, StorageError
from storage.models import Base, JobStatus
from storage.models.base import UtcDateTime
from storage.pagination import _decode, _encode
from storage.session import _to_json


def test_ids_are_ulids_with_a_prefix():
    assert re.fullmatch(r"sys_[0-9a-hjkmnp-tv-z]{26}", ids.new_id("sys"))
    assert len({ids.new_id("job") for _ in range(1000)}) == 1000


def test_an_id_spells_its_time(monkeypatch):
    # The example of https://github.com/ulid/spec: 01ARYZ6S41... is 1469918176385 ms.
    monkeypatch.setattr(ids.time, "time_ns", lambda: 1469918176385 * 1_000_000 + 999_999)
    monkeypatch.setattr(ids.os, "urandom", bytes)
    assert ids.new_id("x") == "x_01aryz6s410000000000000000"


def test_ids_sort_by_time(monkeypatch):
    made = []
    for milliseconds in (1, 31, 32, 1_000_000, 1_700_000_000_000):
        monkeypatch.setattr(ids.time, "time_ns", lambda now=milliseconds: now * 1_000_000)
        made.append(ids.new_id("x"))
    assert made == sorted(made)


@pytest.mark.parametrize("dialect", [sqlite.dialect(), postgresql.dialect()])
def test_times_come_back_in_utc(dialect):
    column = UtcDateTime()
    moment = datetime(2026, 11, 21, 14, 30, tzinfo=timezone(timedelta(hours=2)))
    kept = column.process_bind_param(moment, dialect)
    assert kept == (datetime(2026, 11, 21, 12, 30) if dialect.name == "sqlite" else moment)  # noqa: DTZ001
    back = column.process_result_value(kept, dialect)
    assert back == moment
    assert back.tzinfo is UTC
    assert column.process_bind_param(None, dialect) is None
    assert column.process_result_value(None, dialect) is None
    with pytest.raises(ValueError, match="time zone"):
        column.process_bind_param(datetime(2026, 11, 21), dialect)  # noqa: DTZ001


def test_a_cursor_is_what_a_row_gave():
    class Row:
        id = "sys_1"
        created_at = datetime(2026, 11, 21, 12, 0, 0, 123456, tzinfo=UTC)

    assert _decode(_encode(Row, "id")) == (Row.created_at, Row.id)
    with pytest.raises(InvalidCursorError, match="next_cursor of this list"):
        _decode(_encode(Row, "id")[:-3])


@pytest.mark.parametrize(
    "url",
    ["", "servotune.db", "sqlite://", "sqlite:///:memory:", "mysql://host/name", "postgresql+psycopg2://host/name"],
)
def test_a_database_that_cannot_serve_is_refused(url):
    with pytest.raises(DatabaseUrlError) as refused:
        open_database(url)
    assert "must be" in refused.value.message


def test_a_refused_url_keeps_its_password():
    with pytest.raises(DatabaseUrlError) as refused:
        open_database("postgres//user:secret@host/name")
    assert "secret" not in str(refused.value)


@pytest.mark.parametrize("scheme", ["postgres", "postgresql", "postgresql+psycopg"])
def test_postgres_is_reached_through_psycopg(scheme):
    database = open_database(f"{scheme}://user:secret@host/name")
    assert database.engine.driver == "psycopg"
    assert database.url == "postgresql+psycopg://user:secret@host/name"
    assert "secret" not in repr(database)
    database.dispose()


@pytest.mark.parametrize("value", [float("nan"), float("-inf"), {1}, b"bytes", object()])
def test_only_json_is_json(value):
    with pytest.raises(DocumentError, match="must be JSON"):
        _to_json({"value": value})


def test_every_refusal_has_a_message():
    def all_below(kind: type) -> set[type]:
        return {kind}.union(*(all_below(child) for child in kind.__subclasses__()))

    assert len(all_below(StorageError)) >= 11
    assert StorageError("sentence").message == "sentence"


def test_final_statuses():
    assert {status for status in JobStatus if status.final} == {"succeeded", "failed", "cancelled"}


def test_every_constraint_has_a_name():
    for table in Base.metadata.sorted_tables:
        for constraint in table.constraints | table.indexes:
            assert constraint.name, f"{table.name}: {constraint}"
