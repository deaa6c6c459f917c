"""The service is killed in the middle of requests: what was answered is there, what was not can be sent again."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest
from sqlalchemy import func, select, text

from storage import Database, open_database
from storage.models import DatasetSegment, Job, System
from tests.integration.api.documents import LAG, OPTIMIZATION, RAW, lag_recording, sha256
from tests.integration.api.test_commands import free_port
from tests.integration.faults.load import Load

KEY = "a-key-of-the-operator"
THREADS = 4


class Service:
    """`servotune serve --no-worker` as a process that is killed and started again at the same place."""

    def __init__(self, database_url: str, log: Path) -> None:
        self.port = free_port()
        self._environment = os.environ | {
            "SERVOTUNE_DATABASE_URL": database_url, "SERVOTUNE_BOOTSTRAP_KEY": KEY, "SERVOTUNE_REQUESTS_PER_MINUTE": "0",
        }  # fmt: skip
        self._log = log

    def start(self) -> None:
        command = [sys.executable, "-m", "servotune", "serve", "--no-worker", "--port", str(self.port)]
        with self._log.open("ab") as log:
            self.process = subprocess.Popen(command, env=self._environment, stdout=log, stderr=log)
        until = time.monotonic() + 300
        while True:
            try:
                with self.client() as client:
                    if client.get("/readyz").status_code == 200:
                        return
            except httpx.TransportError:
                pass
            assert self.process.poll() is None, self._log.read_text()
            assert time.monotonic() < until, self._log.read_text()
            time.sleep(0.05)

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def client(self) -> httpx.Client:
        headers = {"Authorization": f"Bearer {KEY}"}
        return httpx.Client(base_url=f"http://127.0.0.1:{self.port}", headers=headers, trust_env=False, timeout=20)


@pytest.fixture
def service(database_url, tmp_path):
    running = Service(database_url, tmp_path / "log.txt")
    try:
        running.start()
        yield running
    finally:
        running.kill()


def counted(database: Database) -> tuple[int, int]:
    """Return how many jobs there are, and how many of them the engine carries."""
    dbos = "" if database.engine.dialect.name == "sqlite" else "dbos."
    with database.session() as session:
        jobs = session.scalar(select(func.count()).select_from(Job))
        carried = session.scalar(
            text(
                f"SELECT count(*) FROM job JOIN {dbos}workflow_status AS w ON w.workflow_uuid = job.ticket WHERE w.status = 'ENQUEUED'"
            )
        )
    return jobs, carried


def test_no_job_is_lost_none_is_there_twice_and_no_segment_by_half(service, database_url, rounds: int) -> None:
    database = open_database(database_url)
    accepted: dict[int, set[str]] = {}
    sent = before = 0

    def submit(client: httpx.Client, number: int) -> httpx.Response:
        nonlocal sent
        number += before
        sent = max(sent, number)
        body = OPTIMIZATION | {"system": LAG | {"name": f"asked {number}"}}
        reply = client.post("/v1/optimizations", json=body, headers={"Idempotency-Key": f"job {number}"})
        if reply.status_code == 202:
            accepted.setdefault(number, set()).add(reply.json()["id"])
        return reply

    recording = lag_recording(samples=4000)
    with service.client() as client:
        dataset = client.post("/v1/datasets", json=RAW).json()["id"]
    place = f"/v1/datasets/{dataset}/segments/{sha256(recording)}"
    for _ in range(rounds):
        before = max(
            sent - THREADS, 0
        )  # first the keys that were shown last: a killed process was at work on some of them
        with Load(service.client, submit, threads=THREADS) as load:
            load.wait(10)
            # Half a segment is on its way, too.
            with socket.create_connection(("127.0.0.1", service.port)) as line:
                head = f"PUT {place} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {KEY}\r\nContent-Type: application/octet-stream\r\n"
                line.sendall(
                    (head + f"Content-Length: {len(recording)}\r\n\r\n").encode() + recording[: len(recording) // 2]
                )
                load.wait(5)
                service.kill()
        assert set(load.statuses) == {202}
        jobs, carried = counted(database)
        assert jobs == carried  # no half of one
        service.start()
    before = 0
    with service.client() as client, database.session() as session:
        for number, answers in accepted.items():
            (job,) = answers
            assert client.get(f"/v1/jobs/{job}").json()["status"] == "queued", number
        # Whoever was not answered asks again, with the same keys, and has one job for each of them in the end.
        for number in range(1, sent + 1):
            reply = submit(client, number)
            assert reply.status_code == 202, reply.text
        assert session.scalar(select(func.count()).select_from(DatasetSegment)) == 0
        assert client.put(
            place, content=recording, headers={"Content-Type": "application/octet-stream"}
        ).status_code in {200, 201, 204}
        done = client.post(
            f"/v1/datasets/{dataset}/commit", json={"segments": [sha256(recording)], "sha256": sha256(recording)}
        )
        assert done.json()["status"] == "ready"
        assert session.scalar(select(func.count()).select_from(System)) == 0
    jobs, carried = counted(database)
    assert jobs == carried == len(accepted) == sent
    assert all(len(answers) == 1 for answers in accepted.values())
    database.dispose()
