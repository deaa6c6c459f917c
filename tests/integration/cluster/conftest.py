"""A real Dask cluster: a scheduler and workers as processes of their own, over TLS."""

from __future__ import annotations

import datetime as dt
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from tests.support.desk import wait_for

ROOT = Path(__file__).parents[3]


def certificate(folder: Path) -> dict[str, str]:
    """Write a certificate that signs itself, and its key; return them as Dask's options name them."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "cluster")])
    now = dt.datetime.now(dt.UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - dt.timedelta(hours=1))
        .not_valid_after(now + dt.timedelta(days=1))
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    (folder / "cert.pem").write_bytes(made.public_bytes(serialization.Encoding.PEM))
    (folder / "key.pem").write_bytes(
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    cert = str(folder / "cert.pem")
    return {"tls_ca_file": cert, "tls_client_cert": cert, "tls_client_key": str(folder / "key.pem")}


class DaskCluster:
    """A scheduler and workers that are started one by one."""

    def __init__(self, folder: Path) -> None:
        self.files = certificate(folder)
        self._folder, self._log = folder, (folder / "log").open("wb")
        self._options = [
            "--tls-ca-file", self.files["tls_ca_file"], "--tls-cert", self.files["tls_client_cert"],
            "--tls-key", self.files["tls_client_key"], "--no-dashboard",
        ]  # fmt: skip
        self.processes: list[subprocess.Popen[bytes]] = []
        found = folder / "scheduler.json"
        self.scheduler = self._start(
            "scheduler", "--host", "127.0.0.1", "--port", "0", "--protocol", "tls", "--scheduler-file", str(found)
        )
        wait_for(lambda: _address(found) is not None, "the scheduler")
        self.address = str(_address(found))

    def work(self) -> subprocess.Popen[bytes]:
        """Start another worker."""
        return self._start(
            "worker", self.address, "--nthreads", "1", "--no-nanny", "--host", "127.0.0.1",
            "--local-directory", str(self._folder),
        )  # fmt: skip

    def _start(self, *words: str) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", *words, *self._options],
            cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, stdout=self._log, stderr=self._log,
        )  # fmt: skip
        self.processes.append(process)
        return process

    def close(self) -> None:
        for process in self.processes:
            with suppress(ProcessLookupError):
                process.send_signal(signal.SIGKILL)
            process.wait()
        self._log.close()


def _address(found: Path) -> Any:
    with suppress(FileNotFoundError, json.JSONDecodeError):
        return json.loads(found.read_text())["address"]
    return None


@contextmanager
def two_workers(folder: Path) -> Iterator[DaskCluster]:
    """Run a cluster of two workers."""
    made = DaskCluster(folder)
    try:
        for _ in range(2):
            made.work()
        yield made
    finally:
        made.close()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskCluster]:
    with two_workers(tmp_path_factory.mktemp("cluster")) as made:
        yield made
