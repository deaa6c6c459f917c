"""Schedules that follow the recordings take the newest one of a name, and say when there is none; what else can be scheduled."""

from __future__ import annotations

import pytest
from sqlalchemy import select

from storage import open_database
from storage.models import Dataset, Job
from tests.integration.api.documents import LAG, RAW, lag_recording, upload

IDENTIFICATION = {"system": LAG, "inputs": {"u": "u"}, "outputs": {"y": "y"}, "parameters": ["k"]}
DATA = lag_recording(samples=200)


def recorded(client, name: str) -> str:
    reply = upload(client, RAW | {"name": name}, DATA)
    assert reply.status_code == 200, reply.text
    return str(reply.json()["id"])


@pytest.fixture
def client(sqlite_service):
    with sqlite_service.client() as own:
        yield own


def nightly(dataset: str, **more) -> dict:
    job = {"kind": "identification", "body": IDENTIFICATION | {"dataset": dataset}}
    return {"name": "nightly", "cron": "30 2 * * *", "job": job} | more


def dataset_of(service, job: str) -> str:
    database = open_database(service.database_url)
    with database.session() as session:
        body = session.get_one(Job, job).body
    database.dispose()
    return str(body["request"]["dataset"])


def test_each_run_takes_the_newest_recording_of_the_name(sqlite_service, client) -> None:
    first = recorded(client, "press 3")
    schedule = client.post("/v1/schedules", json=nightly(first, newest="press 3", overlap="cancel_previous"))
    assert schedule.status_code == 201, schedule.text
    assert schedule.json()["document"]["newest"] == "press 3"
    path = f"/v1/schedules/{schedule.json()['id']}/trigger"
    assert dataset_of(sqlite_service, client.post(path).json()["job"]) == first
    recorded(client, "press 4")
    second = recorded(client, "press 3")
    client.post("/v1/datasets", json=RAW | {"name": "press 3"})  # one that has not been received yet
    assert dataset_of(sqlite_service, client.post(path).json()["job"]) == second


def test_without_a_recording_of_the_name_nothing_is_run(sqlite_service, client) -> None:
    dataset = recorded(client, "press 5")
    refused = client.post("/v1/schedules", json=nightly(dataset, newest="press 6"))
    assert refused.status_code == 422
    assert refused.json()["errors"] == [
        {"pointer": "/newest", "detail": "newest must be the name of a recording that is ready, got 'press 6'"}
    ]
    schedule = client.post("/v1/schedules", json=nightly(dataset, newest="press 5")).json()["id"]
    database = open_database(sqlite_service.database_url)
    with database.session() as session:
        for row in session.scalars(select(Dataset).where(Dataset.name == "press 5")):
            row.name = "moved away"
    database.dispose()
    gone = client.post(f"/v1/schedules/{schedule}/trigger")
    assert (gone.status_code, gone.json()["detail"].split(",")[0]) == (
        422,
        "newest must be the name of a recording that is ready",
    )


def test_a_job_without_a_recording_has_no_newest_one(client) -> None:
    from tests.integration.api.documents import OPTIMIZATION

    job = {"kind": "optimization", "body": OPTIMIZATION | {"system": LAG}}
    refused = client.post("/v1/schedules", json=nightly("", newest="press 3") | {"job": job})
    assert refused.status_code == 422
    assert "newest must be left out" in refused.json()["detail"]


def test_a_validation_can_be_scheduled(sqlite_service, client) -> None:
    dataset = recorded(client, "press 7")
    body = {key: value for key, value in IDENTIFICATION.items() if key != "parameters"}
    job = {"kind": "validation", "body": body | {"dataset": dataset, "limit_percent": 5}}
    made = client.post("/v1/schedules", json=nightly(dataset) | {"job": job, "newest": "press 7"})
    assert made.status_code == 201, made.text
    run = client.post(f"/v1/schedules/{made.json()['id']}/trigger").json()
    assert client.get(f"/v1/jobs/{run['job']}").json()["kind"] == "validation"
    wrong = job | {"body": job["body"] | {"outputs": {"nobody": "y"}}}
    refused = client.post("/v1/schedules", json=nightly(dataset) | {"job": wrong})
    assert refused.json()["errors"][0]["pointer"] == "/job/body/outputs/nobody"
