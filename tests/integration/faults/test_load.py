"""Many clients and workers at once: no error of the service, no lock that anybody notices. `make bench-service` measures the times."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from bench.service.load import load
from bench.service.process import KEY
from bench.service.process import serving as process
from tests.integration.api.conftest import Service, asked, make_keys, serving
from tests.integration.api.documents import LAG, chain
from tests.integration.coroutines import run
from tests.integration.faults.conftest import FULL
from tests.integration.faults.load import Load, summed, workers
from tests.support.desk import Desk

CLIENTS = 20
COMMAND: dict[str, Any] = {"input": {"port": "u", "signal": {"kind": "step"}}}


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

    with serving(url, requests_per_minute=0) as service, workers(url, 4, log=log):
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


#: What one key asks for at once: how often, and what.
ABUSE: dict[str, tuple[int, dict[str, Any]]] = {
    "twelve chains of 180 states": (12, {"system": chain(90), **COMMAND}),
    "45 slow simulations": (45, {"system": chain(60), **COMMAND, "variants": [{}] * 10}),
}


def timed(ask: Callable[[], httpx.Response]) -> float:
    """Return how long (s) an answer took, which must be none of a refusal."""
    began = time.monotonic()
    reply = ask()
    assert reply.status_code == 200, reply.text
    return time.monotonic() - began


def resident_mib(url: str) -> float:
    """Return the memory of the service itself."""
    found = re.search(
        r"^process_resident_memory_bytes (\S+)$", httpx.get(f"{url}/metrics", trust_env=False).text, re.MULTILINE
    )
    assert found
    return float(found[1]) / (1 << 20)


@pytest.mark.skipif(not FULL, reason="times on a machine at rest: make faults")
@pytest.mark.parametrize("what", ABUSE)
def test_a_small_simulation_of_another_workspace_waits_for_nobody(
    database_url: str, tmp_path: Path, what: str, record_testsuite_property: Callable[[str, object], None]
) -> None:
    count, body = ABUSE[what]
    with process(database_url, tmp_path / "service.txt") as url, ExitStack() as all_of_them:
        service = Service(url=url, database_url=database_url, keys=make_keys(database_url))
        client = all_of_them.enter_context(service.client("stranger"))

        def simulate() -> httpx.Response:
            return client.post("/v1/simulations", json={"system": LAG, **COMMAND})

        def look() -> httpx.Response:
            return client.get("/readyz")

        simulate()  # what is loaded with the first one is loaded
        resident = {"before": resident_mib(url)}
        slow = [all_of_them.enter_context(closing(asked(service, body))) for _ in range(count)]
        small, ready = [], []
        until = time.monotonic() + 30
        while time.monotonic() < until:
            small.append(timed(simulate))
            ready.append(timed(look))
            resident["peak"] = max(resident.get("peak", 0), resident_mib(url))
        for connection in slow:
            connection.close()
        resident["after"] = resident_mib(url)
    told = {name: float(np.quantile(times, 0.99)) for name, times in (("small", small), ("ready", ready))}
    for name, value in (told | resident).items():
        record_testsuite_property(f"{what}: {name}", round(value, 3))
    assert told["small"] <= 0.5
    assert told["ready"] <= 0.1
    assert resident["after"] <= 1.3 * resident["before"]
