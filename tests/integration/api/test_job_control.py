"""What a user says about a job's turn and its end, over HTTP."""

from __future__ import annotations

import hashlib

import pytest

from tests.integration.api.documents import LAG
from tests.integration.api.documents import OPTIMIZATION as GRID

OPTIMIZATION = GRID | {"system": LAG}


@pytest.fixture
def job(client):
    """A job that nobody computes: there is no worker."""
    body = OPTIMIZATION | {"queue": {"priority": "low", "time_limit": 60, "deadline": "2990-01-01T00:00:00+01:00"}}
    reply = client.post("/v1/optimizations", json=body)
    assert reply.status_code == 202, reply.text
    yield reply.json()
    client.post(f"/v1/jobs/{reply.json()['id']}/cancel")


def test_a_job_says_what_was_asked_of_its_queue(client, job) -> None:
    assert (job["priority"], job["time_limit"], job["deadline"]) == ("low", 60.0, "2989-12-31T23:00:00+00:00")
    assert (job["paused"], job["attempts"], job["message"]) == (False, 0, "waits for a free worker")
    usual = client.post("/v1/optimizations", json=OPTIMIZATION).json()
    assert (usual["priority"], usual["time_limit"], usual["deadline"]) == ("normal", None, None)
    client.post(f"/v1/jobs/{usual['id']}/cancel")


def test_a_job_is_paused_and_resumed_until_it_has_ended(client, job) -> None:
    one = f"/v1/jobs/{job['id']}"
    paused = client.post(f"{one}/pause")
    assert (paused.status_code, paused.json()["paused"], paused.json()["status"]) == (200, True, "queued")
    assert client.post(f"{one}/pause").json() == paused.json()
    assert paused.json()["message"] == "paused: it waits until it is resumed"
    resumed = client.post(f"{one}/resume").json()
    assert (resumed["paused"], resumed["status"]) == (False, "queued")
    assert client.post(f"{one}/resume").json() == resumed
    assert client.post(f"{one}/cancel").json()["status"] == "cancelled"
    for action in ("pause", "resume"):
        reply = client.post(f"{one}/{action}")
        assert reply.status_code == 409
        assert "must not have ended" in reply.json()["detail"]
    assert client.post("/v1/jobs/job_none/pause").status_code == 404


@pytest.mark.parametrize(
    ("queue", "pointer"),
    [
        ({"priority": "urgent"}, "/queue/priority"),
        ({"time_limit": 0}, "/queue/time_limit"),
        ({"deadline": "2020-01-01T00:00:00Z"}, "/queue/deadline"),
        ({"deadline": "tomorrow"}, "/queue/deadline"),
        ({"deadline": "2990-01-01T00:00:00"}, "/queue/deadline"),
        ({"weight": 3}, "/queue/weight"),
    ],
)
def test_a_wrong_word_about_the_queue_is_refused_at_its_place(client, queue, pointer) -> None:
    reply = client.post("/v1/optimizations", json=OPTIMIZATION | {"queue": queue})
    assert reply.status_code == 422, reply.text
    assert [entry["pointer"] for entry in reply.json()["errors"]] == [pointer]


def test_whatever_a_worker_does_says_when_it_gets_its_turn(client) -> None:
    """A file that is looked at and read, as an optimisation is."""
    queue = {"priority": "high", "time_limit": 30}
    content = b"t,u,y\n" + b"".join(b"%g,%g,%g\n" % (0.001 * i, i % 7, i % 5) for i in range(500))
    name = hashlib.sha256(content).hexdigest()
    dataset = f"/v1/datasets/{client.post('/v1/datasets', json={'name': 'r', 'format': 'txt'}).json()['id']}"
    put = client.put(
        f"{dataset}/segments/{name}", content=content, headers={"Content-Type": "application/octet-stream"}
    )
    assert put.status_code < 300, put.text
    preview = client.post(f"{dataset}/preview", json={"segments": [name], "queue": queue})
    read = client.post(f"{dataset}/commit", json={"segments": [name], "sha256": name, "queue": queue})
    for reply in (preview, read):
        assert reply.status_code == 202, reply.text
        job = client.get(
            f"/v1/jobs/{reply.json()['job']['id'] if 'job' in reply.json() else reply.json()['id']}"
        ).json()
        assert (job["priority"], job["time_limit"]) == ("high", 30.0)
        client.post(f"/v1/jobs/{job['id']}/cancel")
    late = {"segments": [name], "queue": {"deadline": "2020-01-01T00:00:00Z"}}
    refused = client.post(f"{dataset}/preview", json=late)
    assert refused.status_code == 422, refused.text
    assert refused.json()["errors"][0]["pointer"] == "/queue/deadline"
