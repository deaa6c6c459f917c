"""Many clients and workers at once: no error of the service, no lock that anybody notices. `make bench-service` measures the times."""

from __future__ import annotations

import time
from pathlib import Path

import httpx
import pytest

from bench.service.load import load
from bench.service.process import KEY
from bench.service.process import serving as process
from tests.integration.api.conftest import serving
from tests.integration.api.documents import LAG
from tests.integration.coroutines import run
from tests.integration.faults.conftest import FULL
from tests.integration.faults.load import Load, summed, workers
from tests.support.desk import Desk

CLIENTS = 20


def test_four_workers_and_twenty_clients_on_one_sqlite_file(
    sqlite_template: Path, tmp_path: Path, seconds: float
) -> None:
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    url, log = f"sqlite:///{path}", tmp_path / "workers.txt"

    def work(client: httpx.Client, number: int) -> httpx.Response:
        if number % 4 == 0:
            return client.post("/v1/systems", json=LAG | {"name": f"system {number}"})
        if number % 4 == 1:
            return client.get("/v1/systems", params={"limit": 3})
        return client.get("/v1/jobs", params={"limit": 3})

    # no load makes these workers silent for so long that they are taken for dead: that is another test's matter
    with serving(url, requests_per_minute=0) as service, workers(url, 4, log=log, heartbeat=30.0):
        desk = Desk(service.app.state.installation.database)
        with Load(service.client, work, threads=CLIENTS) as load:
            jobs = [desk.ask("square", values=[1], pause=0.01) for _ in range(200 if FULL else 20)]
            for job in jobs:
                assert desk.wait(job, timeout=600).status == "succeeded"
            time.sleep(seconds)
        desk.queue.close()
    assert summed(load.statuses, 200, 201) == {}, load.texts[:3]
    assert load.cut_off == 0
    assert load.done > CLIENTS
    assert "lock" not in log.read_text(), log.read_text()


@pytest.mark.skipif(not FULL, reason="a minute on a machine at rest: make faults")
def test_two_hundred_clients_wait_less_than_150_ms(database_url: str, tmp_path: Path) -> None:
    with process(database_url, tmp_path / "service.txt", processes=2) as url:  # as many as there are cores
        outcome = run(load(url, KEY, clients=200, seconds=60))
    assert not outcome.failures
    assert outcome.statuses.keys() <= {200, 201}, outcome.statuses
    assert outcome.statuses.total() == 200 * 60
    assert outcome.percentile(0.99) < 0.150


def test_two_hundred_clients_are_all_answered(sqlite_template: Path, tmp_path: Path) -> None:
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with serving(f"sqlite:///{path}", requests_per_minute=0) as service:
        outcome = run(load(service.url, service.keys["admin"], clients=200, seconds=2))
    assert not outcome.failures
    assert outcome.statuses.keys() <= {200, 201}, outcome.statuses
    assert outcome.statuses.total() == 200 * 2
