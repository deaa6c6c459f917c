"""What others wait, and what memory it takes, beside whoever asks for too much: told in the report of `make faults`.

The times are those of a machine at rest; `alone` is what the same questions take there with nobody beside.
"""

from __future__ import annotations

import hashlib
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from bench.service.process import serving as process
from tests.integration.api.conftest import Service, asked, make_keys, working
from tests.integration.api.documents import LAG, RAW, chain, sha256
from tests.integration.faults.conftest import FULL

pytestmark = pytest.mark.skipif(not FULL, reason="times on a machine at rest: make faults")

COMMAND: dict[str, Any] = {"input": {"port": "u", "signal": {"kind": "step"}}}
#: How long (s) there is abuse at least, how long nobody beside, and when what was taken must have been given back.
ABUSED, ALONE, GIVEN_BACK = 30.0, 5.0, 60.0
SEGMENT = 8 << 20


def many(service: Service, enough: threading.Event, *, count: int, body: dict[str, Any]) -> None:
    """Ask for much at once, and leave."""
    with ExitStack() as open_ones:
        for _ in range(count):
            open_ones.enter_context(closing(asked(service, body)))
        enough.wait()


def repeated_keys(service: Service, enough: threading.Event) -> None:
    """Send a body of 5 MB with repeated keys, again and again."""
    members = ",".join(f'"k{i % 99_000:06}": {i:030}'.replace(": 0", ": 1") for i in range(120_000))
    body = f"{{{members}}}".encode()
    assert len(body) > 5e6
    with service.client() as client:
        while not enough.is_set():
            reply = client.post("/v1/simulations", content=body, headers={"Content-Type": "application/json"})
            assert reply.status_code in {400, 413, 422}, reply.text


