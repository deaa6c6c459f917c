"""`servotune serve` and `servotune worker` as a user runs them."""

from __future__ import annotations

import hashlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from cryptography.fernet import Fernet
from opentelemetry.proto.trace.v1.trace_pb2 import Span
from sqlalchemy import select
from websockets.sync.client import connect

from api.commands.service import _prepare, openapi, serve, worker
from api.settings import Settings
from storage import open_database
from storage.models import Webhook
from tests.integration.api.conftest import finished
from tests.integration.api.documents import LAG, upload
from tests.integration.api.test_datasets import FILE, TEXT
from tests.support import postgres
from tests.support.collecting import collector, spans_of
from tests.support.patience import PATIENCE

KEY = "a-key-of-the-operator"
#: The trace and the caller's span of the example in W3C's Trace Context, section 3.2.
TRACE, CALLER = "4bf92f3577b34da6a3ce929d0e0e4736", "00f067aa0ba902b7"


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])


@contextmanager
def served(
    folder: Path, *arguments: str, database: str | None = None, **settings: str
) -> Iterator[tuple[subprocess.Popen[str], httpx.Client]]:
    """Run `servotune serve` until it is ready; stop it at the end."""
    port = free_port()
    environment = {name: value for name, value in os.environ.items() if not name.startswith("SERVOTUNE_")}
    environment |= {"SERVOTUNE_DATABASE_URL": database or f"sqlite:///{folder / 'served.db'}"}
    environment |= {f"SERVOTUNE_{name.upper()}": value for name, value in settings.items()}
    command = [sys.executable, "-m", "servotune", "serve", "--port", str(port), *arguments]
    with (folder / "log.txt").open("w") as log:
        process = subprocess.Popen(command, env=environment, stdout=log, stderr=subprocess.STDOUT, text=True)
        try:
            with httpx.Client(base_url=f"http://127.0.0.1:{port}", trust_env=False, timeout=PATIENCE) as client:
                wait(client, 200, process, folder)
                client.headers["Authorization"] = f"Bearer {settings.get('bootstrap_key', '')}"
                yield process, client
        finally:
            process.terminate()
            try:
                process.wait(timeout=PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def wait(
    client: httpx.Client, status: int, process: subprocess.Popen[str], folder: Path, within: float = PATIENCE
) -> Any:
    until = time.monotonic() + within
    while time.monotonic() < until:
        assert process.poll() is None, (folder / "log.txt").read_text()
        try:
            reply = client.get("/readyz")
            if reply.status_code == status:
                return reply
        except httpx.TransportError:
            pass
        time.sleep(0.1)
    raise AssertionError((folder / "log.txt").read_text())


def test_serve_brings_up_a_service_that_computes_and_stops_in_good_order(tmp_path, database_url) -> None:
    told = {"bootstrap_key": KEY, "log_format": "json"}
    with collector() as (endpoint, received):
        with served(tmp_path, database=database_url, otlp_endpoint=endpoint, **told) as (process, client):
            assert client.get("/readyz").json()["checks"]["worker"] == "ok"
            client.headers.update({"X-Request-ID": "asked-for-it", "traceparent": f"00-{TRACE}-{CALLER}-01"})
            reply = upload(client, FILE, TEXT)
            del client.headers["X-Request-ID"], client.headers["traceparent"]
            job = finished(client, reply.json()["job"])
            assert job["status"] == "succeeded"
            assert number(client, rf'servotune_job_seconds_total{{kind="{job["kind"]}",status="succeeded"}}') > 0
            # The worker tells it with its next heartbeat.
            assert number(client, r'servotune_kernel_warm_up_seconds{worker="[^"]+"}') > 0
            process.send_signal(signal.SIGTERM)
            assert process.wait(timeout=PATIENCE) == 0
        require_one_trace(spans_of(received, TRACE), job)
    log = (tmp_path / "log.txt").read_text()
    assert "Traceback" not in log
    assert KEY not in log
    lines = [json.loads(line) for line in log.splitlines() if line.startswith("{")]
    about = [line for line in lines if line.get("job") == job["id"]]
    assert {line["logger"] for line in about} >= {"storage.jobs.supervision"}
    assert {line.get("request") for line in about} == {"asked-for-it"}


def test_what_needs_no_kernels_does_not_wait_until_they_are_compiled(tmp_path, monkeypatch) -> None:
    """On a busy machine that takes minutes, the first time: an import waited for them, `queued`."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    with served(tmp_path, bootstrap_key=KEY) as (_, client):
        job = finished(client, upload(client, FILE, TEXT).json()["job"])
        assert job["status"] == "succeeded"
        assert not list(tmp_path.glob("cache/servotune/*/compiled-*"))
    assert "kernels are being compiled" in (tmp_path / "log.txt").read_text()


def test_serve_says_what_lies_open(tmp_path) -> None:
    with served(tmp_path, "--no-worker", bootstrap_key=KEY):
        assert (tmp_path / "served.db").stat().st_mode & 0o077 == 0
    told = (tmp_path / "log.txt").read_text()
    assert "can be read by other users" not in told
    assert "webhooks" not in told
    (tmp_path / "served.db").chmod(0o644)
    (tmp_path / "served.db.key").unlink()
    with served(tmp_path, "--no-worker", bootstrap_key=KEY, plain_secrets="true"):
        assert not (tmp_path / "served.db.key").exists()
    told = (tmp_path / "log.txt").read_text()
    assert f"{tmp_path / 'served.db'} can be read by other users of this machine: chmod 600" in told
    assert "secrets of webhooks are stored as they are" in told


def test_serve_makes_a_key_for_secrets_beside_its_database(tmp_path) -> None:
    """It is made once, for the service's user alone, and encrypts; without it what it encrypted is not read, in words."""
    body = {"name": "ci", "url": "https://no-such-host.invalid/", "events": ["job.failed"]}
    path = tmp_path / "served.db.key"
    with served(tmp_path, "--no-worker", bootstrap_key=KEY) as (_, client):
        made = client.post("/v1/webhooks", json=body)
        assert made.status_code == 201, made.text
        assert path.stat().st_mode & 0o077 == 0
        key = path.read_text()
    url = f"sqlite:///{tmp_path / 'served.db'}"
    database = open_database(url)
    with database.session() as session:
        (kept,) = session.scalars(select(Webhook.secret))
    database.dispose()
    assert Fernet(key).decrypt(kept.removeprefix("fernet:")).decode() == made.json()["secret"]
    with served(tmp_path, "--no-worker", bootstrap_key=KEY):
        assert path.read_text() == key
    path.unlink()
    with pytest.raises(SystemExit, match=re.escape("SERVOTUNE_SECRET_KEY: the key must be given") + f".*{path.name}"):
        _prepare(Settings(database_url=url))
    assert not path.exists()


def number(client: httpx.Client, name: str, within: float = PATIENCE) -> float:
    """Wait for a number of `/metrics`, by a pattern of its name and labels."""
    until = time.monotonic() + within
    while not (found := re.search(rf"^{name} (\S+)$", told := client.get("/metrics").text, flags=re.MULTILINE)):
        assert time.monotonic() < until, told
        time.sleep(0.1)
    return float(found[1])


def require_one_trace(spans: dict[str, Span], job: dict[str, Any]) -> None:
    """Find the attempt at the job below the request that asked for it, and that below who sent the request."""
    (attempt,) = [span for span in spans.values() if span.name == f"job {job['kind']}"]
    assert {item.key: item.value.string_value or item.value.int_value for item in attempt.attributes} == {
        "servotune.job.id": job["id"],
        "servotune.job.kind": job["kind"],
        "servotune.job.attempt": 1,
        "servotune.job.status": "succeeded",
        "servotune.request.id": "asked-for-it",
    }
    above = attempt
    while (parent := above.parent_span_id.hex()) != CALLER:
        above = spans[parent]
    assert above.kind == Span.SPAN_KIND_SERVER
    assert above.name.startswith("POST /v1/datasets")


def test_the_first_key_is_printed_once_and_kept_only_as_a_hash(tmp_path) -> None:
    with served(tmp_path, "--no-worker") as (_, client):
        (key,) = re.findall(r"st_[\w-]{40,}", (tmp_path / "log.txt").read_text())
        client.headers["Authorization"] = f"Bearer {key}"
        assert client.get("/v1/systems").status_code == 200
        assert client.get("/readyz").json()["checks"]["worker"] == "absent"
    stored = b"".join(path.read_bytes() for path in tmp_path.glob("served.db*"))
    assert key.encode() not in stored
    with served(tmp_path, "--no-worker") as (_, client):
        assert "st_" not in (tmp_path / "log.txt").read_text()
        client.headers["Authorization"] = f"Bearer {key}"
        assert client.get("/v1/systems").status_code == 200


def test_the_worker_ends_with_a_killed_service(tmp_path) -> None:
    with served(tmp_path, bootstrap_key=KEY) as (process, _):
        children = subprocess.run(["pgrep", "-P", str(process.pid)], capture_output=True, text=True, check=True)
        (worker,) = [int(child) for child in children.stdout.split()]
        process.kill()
        process.wait()
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until and Path(f"/proc/{worker}").exists():
            time.sleep(0.1)
        assert not Path(f"/proc/{worker}").exists()


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"database_url": "oracle://x"}, "sqlite or postgresql"),
        ({"bootstrap_key": "short"}, "SERVOTUNE_BOOTSTRAP_KEY must have at least 16 characters, got 5"),
        ({"body_limit": "much"}, "SERVOTUNE_BODY_LIMIT must be a whole number, got 'much'"),
        ({"oidc_roles": "admins"}, "SERVOTUNE_OIDC_ROLES must be JSON"),
        ({"webhook_networks": '["lab"]'}, "SERVOTUNE_WEBHOOK_NETWORKS/0 must be an IP network, got 'lab'\n"),
        ({"log_format": "yaml"}, "SERVOTUNE_LOG_FORMAT must be 'text' or 'json', got 'yaml'"),
        ({"database_url": "postgresql+psycopg://nobody@127.0.0.1:1/none"}, "must be reachable"),
    ],
)
def test_wrong_settings_end_with_a_sentence(tmp_path, settings, says) -> None:
    environment = {"SERVOTUNE_DATABASE_URL": f"sqlite:///{tmp_path / 'x.db'}"}
    environment |= {f"SERVOTUNE_{name.upper()}": value for name, value in settings.items()}
    command = [sys.executable, "-m", "servotune", "serve", "--no-worker", "--port", str(free_port())]
    done = subprocess.run(
        command, env=os.environ | environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode != 0
    assert says in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("command", [["serve", "--no-worker"], ["worker"]])
def test_what_a_process_ends_with_is_a_line_of_its_log(command) -> None:
    environment = {"SERVOTUNE_LOG_FORMAT": "json", "SERVOTUNE_LOG_LEVEL": "loud"}
    done = subprocess.run(
        [sys.executable, "-m", "servotune", *command],
        env=os.environ | environment, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    (line,) = map(json.loads, done.stderr.splitlines())
    assert (line["level"], line["message"][:24]) == ("critical", "SERVOTUNE_LOG_LEVEL must")


@pytest.mark.parametrize(
    ("command", "arguments", "says"),
    [
        (serve, ["--port", "99999"], "argument --port: must be a whole number from 0 to 65535, got '99999'"),
        (serve, ["--port", "http"], "argument --port: must be a whole number from 0 to 65535, got 'http'"),
        (serve, ["--processes", "0"], "argument --processes: must be a whole number from 1 to 64, got '0'"),
        (worker, ["--slots", "0"], "argument --slots: must be a whole number from 1 to 1024, got '0'"),
    ],
)
def test_wrong_arguments_end_with_a_sentence(capsys, command, arguments, says) -> None:
    with pytest.raises(SystemExit):
        command(arguments)
    assert says in capsys.readouterr().err


def test_openapi_is_printed(capsys) -> None:
    assert openapi([]) == 0
    assert '"openapi": "3.1.0"' in capsys.readouterr().out


def test_no_secret_gets_into_the_most_talkative_log(tmp_path, postgres_url, postgres_template) -> None:
    password = "the-password-of-the-database"
    url = postgres.create_database(postgres_url, "talkative", template=postgres_template)
    with_password = url.replace("postgres@/", f"postgres:{password}@/")
    log = tmp_path / "log.txt"
    with served(tmp_path, "--no-worker", database=with_password, bootstrap_key=KEY, log_level="debug") as (_, client):
        made = client.post("/v1/keys", json={"name": "x", "scopes": ["read"]}, headers={"Idempotency-Key": "once"})
        signed_in = client.post("/v1/session")
        ticket = client.post("/v1/tickets").json()["ticket"]
        with connect(f"ws://127.0.0.1:{client.base_url.port}/v1/live?ticket={ticket}", proxy=None) as page:
            page.send("{")
            page.recv(timeout=PATIENCE)
        client.post("/v1/systems", json={"name": "a-name-nobody-else-reads"})
        client.post("/v1/systems", json=LAG | {"name": "a-name-nobody-else-reads"})
        client.get("/v1/nothing", headers={"Authorization": "Bearer st_a_wrong_key"})
        secrets = [KEY, password, made.json()["key"], signed_in.cookies["servotune_sign_in"], ticket]
        secrets += [signed_in.json()["csrf_token"], "st_a_wrong_key", "a-name-nobody-else-reads"]
        secrets += [hashlib.sha256(secret.encode()).hexdigest() for secret in secrets]
    written = log.read_text()
    assert "POST /v1/keys" in written  # it was talkative
    assert "/v1/live?ticket=..." in written
    assert "Traceback" not in written
    assert [secret for secret in secrets if secret in written] == []
    postgres.drop_database(postgres_url, "talkative")
