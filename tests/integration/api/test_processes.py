"""`servotune serve --processes 2`: for those who ask it is one service, whichever of its processes answers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import httpx
from prometheus_client.parser import text_string_to_metric_families

from tests.integration.api.documents import LAG
from tests.integration.api.test_commands import KEY, served
from tests.support.patience import PATIENCE

#: So many connections that all of them end at one process once in 2^15 times.
CONNECTIONS = 16
QUOTA = 100


def test_two_processes_are_one_service(tmp_path: Path, database_url: str) -> None:
    beside = database_url.startswith("sqlite")  # once is enough for what the database has no part in
    told = {"bootstrap_key": KEY, "log_format": "json", "requests_per_minute": str(QUOTA)}
    arguments = ["--processes", "2"] if beside else ["--processes", "2", "--no-worker"]
    with served(tmp_path, *arguments, database=database_url, **told) as (process, client):
        workers, answering = _children(process.pid)
        assert (len(workers), len(answering)) == (int(beside), 2)
        assert client.get("/readyz").json()["checks"]["worker"] == ("ok" if beside else "absent")

        new = client.post("/v1/keys", json={"name": "of many", "scopes": ["read", "write"]}).json()
        with _connections(client, new["key"]) as others:
            begun = time.monotonic()
            for number, other in enumerate(others):
                assert other.get("/v1/systems", headers={"X-Request-ID": f"number-{number}"}).status_code == 200
            made = others[0].post("/v1/systems", json=LAG).json()["id"]
            assert all(other.get(f"/v1/systems/{made}").status_code == 200 for other in others)
            # One allowance for all of them, in whichever order they come.
            left = QUOTA - 2 * CONNECTIONS - 1
            through = [other.get("/v1/systems").status_code for other in (others * QUOTA)[: left + 20]].count(200)
            assert left <= through <= left + 1 + (time.monotonic() - begun) * QUOTA / 60
            assert client.delete(f"/v1/keys/{new['id']}").status_code == 204
            # At once, also where it was let in a moment ago.
            assert {other.get("/v1/systems").status_code for other in others} <= {401}
        assert _processes_of_requests(tmp_path) == answering

        before = _answered(client)
        os.kill(min(answering), signal.SIGKILL)
        deadline = time.monotonic() + PATIENCE
        while len(now := _told(client)) < 2 or now == answering:
            assert time.monotonic() < deadline, (tmp_path / "log.txt").read_text()
            time.sleep(0.1)
        assert len(now & answering) == 1
        assert _answered(client) >= before
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=PATIENCE) == 0
        assert not [pid for pid in {*workers, *answering, *now} if Path(f"/proc/{pid}").exists()]
    assert "Traceback" not in (tmp_path / "log.txt").read_text()


@contextmanager
def _connections(client: httpx.Client, key: str) -> Iterator[list[httpx.Client]]:
    with ExitStack() as stack:
        yield [
            stack.enter_context(
                httpx.Client(
                    base_url=client.base_url, headers={"Authorization": f"Bearer {key}"}, timeout=60, trust_env=False
                )
            )
            for _ in range(CONNECTIONS)
        ]


def _children(parent: int) -> tuple[set[int], set[int]]:
    """Return the workers beside a service, and the processes that answer for it."""
    found = subprocess.run(["pgrep", "-a", "-P", str(parent)], capture_output=True, text=True, check=True).stdout
    lines = [(int(line.split()[0]), line) for line in found.splitlines()]
    return {pid for pid, line in lines if "--with-parent" in line}, {pid for pid, line in lines if "answer(" in line}


def _processes_of_requests(folder: Path) -> set[int]:
    lines = [json.loads(line) for line in (folder / "log.txt").read_text().splitlines() if line.startswith("{")]
    return {line["process"] for line in lines if line.get("request", "").startswith("number-")}


def _numbers(client: httpx.Client) -> Iterator[tuple[str, dict[str, str], float]]:
    try:
        text = client.get("/metrics").text
    except httpx.TransportError:  # it was the one that is killed
        return
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            yield sample.name, sample.labels, sample.value


def _told(client: httpx.Client) -> set[int]:
    """Return the processes of which the metrics tell."""
    return {int(labels["process"]) for name, labels, _ in _numbers(client) if name == "process_resident_memory_bytes"}


def _answered(client: httpx.Client) -> float:
    return sum(
        value
        for name, labels, value in _numbers(client)
        if name == "servotune_requests_total" and labels["route"].startswith("/v1")
    )
