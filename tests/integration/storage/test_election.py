"""One of many does what is done for all; when it dies, stops or falls silent, another one does."""

from __future__ import annotations

import subprocess
import sys
import threading

import pytest
from sqlalchemy import select

from storage import Database
from storage.election import Election
from storage.models import Elected


class Clock:
    now = 50.0

    def __call__(self) -> float:
        return self.now


def candidates(database: Database, clock: Clock, count: int = 3) -> list[Election]:
    return [Election(database, "test", patience=8.0, clock=clock) for _ in range(count)]


def test_one_is_elected_and_stays_so(database: Database) -> None:
    clock = Clock()
    first, *others = candidates(database, clock)
    for _ in range(30):
        clock.now += 1.0
        assert first.elected()
        assert not any(other.elected() for other in others)
        assert [first.won, *(other.won for other in others)] == [True, False, False]


def test_who_falls_silent_is_replaced_by_one_and_knows_it_when_it_comes_back(database: Database) -> None:
    clock = Clock()
    first, second, third = candidates(database, clock)
    assert first.elected()
    for _ in range(8):
        assert not second.elected()
        assert not third.elected()
        clock.now += 1.0
    assert second.elected()
    assert not third.elected()
    assert not first.elected()
    clock.now += 7.0
    assert second.elected()
    assert not first.elected()


def test_who_looks_after_a_long_time_does_not_take_the_living_for_dead(database: Database) -> None:
    clock = Clock()
    first, second, _ = candidates(database, clock)
    assert first.elected()
    assert not second.elected()
    for _ in range(100):
        clock.now += 1.0
        assert first.elected()
    assert not second.elected()


def test_who_resigns_is_replaced_at_once(database: Database) -> None:
    first, second, third = candidates(database, Clock())
    assert first.elected()
    second.resign()  # was not elected: nothing happens
    assert first.elected()
    first.resign()
    assert third.elected()
    assert not second.elected()


def test_roles_have_nothing_to_do_with_one_another(database: Database) -> None:
    clock = Clock()
    assert Election(database, "one", clock=clock).elected()
    assert Election(database, "two", clock=clock).elected()


def test_of_many_at_once_one_is_elected(database: Database) -> None:
    clock, found, start = Clock(), [], threading.Barrier(6)

    def stand(election: Election) -> None:
        start.wait()
        found.append(election.elected())

    threads = [threading.Thread(target=stand, args=(one,)) for one in candidates(database, clock, 6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(found) == [False] * 5 + [True]


_STAND = """
import sys, time
from storage import open_database
from storage.election import Election
election = Election(open_database(sys.argv[1]), "test")
print(election.elected(), flush=True)
time.sleep(600)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells whether a process of this machine has ended")
def test_who_is_killed_on_this_machine_is_replaced_at_the_next_look(fresh_database: Database) -> None:
    url = fresh_database.url
    with subprocess.Popen([sys.executable, "-c", _STAND, url], stdout=subprocess.PIPE, text=True) as first:
        assert first.stdout is not None
        assert first.stdout.readline().strip() == "True"
        second = Election(fresh_database, "test", clock=Clock())
        assert not second.elected()
        first.kill()
        first.wait()
        assert second.elected()
    with fresh_database.session() as session:
        assert session.scalars(select(Elected.role)).all() == ["test"]
