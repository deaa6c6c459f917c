from __future__ import annotations

import subprocess
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta

import pytest

from storage import Database, processes
from storage.errors import IdempotencyMismatchError, IdempotencyRunningError, StateError
from storage.models import DEFAULT_WORKSPACE, Idempotency
from storage.models.base import utc_now
from storage.repositories import Answer, Claim, IdempotencyRepository, SystemRepository
from storage.repositories.idempotency import ABANDONED_AFTER, forget

REQUEST = {"endpoint": "POST /v1/systems", "body_sha256": "0" * 64}
ANSWER = Answer(status_code=201, headers={"Location": "/v1/systems/sys_1"}, body=b'{"id":"sys_1"}')


def claim(database: Database, principal: str = "key_1", **request: str) -> Claim | Answer:
    with database.session() as session:
        return IdempotencyRepository(session, principal).claim("k", **(REQUEST | request))


def test_the_first_answer_is_repeated(database):
    first = claim(database)
    assert isinstance(first, Claim)
    with database.session() as session:
        IdempotencyRepository(session, "key_1").finish(first, ANSWER)
    assert claim(database) == ANSWER
    assert isinstance(claim(database, principal="key_2"), Claim)


def test_a_key_belongs_to_one_request(database):
    claim(database)
    with pytest.raises(IdempotencyMismatchError):
        claim(database, body_sha256="1" * 64)
    with pytest.raises(IdempotencyMismatchError):
        claim(database, endpoint="POST /v1/datasets")


def test_of_many_at_once_one_does_the_work(database):
    def attempt(_number: int) -> bool:
        try:
            return isinstance(claim(database), Claim)
        except IdempotencyRunningError:
            return False

    with ThreadPoolExecutor(8) as threads:
        assert sum(threads.map(attempt, range(8))) == 1


def test_a_request_that_failed_may_be_tried_again(database):
    first = claim(database)
    with database.session() as session:
        IdempotencyRepository(session, "key_1").abandon(first)
    assert isinstance(claim(database), Claim)


def test_a_request_that_died_is_taken_over_and_cannot_come_back(database):
    first = claim(database)
    with database.session() as session:
        row = session.get_one(Idempotency, ("key_1", "k"))
        row.created_at = utc_now() - ABANDONED_AFTER - timedelta(seconds=1)
    second = claim(database)
    assert isinstance(second, Claim)
    with pytest.raises(IdempotencyRunningError):
        claim(database)
    with database.sessions() as session:
        SystemRepository(session, DEFAULT_WORKSPACE).create(name="zombie", document={})
        with pytest.raises(StateError, match="expired"):
            IdempotencyRepository(session, "key_1").finish(first, ANSWER)
    with database.session() as session:
        IdempotencyRepository(session, "key_1").abandon(first)  # not its own any more: nothing happens
        IdempotencyRepository(session, "key_1").finish(second, ANSWER)
    assert claim(database) == ANSWER


def test_a_request_that_died_with_its_process_on_this_machine_is_taken_over_at_once(database):
    other = subprocess.Popen(["cat"], stdin=subprocess.PIPE)
    first = claim(database)
    with database.session() as session:
        row = session.get_one(Idempotency, ("key_1", "k"))
        assert row.process == processes.this_process()
        row.process = processes.name_of(other.pid)
    with pytest.raises(IdempotencyRunningError):
        claim(database)
    other.kill()
    other.communicate()
    second = claim(database)
    assert isinstance(second, Claim)
    with pytest.raises(IdempotencyRunningError):  # it is this process' now
        claim(database)
    with database.sessions() as session, pytest.raises(StateError, match="expired"):
        IdempotencyRepository(session, "key_1").finish(first, ANSWER)


def test_a_request_that_died_elsewhere_is_taken_over_when_it_is_old(database):
    claim(database)
    with database.session() as session:
        session.get_one(Idempotency, ("key_1", "k")).process = "another-boot/pid:[1]/7/7"
    with pytest.raises(IdempotencyRunningError):
        claim(database)
    with database.session() as session:
        session.get_one(Idempotency, ("key_1", "k")).created_at = utc_now() - ABANDONED_AFTER - timedelta(seconds=1)
    assert isinstance(claim(database), Claim)


def test_old_keys_are_forgotten(database):
    claim(database)
    with database.session() as session:
        assert forget(session, before=utc_now() - timedelta(hours=24)) == 0
        assert forget(session, before=utc_now() + timedelta(seconds=1)) == 1
    assert isinstance(claim(database), Claim)
