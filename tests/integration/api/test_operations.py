"""What an operator sees: numbers, readiness, log lines, traces."""

from __future__ import annotations

import json
import logging
import os
import re
import signal
import time
from pathlib import Path

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families
from sqlalchemy import text

from api.telemetry.logs import CURRENT_REQUEST, Structured
from storage import open_database
from storage.jobs.compute import CURRENT_JOB
from tests.integration.api.conftest import serving
from tests.integration.api.documents import LAG, OPTIMIZATION
from tests.integration.api.test_commands import served
from tests.support.collecting import collector
from tests.support.patience import PATIENCE


def numbers(client: httpx.Client) -> dict[tuple[str, ...], float]:
    reply = client.get("/metrics")
    assert reply.status_code == 200
    return {
        (sample.name, *sample.labels.values()): sample.value
        for family in text_string_to_metric_families(reply.text)
        for sample in family.samples
    }


def test_metrics_tell_requests_queue_and_workers_without_names(service, client) -> None:
    before = numbers(client)
    assert client.get("/v1/jobs/job_none").status_code == 404
    assert httpx.get(f"{service.url}/v1/jobs", trust_env=False).status_code == 401
    assert client.get("/v1/secret-plans").status_code == 404
    job = client.post("/v1/optimizations", json=OPTIMIZATION | {"system": LAG | {"name": "confidential"}}).json()
    after = numbers(client)
    for key in (
        ("servotune_requests_total", "GET", "/v1/jobs/{identifier}", "404"),
        ("servotune_requests_total", "GET", "none", "401"),
        ("servotune_request_seconds_count", "POST", "/v1/optimizations"),
    ):
        assert after[key] == before.get(key, 0) + 1, key
    assert (
        after["servotune_jobs", "optimization", "queued"]
        == before.get(("servotune_jobs", "optimization", "queued"), 0) + 1
    )
    assert after["servotune_queue_oldest_seconds", "optimization"] < 60
    assert after["servotune_database_up",] == 1
    assert after["servotune_workers", "alive"] == 0
    client.post(f"/v1/jobs/{job['id']}/cancel")
    ended = numbers(client)
    assert ended["servotune_jobs_ended_total", "optimization", "cancelled"] >= 1
    exposed = client.get("/metrics").text
    assert "confidential" not in exposed
    assert "secret-plans" not in exposed
    assert job["id"] not in exposed


def test_readiness_tells_what_is_wrong_and_recovers(sqlite_template: Path, tmp_path: Path) -> None:
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with serving(f"sqlite:///{path}") as running, running.client() as client:
        assert client.get("/readyz").json()["checks"] == {"database": "ok", "migrations": "ok", "worker": "absent"}
        database = open_database(running.database_url)
        with database.engine.begin() as connection:
            version = connection.scalar(text("SELECT version_num FROM alembic_version"))
            connection.execute(text("UPDATE alembic_version SET version_num = '0001'"))
        behind = client.get("/readyz")
        assert (behind.status_code, behind.json()["checks"]["migrations"]) == (503, "behind")
        with database.engine.begin() as connection:
            connection.execute(text("UPDATE alembic_version SET version_num = :v"), {"v": version})
        assert client.get("/readyz").status_code == 200
        database.dispose()


def test_a_dead_worker_beside_the_service_is_told_and_replaced(tmp_path: Path) -> None:
    with served(tmp_path, bootstrap_key="a-key-of-the-operator", log_format="json") as (process, client):
        worker = _pid_of_worker(process.pid)
        os.kill(worker, signal.SIGKILL)
        deadline = time.monotonic() + PATIENCE
        while (reply := client.get("/readyz")).status_code == 200:
            assert time.monotonic() < deadline
        assert reply.json()["checks"]["worker"] == "absent"
        deadline = time.monotonic() + PATIENCE
        while client.get("/readyz").status_code != 200:
            assert time.monotonic() < deadline, (tmp_path / "log.txt").read_text()
            time.sleep(0.1)
        assert _pid_of_worker(process.pid) != worker
        client.get("/v1/jobs", headers={"X-Request-ID": "my-own-number"})
    lines = [line for line in (tmp_path / "log.txt").read_text().splitlines() if line.startswith("{")]
    logged = [json.loads(line) for line in lines]
    assert any("the worker beside the service ended with code -9" in line["message"] for line in logged)
    (request,) = [line for line in logged if line.get("request") == "my-own-number"]
    assert (request["method"], request["path"], request["status"]) == ("GET", "/v1/jobs", 200)


def _pid_of_worker(parent: int) -> int:
    for status in Path("/proc").glob("[0-9]*/status"):
        try:
            found = re.search(r"^PPid:\s+(\d+)$", status.read_text(), flags=re.MULTILINE)
            command = status.with_name("cmdline").read_bytes()
        except OSError:
            continue
        if found is not None and int(found[1]) == parent and b"--with-parent" in command:
            return int(status.parent.name)
    raise AssertionError("the service has no worker")


def test_a_line_of_json_carries_the_ids_of_request_and_job() -> None:
    record = logging.LogRecord("servotune.x", logging.WARNING, "", 0, "half of %s\nis left", ("it",), None)
    request, job = CURRENT_REQUEST.set("req-1"), CURRENT_JOB.set("job_1")
    try:
        line = Structured().format(record)
    finally:
        CURRENT_REQUEST.reset(request)
        CURRENT_JOB.reset(job)
    assert "\n" not in line
    told = json.loads(line)
    assert (told["level"], told["message"]) == ("warning", "half of it\nis left")
    assert (told["request"], told["job"]) == ("req-1", "job_1")
    assert "job" not in json.loads(Structured().format(record))


@pytest.mark.parametrize("wanted", [True, False])
def test_requests_are_traced_where_somebody_collects_traces(
    sqlite_template: Path, tmp_path: Path, wanted: bool
) -> None:
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with collector() as (endpoint, received):
        settings = {"otlp_endpoint": endpoint} if wanted else {}
        with serving(f"sqlite:///{path}", **settings) as running, running.client() as client:
            client.get("/v1/jobs")
    assert bool(received) == wanted
    for where, body in received:
        assert where == "/v1/traces"
        assert b"/v1/jobs" in body
