from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pytest

from storage import Database
from storage.errors import DocumentError, InvalidCursorError, NotFoundError, RevisionConflictError
from storage.models import DEFAULT_WORKSPACE, Workspace
from storage.repositories import SystemRepository

# Keys in an order that is neither alphabetical nor by length, as a user wrote them.
DOCUMENT = {"name": "loop", "blocks": {"reference": {"kind": "input"}, "motor": {"area": 65e-4}, "error": {}}}


def create(database: Database, name: str = "loop") -> str:
    with database.session() as session:
        return SystemRepository(session, DEFAULT_WORKSPACE).create(name=name, document=DOCUMENT).id


def test_a_document_comes_back_as_it_was(database):
    identifier = create(database)
    with database.session() as session:
        stored = SystemRepository(session, DEFAULT_WORKSPACE).get(identifier)
    assert stored.document == DOCUMENT
    assert list(stored.document["blocks"]) == ["reference", "motor", "error"]
    assert (stored.revision, stored.schema_version, stored.name) == (1, 1, "loop")
    assert stored.created_at.utcoffset().total_seconds() == 0


def test_every_change_is_a_new_revision_and_the_old_ones_stay(database):
    identifier = create(database)
    with database.session() as session:
        systems = SystemRepository(session, DEFAULT_WORKSPACE)
        changed = systems.update(identifier, name="faster", document={"name": "faster"}, expected_revision=1)
        assert (changed.revision, changed.name) == (2, "faster")
    with database.session() as session:
        systems = SystemRepository(session, DEFAULT_WORKSPACE)
        assert systems.get(identifier).document == {"name": "faster"}
        assert systems.get(identifier, revision=1).document == DOCUMENT
        assert [row.number for row in systems.revisions(identifier)] == [2, 1]
        assert [row.number for row in systems.revisions(identifier, before=2)] == [1]
        with pytest.raises(NotFoundError):
            systems.get(identifier, revision=3)


def test_an_old_revision_cannot_be_changed_or_deleted(database):
    identifier = create(database)
    with database.session() as session:
        systems = SystemRepository(session, DEFAULT_WORKSPACE)
        systems.update(identifier, name="a", document={}, expected_revision=1)
        with pytest.raises(RevisionConflictError, match="must be 2, got 1"):
            systems.update(identifier, name="b", document={}, expected_revision=1)
        with pytest.raises(RevisionConflictError):
            systems.delete(identifier, expected_revision=1)
        assert systems.get(identifier).name == "a"


def test_of_two_writers_at_once_one_wins(database):
    identifier = create(database)

    def write(number: int) -> bool:
        try:
            with database.session() as session:
                systems = SystemRepository(session, DEFAULT_WORKSPACE)
                systems.update(identifier, name=f"writer {number}", document={}, expected_revision=1)
        except RevisionConflictError:
            return False
        return True

    with ThreadPoolExecutor(6) as threads:
        assert sum(threads.map(write, range(6))) == 1
    with database.session() as session:
        assert len(SystemRepository(session, DEFAULT_WORKSPACE).revisions(identifier)) == 2


def test_a_deleted_system_is_gone_for_its_users(database):
    identifier = create(database)
    with database.session() as session:
        SystemRepository(session, DEFAULT_WORKSPACE).delete(identifier, expected_revision=1)
    with database.session() as session:
        systems = SystemRepository(session, DEFAULT_WORKSPACE)
        for ask in (
            lambda: systems.get(identifier),
            lambda: systems.get(identifier, revision=1),
            lambda: systems.revisions(identifier),
            lambda: systems.update(identifier, name="x", document={}, expected_revision=1),
            lambda: systems.delete(identifier, expected_revision=1),
        ):
            with pytest.raises(NotFoundError):
                ask()
        assert systems.page().items == []


def test_another_workspace_sees_nothing(database):
    identifier = create(database)
    with database.session() as session:
        session.add(Workspace(id="ws_other", name="other"))
        session.flush()
        others = SystemRepository(session, "ws_other")
        with pytest.raises(NotFoundError):
            others.get(identifier)
        with pytest.raises(NotFoundError):
            others.update(identifier, name="x", document={}, expected_revision=1)
        with pytest.raises(NotFoundError):
            others.delete(identifier, expected_revision=1)
        assert others.page().items == []


def test_pages_are_stable_while_rows_are_inserted(database):
    wanted = [create(database, f"system {number}") for number in range(7)][::-1]
    seen: list[str] = []
    cursor = None
    while True:
        with database.session() as session:
            page = SystemRepository(session, DEFAULT_WORKSPACE).page(cursor=cursor, limit=3)
        seen += [row.id for row in page.items]
        cursor = page.next_cursor
        if cursor is None:
            break
        create(database, "a newer one")
    assert seen == wanted


def test_the_last_page_has_no_cursor_also_when_it_is_full(database):
    for number in range(4):
        create(database, str(number))
    with database.session() as session:
        systems = SystemRepository(session, DEFAULT_WORKSPACE)
        first = systems.page(limit=2)
        second = systems.page(cursor=first.next_cursor, limit=2)
        assert len(second.items) == 2
        assert second.next_cursor is None
        for limit in (0, 1001):
            with pytest.raises(ValueError, match="limit must be from 1 to 1000"):
                systems.page(limit=limit)


@pytest.mark.parametrize("cursor", ["", "x", "bnVsbA", "WzEsMl0", "WyIyMDI2LTAxLTAxIiwiYSJd", "é", "W10"])
def test_a_foreign_cursor_is_refused(database, cursor):
    with database.session() as session, pytest.raises(InvalidCursorError):
        SystemRepository(session, DEFAULT_WORKSPACE).page(cursor=cursor)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), {1, 2}])
def test_a_document_that_is_no_json_is_refused(database, value):
    with database.sessions() as session:
        systems = SystemRepository(session, DEFAULT_WORKSPACE)
        with pytest.raises(DocumentError, match="JSON"):
            systems.create(name="x", document={"value": value})


# What Postgres (NUL), UTF-8 (a lone surrogate) and SQLite (more than 64 bits) cannot take must fail alike on both.
@pytest.mark.parametrize("text", ["a\0b", "a\ud800b"])
def test_odd_text_is_kept_in_documents_and_refused_elsewhere(database, text):
    with database.sessions() as session:
        with pytest.raises(DocumentError, match="Unicode without NUL"):
            SystemRepository(session, DEFAULT_WORKSPACE).create(name=text, document={})
        session.rollback()
        stored = SystemRepository(session, DEFAULT_WORKSPACE).create(name="x", document={text: text})
        session.expunge_all()
        systems = SystemRepository(session, DEFAULT_WORKSPACE)
        assert systems.get(stored.id).document == {text: text}
        with pytest.raises(NotFoundError):
            systems.get(text)


@pytest.mark.parametrize("number", [0, -1, 2**31, 2**63, 10**30])
def test_a_revision_that_no_database_can_count_does_not_exist(database, number):
    identifier = create(database)
    with database.session() as session:
        systems = SystemRepository(session, DEFAULT_WORKSPACE)
        with pytest.raises(NotFoundError):
            systems.get(identifier, revision=number)
        with pytest.raises(RevisionConflictError):
            systems.delete(identifier, expected_revision=number)
        assert len(systems.revisions(identifier, before=number)) == (number > 1)
