"""Service and workers are killed again and again while clients write everything that there is: nothing is lost, nothing doubled."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from sqlalchemy import func, select

from storage import open_database
from storage.models import Dataset, Job, System
from tests.integration.api.documents import LAG, OPTIMIZATION, sha256
from tests.integration.faults.conftest import FULL
from tests.integration.faults.load import Load
from tests.integration.faults.test_service_killed import Service
from tests.support.desk import wait_for

pytestmark = pytest.mark.skipif(not FULL, reason="minutes of starting and computing: make faults")

THREADS, KILLED, ANSWERS = 4, 5, 100
CSV = {"name": "x", "format": "csv", "import": {"sample_rate": 10}}


@pytest.fixture
def service(database_url: str, tmp_path: Path) -> Iterator[Service]:
    running = Service(database_url, tmp_path / "log.txt")
    try:
        running.start()
        yield running
    finally:
        running.kill()


@contextmanager
def working(url: str, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A worker as people run it, killed at the end."""
    command = [sys.executable, "-c", "import sys; from api.commands.service import worker; sys.exit(worker([]))"]
    with log.open("ab") as written:
        process = subprocess.Popen(command, env=os.environ | {"SERVOTUNE_DATABASE_URL": url}, stderr=written)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def test_nothing_is_lost_and_nothing_is_there_twice(service: Service, database_url: str, tmp_path: Path) -> None:
    told: dict[int, set[str]] = {}
    sent = before = 0

    def ask(client: httpx.Client, number: int) -> httpx.Response:
        """Create a system, a recording or a job, once for its number."""
        nonlocal sent
        number += before
        sent = max(sent, number)
        key = {"Idempotency-Key": f"number {number}"}
        if number % 3 == 0:
            reply = client.post("/v1/systems", json=LAG | {"name": f"{number}"}, headers=key)
        elif number % 3 == 1:
            body = OPTIMIZATION | {"system": LAG | {"name": f"{number}"}}
            reply = client.post("/v1/optimizations", json=body, headers=key)
        else:
            content = f"x\n{number}\n2\n3\n".encode()
            reply = client.post("/v1/datasets", json=CSV, headers=key)
            if reply.status_code == 201:
                where = reply.headers["Location"]
                put = client.put(f"{where}/segments/{sha256(content)}", content=content)
                assert put.status_code in {200, 201, 409}, (
                    put.text
                )  # 409: it was closed before, with this segment in it
                manifest = {"segments": [sha256(content)], "sha256": sha256(content)}
                client.post(f"{where}/commit", json=manifest).raise_for_status()
        if reply.status_code < 300:
            told.setdefault(number, set()).add(reply.json()["id"])
        return reply

    for _ in range(KILLED):
        before = max(sent - THREADS, 0)  # first what a killed process was at work on
        with working(database_url, tmp_path / "workers.txt"), Load(service.client, ask, threads=THREADS) as load:
            load.wait(ANSWERS, timeout=300)
            service.kill()
        assert set(load.statuses) <= {201, 202}, (load.statuses, load.texts[:3])
        service.start()
    before = 0
    database = open_database(database_url)
    with working(database_url, tmp_path / "workers.txt"), service.client() as client:
        for number in range(1, sent + 1):  # whoever was not answered asks again
            reply = ask(client, number)
            assert reply.status_code in {201, 202}, reply.text
        assert sorted(told) == list(range(1, sent + 1))
        assert all(len(ids) == 1 for ids in told.values())

        def count(kind: type, *where: object) -> int:
            with database.session() as session:
                return session.scalar(select(func.count()).select_from(kind).where(*where)) or 0  # type: ignore[arg-type]

        kinds = {rest: sum(number % 3 == rest for number in told) for rest in range(3)}
        assert count(System) == kinds[0]
        assert count(Dataset) == kinds[2]
        assert count(Job) == kinds[1] + kinds[2]
        wait_for(lambda: count(Job, Job.status.in_(["queued", "running"])) == 0, "the end of all jobs", timeout=600)
        assert count(Job, Job.status == "succeeded") == kinds[1] + kinds[2]
        assert count(Dataset, Dataset.status == "ready") == kinds[2]
    database.dispose()
