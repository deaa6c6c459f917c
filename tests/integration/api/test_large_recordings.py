"""Many raw samples are read by a job; what is read counts as stored; a file that is read again is another revision."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from sqlalchemy import func, select

from api.services.recordings import raw_samples
from storage import open_database
from storage.models import ChannelBlock
from tests.integration.api.conftest import finished
from tests.integration.api.documents import RAW, lag_recording, sha256, upload


@pytest.fixture(scope="module")
def client(sqlite_service, sqlite_worker):
    with sqlite_service.client() as client:
        yield client


def stored(client):
    """Return the bytes that count as stored."""
    return client.get("/v1/workspaces/ws_default").json()["used"]["stored_bytes"]


def about(size):
    """Compare bytes; the results of the jobs that read are documents of some hundred bytes, and count as well."""
    return pytest.approx(size, abs=1000)


def blocks(service, dataset):
    """Return how many blocks of samples a dataset has."""
    database = open_database(service.database_url)
    with database.session() as session:
        count = session.scalar(select(func.count()).select_from(ChannelBlock).where(ChannelBlock.dataset_id == dataset))
    database.dispose()
    return count


def test_many_raw_samples_are_read_by_a_job_as_few_are_at_once(client, monkeypatch):
    data = lag_recording()
    at_once = upload(client, RAW, data)
    assert (at_once.status_code, at_once.json()["status"]) == (200, "ready")
    monkeypatch.setattr(raw_samples, "AT_ONCE", len(data) - 1)
    before = stored(client)
    reply = upload(client, RAW, data)
    assert (reply.status_code, reply.json()["status"]) == (202, "parsing")
    where = f"/v1/datasets/{reply.json()['id']}"
    assert finished(client, reply.json()["job"])["status"] == "succeeded"
    read, known = client.get(where), at_once.json()
    assert read.headers["ETag"] == '"3"'
    assert read.json()["status"] == "ready"
    for key in ("channels", "sample_rate", "sample_count", "start_time", "report", "size", "sha256"):
        assert read.json()[key] == known[key], key
    for name, column in zip("uy", np.frombuffer(data, "<f8").reshape(-1, 2).T, strict=True):
        assert client.get(f"{where}/channels/{name}").json()["values"] == column.tolist()
    # closed again, as by an agent that did not hear the first answer
    manifest = {"segments": [s["sha256"] for s in client.get(f"{where}/segments").json()["items"]]}
    again = client.post(f"{where}/commit", json=manifest | {"sha256": sha256(data)})
    assert (again.status_code, again.json()["status"]) == (200, "ready")
    assert stored(client) == about(before + len(data))
    assert client.delete(where, headers={"If-Match": '"3"'}).status_code == 204
    assert stored(client) == about(before)


def test_a_frequency_response_needs_less_memory_than_the_recording_has(client):
    x = np.random.default_rng(1).standard_normal(2_000_000)
    data = np.column_stack([x, 2 * x]).astype("<f8").tobytes()
    channels = [{"name": "x"}, {"name": "y"}]
    recording = upload(client, RAW | {"sample_rate": 1000, "channels": channels}, data, segment=8 << 20)
    body = {"dataset": recording.json()["id"], "input": "x", "output": "y", "band": [1, 20]}
    assert client.post("/v1/frfs", json=body | {"part": [0, 100]}).status_code == 200  # loads what it needs
    tracemalloc.start()
    try:
        reply = client.post("/v1/frfs", json=body)
        needed = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert reply.status_code == 200, reply.text
    assert reply.json()["outputs"]["y"]["magnitude"] == pytest.approx([2.0] * len(reply.json()["frequency"]))
    assert needed < len(data)


def test_a_file_that_is_read_again_is_another_revision_and_counts_with_its_samples(client, sqlite_service):
    content = b"x\n" + b"1,5\n2,5\n" * 5000
    before = stored(client)
    bad = {"sample_rate": 10, "delimiter": ";", "columns": [{"index": 3, "name": "x"}]}
    reply = upload(client, {"name": "again", "format": "csv", "import": bad}, content, segment=1 << 20)
    where = f"/v1/datasets/{reply.json()['id']}"
    finished(client, reply.json()["job"])
    failed = client.get(where)
    assert (failed.json()["status"], failed.headers["ETag"]) == ("failed", '"3"')
    assert stored(client) == about(before + len(content))
    assert blocks(sqlite_service, failed.json()["id"]) == 0
    good = {"sample_rate": 10, "delimiter": ";", "decimal": ",", "columns": [{"source": "x", "name": "x"}]}
    manifest = {"segments": [sha256(content)], "sha256": sha256(content), "import": good}
    again = client.post(f"{where}/commit", json=manifest)
    assert finished(client, again.json()["job"])["status"] == "succeeded"
    read = client.get(where)
    assert (read.json()["status"], read.json()["revision"], read.headers["ETag"]) == ("ready", 5, '"5"')
    assert stored(client) == about(before + len(content) + 8 * 10_000)
    assert client.delete(where, headers={"If-Match": failed.headers["ETag"]}).status_code == 412
    assert client.delete(where, headers={"If-Match": read.headers["ETag"]}).status_code == 204
    assert stored(client) == about(before)


def test_samples_beyond_the_quota_are_refused_and_nothing_of_them_is_left(client, sqlite_service):
    """A digit and a line's end are two bytes, a sample is eight."""
    content = b"x\n" + b"1\n2\n" * 100_000
    before = stored(client)
    workspace = client.get("/v1/workspaces/ws_default")
    limited = {"name": workspace.json()["name"], "limits": {"stored_bytes": before + 2 * len(content)}}
    tag = {"If-Match": workspace.headers["ETag"]}
    assert client.put("/v1/workspaces/ws_default", json=limited, headers=tag).status_code == 200
    try:
        reply = upload(
            client, {"name": "small file", "format": "csv", "import": {"sample_rate": 10}}, content, segment=1 << 20
        )
        job = finished(client, reply.json()["job"])
    finally:
        tag = {"If-Match": client.get("/v1/workspaces/ws_default").headers["ETag"]}
        client.put("/v1/workspaces/ws_default", json={"name": limited["name"]}, headers=tag)
    dataset = client.get(f"/v1/datasets/{reply.json()['id']}").json()
    assert (job["status"], dataset["status"]) == ("failed", "failed")
    assert dataset["error"]["quota"] == "stored_bytes"
    assert blocks(sqlite_service, dataset["id"]) == 0
    assert stored(client) == about(before + len(content))
