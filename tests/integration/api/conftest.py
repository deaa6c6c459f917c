"""A real server on a free port, with keys of every scope, on SQLite and on Postgres; a worker where jobs run."""

from __future__ import annotations

import base64
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
import uvicorn
from fastapi import FastAPI

from api.app.main import create_app
from api.processes.serving import configuration
from api.settings import Settings
from storage import open_database
from storage.models import DEFAULT_WORKSPACE
from storage.models.workspace import Workspace
from storage.repositories import ApiKeyRepository
from tests.support.patience import PATIENCE


@dataclass(frozen=True)
class Service:
    """A running service and the keys that open it."""

    url: str
    database_url: str
    keys: dict[str, str]
    app: FastAPI | None = None

    def client(self, key: str = "admin") -> httpx.Client:
        return httpx.Client(
            base_url=self.url, headers={"Authorization": f"Bearer {self.keys[key]}"}, timeout=PATIENCE, trust_env=False
        )


def make_keys(database_url: str) -> dict[str, str]:
    database = open_database(database_url)
    keys = {}
    with database.session() as session:
        own = ApiKeyRepository(session, DEFAULT_WORKSPACE)
        for scope in ("admin", "read", "write", "run", "acquire"):
            keys[scope] = own.create(name=scope, scopes=[scope])[1]
        row, keys["revoked"] = own.create(name="revoked", scopes=["admin"])
        own.revoke(row.id)
        session.add(Workspace(id="ws_other", name="other"))
        session.flush()
        keys["stranger"] = ApiKeyRepository(session, "ws_other").create(name="stranger", scopes=["admin"])[1]
    database.dispose()
    return keys


@contextmanager
def serving(database_url: str, **settings: Any) -> Iterator[Service]:
    """Run the application under uvicorn in a thread of this process."""
    # Tests show many wrong keys.
    usual = {"wrong_keys_per_minute": 0, "secret_key": base64.b64encode(bytes(32)).decode()}
    chosen = Settings(database_url=database_url, **(usual | settings))
    app = create_app(chosen)
    server = uvicorn.Server(configuration(app, grace=1, proxies=chosen.trusted_proxies))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        assert thread.is_alive(), "the server did not start"
        time.sleep(0.01)
    port = server.servers[0].sockets[0].getsockname()[1]
    try:
        yield Service(url=f"http://127.0.0.1:{port}", database_url=database_url, keys=make_keys(database_url), app=app)
    finally:
        server.should_exit = True
        thread.join(timeout=PATIENCE)
        assert not thread.is_alive()


def asked(service: Service, body: dict[str, Any], key: str = "admin") -> socket.socket:
    """Send a simulation, and wait for no answer."""
    text = json.dumps(body).encode()
    url = httpx.URL(service.url)
    head = (
        f"POST /v1/simulations HTTP/1.1\r\nHost: {url.host}\r\nAuthorization: Bearer {service.keys[key]}\r\n"
        f"Content-Type: application/json\r\nContent-Length: {len(text)}\r\n\r\n"
    )
    connection = socket.create_connection((url.host, url.port))
    connection.sendall(head.encode() + text)
    return connection


@pytest.fixture(scope="module")
def service(module_database_url: str) -> Iterator[Service]:
    with serving(module_database_url) as running:
        yield running


@pytest.fixture(scope="module")
def sqlite_service(sqlite_template: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service for tests that have nothing to learn from a second kind of database."""
    path = tmp_path_factory.mktemp("service") / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with serving(f"sqlite:///{path}") as running:
        yield running


@pytest.fixture(scope="module")
def client(service: Service) -> Iterator[httpx.Client]:
    with service.client() as client:
        yield client


@pytest.fixture(scope="module")
def worker(service: Service) -> Iterator[None]:
    """A worker process on the same database."""
    with working(service.database_url):
        yield


@pytest.fixture(scope="module")
def sqlite_worker(sqlite_service: Service) -> Iterator[None]:
    """A worker process on the database of `sqlite_service`."""
    with working(sqlite_service.database_url):
        yield


@contextmanager
def working(database_url: str) -> Iterator[None]:
    """Run a worker process."""
    code = "import sys; from api.commands.service import worker; sys.exit(worker(['--with-parent']))"
    # With all else that this process has: what a linear-algebra library was told decides the last bits of its numbers.
    environment = os.environ | {"SERVOTUNE_DATABASE_URL": database_url, "PYTHONPATH": ":".join(sys.path)}
    process = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, env=environment)
    assert process.stdin is not None
    try:
        yield
    finally:
        process.stdin.close()
        assert process.wait(timeout=PATIENCE) == 0


def finished(client: httpx.Client, job: dict[str, Any], *, within: float = PATIENCE) -> dict[str, Any]:
    """Wait for a job to end."""
    until = time.monotonic() + within
    while time.monotonic() < until:
        now: dict[str, Any] = client.get(f"/v1/jobs/{job['id']}").json()
        if now["status"] in {"succeeded", "failed", "cancelled"}:
            return now
        time.sleep(0.1)
    raise AssertionError(f"job {job['id']} did not end within {within} s: {now}")
