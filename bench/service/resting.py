"""What workers that have nothing to do cost: processor time of Postgres and of their own, transactions and connections."""

from __future__ import annotations

import time
from dataclasses import dataclass

from sqlalchemy import text

from bench.service.processor import processor_time
from bench.service.workers import Desk, working


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
            spent, own = processor_time("postgres"), processor_time("python")
            time.sleep(seconds)
            took = time.perf_counter() - begun
            return Rest(
                cores=(processor_time("postgres") - spent) / took,
                own=(processor_time("python") - own) / took / workers,
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