def samples(segments: int) -> Iterator[bytes]:
    """Yield raw samples of two channels, which compress as little as measured ones do."""
    noise = np.random.default_rng(3).normal(size=SEGMENT // 8).astype("<f8")
    for number in range(segments):
        yield (noise + number).tobytes()


def upload(service: Service, segments: int) -> str:
    """Send a recording; return where it is once a worker has read it."""
    with service.client() as client:
        client.timeout = httpx.Timeout(None)  # who sends so much has patience: the last request reads all of it
        where = client.post("/v1/datasets", json=RAW).headers["Location"]
        sent, whole = [], hashlib.sha256()
        for piece in samples(segments):
            whole.update(piece)
            sent.append(sha256(piece))
            assert client.put(f"{where}/segments/{sent[-1]}", content=piece).status_code == 201
        reply = client.post(f"{where}/commit", json={"segments": sent, "sha256": whole.hexdigest()})
        assert reply.status_code == 202, reply.text
        while (found := client.get(where).json())["status"] == "parsing":
            time.sleep(0.2)
        assert found["status"] == "ready", found
    return where


def export(service: Service, enough: threading.Event, *, where: str, form: str) -> None:
    """Take a recording out as a file, as quickly as it comes."""
    url = httpx.URL(service.url)
    head = f"GET {where}/export?format={form} HTTP/1.1\r\nHost: {url.host}\r\nConnection: close\r\n"
    with socket.create_connection((url.host, url.port)) as connection:
        connection.sendall(f"{head}Authorization: Bearer {service.keys['admin']}\r\n\r\n".encode())
        first = connection.recv(1 << 20)
        assert first.startswith(b"HTTP/1.1 200"), first[:200]
        taken = len(first)
        while piece := connection.recv(1 << 20):
            taken += len(piece)
            if form == "csv" and taken > 2 << 30:  # text is longer than the samples are
                break
    assert taken > 1e9
    enough.wait()


@dataclass
class Watched:
    """Whoever asks for little, in another workspace: how long it takes, and how large the service becomes."""

    service: Service
    small: list[float] = field(default_factory=list)
    ready: list[float] = field(default_factory=list)
    resident: list[float] = field(default_factory=list)

    def watch(self, still: Callable[[], bool]) -> None:
        """Ask one after the other, for as long as ``still`` says."""
        with self.service.client("stranger") as client:
            while still():
                self.small.append(timed(lambda: client.post("/v1/simulations", json={"system": LAG, **COMMAND})))
                self.ready.append(timed(lambda: client.get("/readyz")))
                self.resident.append(resident_mib(self.service.url))

    def told(self) -> dict[str, float]:
        """Return what 99 of 100 were answered within (s)."""
        return {name: float(np.quantile(getattr(self, name), 0.99)) for name in ("small", "ready")}


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


def beside(service: Service, abuse: Callable[[Service, threading.Event], None]) -> dict[str, float]:
    """Return what others wait alone and beside abuse, and the memory of the service (MiB) before, during and after it."""

    def lasts(seconds: float) -> Callable[[], bool]:
        until = time.monotonic() + seconds
        return lambda: time.monotonic() < until

    Watched(service).watch(lasts(1.0))  # what is loaded with the first ones is loaded
    alone, abused, after = Watched(service), Watched(service), Watched(service)
    alone.watch(lasts(ALONE))
    enough = threading.Event()
    with ThreadPoolExecutor(1) as apart:
        over = apart.submit(abuse, service, enough)
        began = lasts(ABUSED)
        try:
            abused.watch(lambda: began() or not (over.done() or enough.set()))
        finally:
            enough.set()
        over.result()
    told = {f"{name} alone": value for name, value in alone.told().items()} | abused.told()
    until = time.monotonic() + GIVEN_BACK
    while resident_mib(service.url) > 1.3 * max(alone.resident) and time.monotonic() < until:
        time.sleep(1.0)
    after.watch(lasts(1.0))
    return told | {
        "MiB before": max(alone.resident), "MiB at the peak": max(abused.resident), "MiB after": max(after.resident)
    }  # fmt: skip


ABUSE: dict[str, Callable[[Service, threading.Event], None]] = {
    "twelve chains of 180 states": lambda *at: many(*at, count=12, body={"system": chain(90), **COMMAND}),
    "45 slow simulations": lambda *at: many(
        *at, count=45, body={"system": chain(60), **COMMAND, "variants": [{}] * 10}
    ),
    "a body of 5 MB with repeated keys": repeated_keys,
    "an upload of 2 GB": lambda service, _: bool(upload(service, 256)) and None,
}


@contextmanager
def running(database_url: str, folder: Path) -> Iterator[Service]:
    """The service as people run it, with a worker."""
    with process(database_url, folder / "service.txt") as url, working(database_url):
        yield Service(url=url, database_url=database_url, keys=make_keys(database_url))


Told = Callable[[str, object], None]


def judged(told: dict[str, float], what: str, record: Told) -> None:
    for name, value in told.items():
        record(f"{what}: {name}", round(value, 3))
    assert told["small"] <= 0.5
    assert told["ready"] <= 0.1
    assert told["MiB after"] <= 1.3 * told["MiB before"]


@pytest.mark.parametrize("what", ABUSE)
def test_a_small_simulation_of_another_workspace_waits_for_nobody(
    database_url: str, tmp_path: Path, what: str, record_testsuite_property: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    if what.startswith("a body"):
        monkeypatch.setenv("SERVOTUNE_BODY_LIMIT", str(8 << 20))  # by default it is refused unread
    with running(database_url, tmp_path) as service:
        judged(beside(service, ABUSE[what]), what, record_testsuite_property)


@pytest.mark.parametrize("form", ["csv", "mat", "parquet", "hdf5"])
def test_an_export_of_1_gb_slows_nobody(
    database_url: str, tmp_path: Path, form: str, record_testsuite_property: Told
) -> None:
    with running(database_url, tmp_path) as service:
        where = upload(service, 160 if form == "hdf5" else 128)  # HDF5 leaves compressed, to four fifths

        def abuse(service: Service, enough: threading.Event) -> None:
            export(service, enough, where=where, form=form)

        judged(beside(service, abuse), f"an export of 1 GB as {form}", record_testsuite_property)
