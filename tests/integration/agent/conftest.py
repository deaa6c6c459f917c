"""A service for the module, and for each test a rig of its own."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from agent import process, uploading
from rig_simulator.grpc_server import Server
from tests.integration.agent.lab import Lab, make_bench
from tests.integration.api.conftest import Service, serving


@pytest.fixture(scope="module")
def service(sqlite_template: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    path = tmp_path_factory.mktemp("service") / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with serving(f"sqlite:///{path}") as running:
        yield running


@pytest.fixture(autouse=True)
def _asks_often(monkeypatch: pytest.MonkeyPatch) -> None:
    """An agent ends when its question for work is answered: every test would wait for that."""
    monkeypatch.setattr(process, "_CLAIM_WAIT", 0.2)
    monkeypatch.setattr(uploading, "_LOOK", 0.05)


@pytest.fixture
def lab(service: Service, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Lab]:
    bench = make_bench()
    server = Server(bench)
    rig = re.sub(r"[^a-z0-9]+", "-", request.node.name)
    with service.client() as client:
        yield Lab(service=service, client=client, rig=rig, folder=tmp_path, bench=bench, server=server)
    server.close()
