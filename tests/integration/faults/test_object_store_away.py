"""The object store goes away, is slow, is full, lets nobody in or gives other bytes: a clear 503, nothing lost, and it goes on afterwards."""

from __future__ import annotations

import logging
import subprocess
import sys
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import httpx
import numpy as np
import pytest
from sqlalchemy import select

from storage import Database
from storage.models import BlobChunk
from storage.models.base import utc_now
from tests.integration.api.conftest import serving
from tests.integration.api.documents import sha256
from tests.support.desk import Desk, wait_for
from tests.support.object_store import BUCKET, Door, object_store, opened

ADDRESS = f"s3://{BUCKET}/of/one"
SAYS = {
    "away": "the object store does not answer",
    "slow": "the object store does not answer",
    "full": "the object store takes no blobs: it is full",
    "busy": "the object store cannot do its work now, it answers 503",
    "closed": "the object store lets nobody in with the AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY that there are",
}
DATA = np.arange(5000.0).tobytes()


@pytest.fixture
def door(monkeypatch: pytest.MonkeyPatch) -> Iterator[Door]:
    with object_store(monkeypatch) as door:
        yield door


@pytest.fixture
def client(door: Door, database_url: str) -> Iterator[httpx.Client]:
    chosen = {"blob_store": "objects", "object_store": ADDRESS}
    with serving(database_url, **chosen) as service, service.client() as client:
        yield client


def create(client: httpx.Client) -> str:
    body = {
        "name": "r",
        "format": "raw",
        "channels": [{"name": "y", "quantity": "voltage", "unit": "V"}],
        "sample_rate": 1000,
    }
    made = client.post("/v1/datasets", json=body)
    assert made.status_code == 201, made.text
    return f"/v1/datasets/{made.json()['id']}"


def send(client: httpx.Client, where: str) -> httpx.Response:
    return client.put(f"{where}/segments/{sha256(DATA)}", content=DATA)


def commit(client: httpx.Client, where: str) -> httpx.Response:
    return client.post(f"{where}/commit", json={"segments": [sha256(DATA)], "sha256": sha256(DATA)})


def says(reply: httpx.Response, kind: str, what: str) -> None:
    assert (reply.status_code, reply.json()["type"]) == (503, f"urn:servotune:problem:{kind}"), reply.text
    assert what in reply.json()["detail"]
    assert "Traceback" not in reply.text
    assert "127.0.0.1" not in reply.text


def no_traces(caplog: pytest.LogCaptureFixture) -> None:
    assert [record for record in caplog.records if record.exc_info or record.levelno >= logging.ERROR] == []


@pytest.mark.parametrize("fault", SAYS)
def test_what_cannot_be_kept_or_read_is_told_and_done_later(
    door: Door, client: httpx.Client, fault: str, caplog: pytest.LogCaptureFixture
) -> None:
    where = create(client)
    door.befall(fault)
    refused = send(client, where)
    says(refused, "unavailable", SAYS[fault])
    assert refused.headers["Retry-After"] == "5"
    door.befall("")
    assert client.get(f"{where}/segments").json()["items"] == []  # what was refused left nothing
    assert send(client, where).status_code == 201

    door.befall(fault, methods=("PUT",))
    says(commit(client, where), "unavailable", SAYS[fault])
    door.befall("")
    assert client.get(where).json()["status"] == "open"
    assert commit(client, where).json()["status"] == "ready"

    door.befall(fault)
    for read in ("original", "channels/y", "export?format=csv"):
        says(client.get(f"{where}/{read}"), "unavailable", SAYS[fault])
    door.befall("")
    assert client.get(f"{where}/original").content == DATA
    assert client.get(f"{where}/channels/y").status_code == 200
    no_traces(caplog)


def test_other_bytes_than_were_kept_are_told_with_both_sums(
    door: Door, client: httpx.Client, caplog: pytest.LogCaptureFixture
) -> None:
    where = create(client)
    assert send(client, where).status_code == 201
    assert commit(client, where).json()["status"] == "ready"
    door.befall("wrong", methods=("GET",))
    for read in ("original", "channels/y", "export?format=csv"):
        reply = client.get(f"{where}/{read}")
        says(reply, "damaged-blob", "in the object store must be")
        assert "got" in reply.json()["detail"]
    door.befall("")
    assert client.get(f"{where}/original").content == DATA
    opened().delete([name for page in opened().older(utc_now() + timedelta(hours=1)) for name in page])
    says(client.get(f"{where}/original"), "damaged-blob", "it has no such object")
    no_traces(caplog)


WORK = """
import sys, threading
from storage.jobs.worker import Worker
from storage.objects import ObjectStore
objects = ObjectStore(sys.argv[2], preferred=True)
Worker(sys.argv[1], compute="tests.support.computing:run", heartbeat=0.2, objects=objects).run(threading.Event())
"""


def test_a_job_waits_for_a_full_store_with_its_result(door: Door, fresh_database: Database, tmp_path: Path) -> None:
    desk = Desk(fresh_database)
    log = tmp_path / "worker.txt"
    with log.open("wb") as written:
        worker = subprocess.Popen([sys.executable, "-c", WORK, fresh_database.url, ADDRESS], stderr=written)
    try:
        door.befall("full")
        job = desk.ask("square", values=[1, 2, 3], pause=0.0)
        wait_for(lambda: "it is full" in log.read_text(), "the worker meets the full store")
        assert desk.get(job).status == "running"
        door.befall("")
        done = desk.wait(job)
        assert done.status == "succeeded"
        with fresh_database.session() as session:
            chunk = session.scalars(select(BlobChunk)).one()
            assert (chunk.data, chunk.object is None) == (b"", False)
    finally:
        worker.kill()
        worker.wait()
        desk.queue.close()
