"""Optimisations that are asked for over HTTP and computed by `servotune worker` with a cluster beside it, whoever goes meanwhile."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from distributed import Client
from distributed.security import Security

from storage import Database
from storage.models import JobState
from tests.integration.api.conftest import Service, finished, serving
from tests.integration.api.test_optimizations import REQUEST
from tests.integration.cluster.conftest import ROOT, DaskCluster, two_workers
from tests.support.desk import wait_for

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")

#: Some ten seconds of one processor, which is all that the worker has: enough for chunks to leave the process, on any machine.
BODY = REQUEST | {
    "variables": [{"parameter": "c"}, {"parameter": "k", "lower": 0.5, "upper": 50}],
    "scenarios": [{"m": 0.5 + 0.01 * i} for i in range(100)],
    "method": {"kind": "grid", "points": 160},
}


WORK = """
import os, sys
from servotune.main import main
os.sched_setaffinity(0, {int(sys.argv[1])})
sys.exit(main(["worker"]))
"""


@contextmanager
def working(url: str, log: Path, cluster: DaskCluster | None) -> Iterator[subprocess.Popen[bytes]]:
    """Run `servotune worker`."""
    environment = {**os.environ, "SERVOTUNE_DATABASE_URL": url, "PYTHONPATH": str(ROOT)}
    if cluster is not None:
        environment |= {
            "SERVOTUNE_CLUSTER": cluster.address,
            "SERVOTUNE_CLUSTER_CA": cluster.files["tls_ca_file"],
            "SERVOTUNE_CLUSTER_CERT": cluster.files["tls_client_cert"],
            "SERVOTUNE_CLUSTER_KEY": cluster.files["tls_client_key"],
        }
    command = [sys.executable, "-c", WORK, str(min(os.sched_getaffinity(0)))]
    with log.open("ab") as written:
        process = subprocess.Popen(command, env=environment, stdout=written, stderr=written)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.fixture
def service(tmp_path: Path, sqlite_template: Path) -> Iterator[Service]:
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with serving(f"sqlite:///{path}") as made:
        yield made


@pytest.fixture
def own(tmp_path: Path) -> Iterator[DaskCluster]:
    with two_workers(tmp_path) as made:
        yield made


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory, sqlite_template: Path) -> dict[str, Any]:
    """What a worker without a cluster finds."""
    folder = tmp_path_factory.mktemp("alone")
    path = folder / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with (
        serving(f"sqlite:///{path}") as service,
        working(service.database_url, folder / "log", None),
        service.client() as client,
    ):
        return result_of(client, client.post("/v1/optimizations", json=BODY).json())


def result_of(client: httpx.Client, job: dict[str, Any]) -> dict[str, Any]:
    """Return what a job has found, without what it took."""
    done = finished(client, job)
    assert done["status"] == "succeeded", done
    found = client.get(done["result"]).json()
    history = [{**point, "seconds": None} for point in found["history"]]
    return {name: value for name, value in found.items() if name not in {"effort", "seconds"}} | {"history": history}


def chunks(cluster: DaskCluster) -> int:
    """Return how many chunks the workers of a cluster have had in their hands."""
    with Client(
        cluster.address, security=Security(require_encryption=True, **cluster.files), set_as_default=False
    ) as client:
        counted: int = client.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.transition_log))
        return counted


def test_a_job_finds_the_same_with_a_cluster(
    service: Service, own: DaskCluster, alone: dict[str, Any], tmp_path: Path
) -> None:
    with working(service.database_url, tmp_path / "worker", own), service.client() as client:
        found = result_of(client, client.post("/v1/optimizations", json=BODY).json())
    assert chunks(own) > 0
    assert found == alone


def test_a_job_ends_right_when_its_scheduler_goes(
    service: Service, own: DaskCluster, alone: dict[str, Any], tmp_path: Path
) -> None:
    with working(service.database_url, tmp_path / "worker", own), service.client() as client:
        job = client.post("/v1/optimizations", json=BODY).json()
        wait_for(lambda: chunks(own) > 0, "chunks that have left")
        own.scheduler.send_signal(signal.SIGKILL)
        assert result_of(client, job) == alone


def test_another_worker_goes_on_with_the_cluster(
    service: Service, own: DaskCluster, alone: dict[str, Any], tmp_path: Path
) -> None:
    assert service.app is not None
    database: Database = service.app.state.installation.database

    def kept() -> JobState | None:
        with database.session() as session:
            return session.get(JobState, job["id"])

    log = tmp_path / "worker"
    with service.client() as client:
        with working(service.database_url, log, own) as first:
            job = client.post("/v1/optimizations", json=BODY).json()
            wait_for(lambda: chunks(own) > 0 and kept() is not None, "something to lose")
            first.send_signal(signal.SIGKILL)
        with working(service.database_url, log, own):
            assert result_of(client, job) == alone
        assert finished(client, job)["attempts"] == 2
