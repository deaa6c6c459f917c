"""The service as a process of its own, as people run it."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx

KEY = "a-key-of-the-benchmark"


@contextmanager
def serving(database: str, log: Path, *, processes: int = 1) -> Iterator[str]:
    """Run the service without a worker; give its address."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = int(listener.getsockname()[1])
    environment = os.environ | {
        "SERVOTUNE_DATABASE_URL": database, "SERVOTUNE_BOOTSTRAP_KEY": KEY, "SERVOTUNE_REQUESTS_PER_MINUTE": "0",
    }  # fmt: skip
    command = [
        sys.executable,
        "-m",
        "servotune",
        "serve",
        "--no-worker",
        "--port",
        str(port),
        "--processes",
        str(processes),
    ]
    with log.open("w") as written:
        process = subprocess.Popen(command, env=environment, stdout=written, stderr=written)  # noqa: S603 - our own
    try:
        while True:
            try:
                if httpx.get(f"http://127.0.0.1:{port}/readyz", trust_env=False).status_code == 200:
                    break
            except httpx.TransportError:
                assert process.poll() is None, log.read_text()
                time.sleep(0.1)
        yield f"http://127.0.0.1:{port}"
    finally:
        process.terminate()
        process.wait()
