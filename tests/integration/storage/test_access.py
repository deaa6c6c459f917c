"""Sign-ins, tickets, quotas and the audit log as rows; a database of the first release brought up to date."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from typing import NoReturn

import pytest
from alembic import command
from sqlalchemy import text

from storage import Database, audit, open_database
from storage.blobs import sha256_of
from storage.errors import QuotaExceededError
from storage.migrations import configuration
from storage.models import DEFAULT_WORKSPACE, SignIn, Ticket, Workspace
from storage.models.base import utc_now
from storage.repositories import (
    ApiKeyRepository,
    DatasetRepository,
    JobRepository,
    ResultRepository,
    SignInRepository,
    SystemRepository,
    WorkspaceRepository,
)

HOUR = timedelta(hours=1)


def test_a_change_and_its_entry_are_there_both_or_neither(database):
    acting = audit.ACTOR.set(audit.Actor(principal="key_1", request_id="r-1"))
    try:
        with pytest.raises(ZeroDivisionError):
            _change_and_fail(database)
        with database.session() as session:
            assert audit.entries(session, DEFAULT_WORKSPACE).items == []
            system = SystemRepository(session, DEFAULT_WORKSPACE).create(name="x", document={})
    finally:
        audit.ACTOR.reset(acting)
    with database.session() as session:
        (entry,) = audit.entries(session, DEFAULT_WORKSPACE).items
        assert (entry.principal, entry.request_id, entry.action, entry.target) == (
            "key_1",
            "r-1",
            "system.create",
            system.id,
        )
        assert audit.entries(session, "ws_other").items == []
        assert audit.forget(session, before=utc_now() - HOUR) == 0
        assert audit.forget(session, before=utc_now() + HOUR) == 1


def _change_and_fail(database: Database) -> NoReturn:
    with database.session() as session:
        SystemRepository(session, DEFAULT_WORKSPACE).create(name="x", document={})
        assert len(audit.entries(session, DEFAULT_WORKSPACE).items) == 1
        raise ZeroDivisionError


def test_what_changes_is_written_down(database):
    with database.session() as session:
        keys = ApiKeyRepository(session, DEFAULT_WORKSPACE)
        key, _token = keys.create(name="k", scopes=["read"])
        keys.rotate(key.id, overlap=HOUR)
        keys.revoke(key.id)
        keys.revoke(key.id)  # changes nothing any more
        jobs = JobRepository(session, DEFAULT_WORKSPACE)
        job = jobs.create(kind="optimization", body={})
        jobs.cancel(job.id)
        jobs.cancel(job.id)
        results = ResultRepository(session, DEFAULT_WORKSPACE)
        results.delete(results.create(kind="simulation", body={}).id)
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        datasets.delete(datasets.create(name="d", format="raw").id)
        room = WorkspaceRepository(session).create(name="room")
        WorkspaceRepository(session).update(room.id, name="hall", limits=None, expected_revision=1)
        found = [entry.action for entry in reversed(audit.entries(session, DEFAULT_WORKSPACE).items)]
        assert found == [
            "key.create", "key.create", "key.rotate", "key.revoke", "job.create", "job.cancel",
            "result.create", "result.delete", "dataset.create", "dataset.delete",
        ]  # fmt: skip
        there = [entry.action for entry in reversed(audit.entries(session, room.id).items)]
        assert there == ["workspace.create", "workspace.update"]


def test_stored_bytes_are_what_is_stored(database):
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        dataset = datasets.create(name="d", format="txt").id
        for piece in (b"abc", b"defg", b"abc"):  # the same piece twice is kept once
            datasets.put_segment(dataset, sha256_of(piece), piece)
        assert session.get_one(Workspace, DEFAULT_WORKSPACE).stored_bytes == 7
        datasets.delete(dataset)
        results = ResultRepository(session, DEFAULT_WORKSPACE)
        result = results.create(kind="x", body={"a": 1})
        assert session.get_one(Workspace, DEFAULT_WORKSPACE).stored_bytes == len('{"a": 1}')
        results.delete(result.id)
        assert session.get_one(Workspace, DEFAULT_WORKSPACE).stored_bytes == 0


def test_a_finished_job_keeps_what_it_found_also_beyond_the_quota(database):
    with database.session() as session:
        session.get_one(Workspace, DEFAULT_WORKSPACE).limits = {"stored_bytes": 3}
    with database.session() as session:
        results = ResultRepository(session, DEFAULT_WORKSPACE)
        results.create(kind="x", body={"a": 1}, within_quota=False)
        with pytest.raises(QuotaExceededError, match="at most 3 stored bytes, this one has 8"):
            results.create(kind="x", body={"a": 1})


def test_a_sign_in_ends_and_is_forgotten(database):
    with database.session() as session:
        sign_ins = SignInRepository(session)
        row, token = sign_ins.open(workspace_id=DEFAULT_WORKSPACE, name="me", lasts=HOUR, scopes=["read"])
        assert token not in str(session.execute(text("SELECT * FROM sign_in")).all())
        visitor = sign_ins.visitor(token)
        assert (visitor.principal, visitor.scopes, visitor.name) == (row.id, {"read"}, "me")
        assert sign_ins.visitor(token + "x") is None
        row.expires_at = utc_now() - HOUR
        session.flush()
        assert sign_ins.visitor(token) is None
        sign_ins.give_ticket(principal="key_1", workspace_id=DEFAULT_WORKSPACE, scopes=["read"], lasts=-HOUR)
        sign_ins.forget()
        assert session.query(SignIn).count() == session.query(Ticket).count() == 0


def test_of_many_with_the_same_ticket_one_gets_in(database):
    with database.session() as session:
        ticket, _ends = SignInRepository(session).give_ticket(
            principal="key_1", workspace_id=DEFAULT_WORKSPACE, scopes=["read"], lasts=HOUR
        )
        late, _ends = SignInRepository(session).give_ticket(
            principal="key_1", workspace_id=DEFAULT_WORKSPACE, scopes=["read"], lasts=-HOUR
        )

    def come(_number: int) -> bool:
        with database.session() as session:
            return SignInRepository(session).redeem(ticket) is not None

    with ThreadPoolExecutor(6) as threads:
        assert sum(threads.map(come, range(6))) == 1
    with database.session() as session:
        assert SignInRepository(session).redeem(late) is None


def test_a_database_of_the_first_release_is_brought_up_to_date(empty_database_url):
    """Rows as the first release wrote them; the counter of stored bytes begins with what is there."""
    database = open_database(empty_database_url)
    config = configuration()
    with database.engine.begin() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, "0001")
    now = "2026-01-02 03:04:05.000000" + ("" if database.engine.dialect.name == "sqlite" else "+00")
    rows = [
        f"INSERT INTO api_key VALUES ('key_1', 'ws_default', 'k', 'st_abc', '{'a' * 64}', '[\"admin\"]', '{now}', NULL, NULL)",
        f"INSERT INTO system VALUES ('sys_1', 'ws_default', 'lag', 1, '{now}', '{now}', NULL)",
        f"INSERT INTO system_revision VALUES ('sys_1', 1, '{{\"name\":\"lag\"}}', 1, '{now}')",
        f"INSERT INTO blob VALUES ('{'b' * 64}', 100, '{now}')",
        "INSERT INTO dataset VALUES ('ds_1', 'ws_default', 'd', 'raw', 'open', '[]', "
        + ", ".join(["NULL"] * 9)
        + f", '{now}')",
        f"INSERT INTO dataset_segment VALUES ('ds_1', '{'b' * 64}', 100, '{now}')",
        f"INSERT INTO result VALUES ('res_1', 'ws_default', 'x', '{{}}', NULL, 'sys_1', 1, '{{}}', '{now}')",
        f"INSERT INTO result_array VALUES ('res_1', 0, '{'b' * 64}')",
    ]
    with database.engine.begin() as connection:
        for row in rows:
            connection.exec_driver_sql(row)
    assert not database.is_current()
    database.migrate()
    assert database.is_current()
    with database.session() as session:
        key = ApiKeyRepository(session, DEFAULT_WORKSPACE).get("key_1")
        assert (key.scopes, key.expires_at) == (["admin"], None)
        assert ApiKeyRepository(session, DEFAULT_WORKSPACE).has_admin()
        workspace = session.get_one(Workspace, DEFAULT_WORKSPACE)
        assert (workspace.revision, workspace.limits) == (1, None)
        assert workspace.stored_bytes == 100 + len('{"name":"lag"}') + len("{}") + 100
        assert SystemRepository(session, DEFAULT_WORKSPACE).get("sys_1").document == {"name": "lag"}
    database.dispose()
