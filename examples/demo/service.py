"""A service of our own on a free port, with an empty database: started before the first step, stopped after the last."""

from __future__ import annotations

import os
import secrets
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import servotune
from examples.demo.findings import DemoError

STARTS_WITHIN = 60.0
STOPS_WITHIN = 10.0


@contextmanager
def own_service(folder: Path) -> Iterator[servotune.Client]:
    """Start `servotune serve`, give a client of it, and stop it again.

    Raises
    ------
    DemoError
        It did not become ready; the last lines of its log say why.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("demo.db*"):
        old.unlink()
    key, port = secrets.token_urlsafe(24), _free_port()
    settings = {
        "SERVOTUNE_DATABASE_URL": f"sqlite:///{(folder / 'demo.db').resolve()}",
        "SERVOTUNE_BOOTSTRAP_KEY": key,
        "SERVOTUNE_WORKER_SLOTS": str(os.cpu_count() or 1),
    }
    log = folder / "service.log"
    command = [sys.executable, "-m", "servotune", "serve", "--host", "127.0.0.1", "--port", str(port)]
    with log.open("wb") as output:
        process = subprocess.Popen(  # noqa: S603 -- our own command, no shell
            command, env=os.environ | settings, stdout=output, stderr=subprocess.STDOUT
        )
        try:
            with _client_when_ready(process, f"http://127.0.0.1:{port}", key, log) as client:
                yield client
        finally:
            _stop(process)


def _client_when_ready(process: subprocess.Popen[bytes], url: str, key: str, log: Path) -> servotune.Client:
    waited = 0.0
    while process.poll() is None and waited < STARTS_WITHIN:
        try:
            return servotune.connect(url, key=key, wait=1.0)
        except servotune.ServiceUnreachableError:
            waited += 1.0
    what = "is not ready after 60 s" if process.poll() is None else f"ended with exit code {process.returncode}"
    last = log.read_text(errors="replace").strip().splitlines()[-1:] or ["(no output)"]
    raise DemoError(f"The service {what}: {last[0]} (all of it in {log}).")


def _stop(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(STOPS_WITHIN)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
