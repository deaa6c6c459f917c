"""What workers that have nothing to do cost: processor time of Postgres and of their own, transactions and connections."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import text

from bench.service.workers import Desk, working

_TICK = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, slots=True, kw_only=True)
class Rest:
    """What was seen: cores that Postgres is busy with, those of each worker, its transactions in a second and connections."""

    cores: float
    own: float
    transactions: float
    connections: float


def resting(url: str, *, workers: int, seconds: float) -> Rest:
    """Return what Postgres does while so many workers wait for a job."""
    desk = Desk(url)
    try:
        with working(desk, url, workers):
            time.sleep(20.0)  # in which the last one has done what a worker does once
            begun, counted = time.perf_counter(), _counted(desk)
            spent, own = _spent("postgres"), _spent("python")
            time.sleep(seconds)
            took = time.perf_counter() - begun
            return Rest(
                cores=(_spent("postgres") - spent) / took,
                own=(_spent("python") - own) / took / workers,
                transactions=(_counted(desk)[0] - counted[0]) / took / workers,
                connections=counted[1] / workers,
            )
    finally:
        desk.close()


def _counted(desk: Desk) -> tuple[int, int]:
    """Return the transactions that the database has seen, and its connections."""
    with desk.database.engine.connect() as connection:
        asked = (
            "SELECT xact_commit + xact_rollback, numbackends FROM pg_stat_database WHERE datname = current_database()"
        )
        transactions, connections = connection.execute(text(asked)).one()
    return int(transactions), int(connections)


def _spent(program: str) -> float:
    """Return the processor time (s) of every process of a program that is a descendant of this one, ended ones of Postgres included."""
    found = dict(filter(None, map(_read, Path("/proc").glob("[0-9]*/stat"))))
    total = 0.0
    for number, (name, fields) in found.items():
        if name.startswith(program) and os.getpid() in _ancestors(found, number):
            parent, _ = found.get(int(fields[1]), ("", []))
            own = int(fields[11]) + int(fields[12])
            ended = (
                0 if parent.startswith(program) else int(fields[13]) + int(fields[14])
            )  # those of the postmaster alone
            total += (own + ended) / _TICK
    return total


def _read(path: Path) -> tuple[int, tuple[str, list[str]]] | None:
    try:
        head, _, rest = path.read_text().rpartition(")")
    except OSError:
        return None
    number, _, name = head.partition(" (")
    return int(number), (name, rest.split())


def _ancestors(found: dict[int, tuple[str, list[str]]], number: int) -> Iterator[int]:
    while number in found:
        number = int(found[number][1][1])
        yield number
