"""A real server that speaks S3 (moto's), as a process of its own, and a door in front of it at which something may go wrong."""

from __future__ import annotations

import http.client
import os
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from storage.objects import ObjectStore
from tests.support.patience import PATIENCE

BUCKET = "blobs"
STATUSES = {"full": 507, "busy": 503, "closed": 403}


class Door:
    """What passes to the store, and what goes wrong with it.

    ``fault`` is "" (nothing), "away", "slow" (no answer), "wrong" (other bytes), or one of `STATUSES`; it befalls the requests of
    ``methods`` after the first ``spared`` of them.
    """

    def __init__(self, port: int) -> None:
        self.port = port
        self.befall("")
        self.mended = threading.Event()

    def befall(self, fault: str, *, methods: tuple[str, ...] = ("PUT", "GET", "POST"), spared: int = 0) -> None:
        self.fault, self.methods, self.spared = fault, methods, spared
        self.struck = threading.Event()
        self._lock = threading.Lock()

    def strikes(self, method: str) -> str:
        with self._lock:
            if not self.fault or method not in self.methods:
                return ""
            self.spared -= 1
            if self.spared >= 0:
                return ""
            self.struck.set()
            return self.fault


@contextmanager
def object_store(monkeypatch: pytest.MonkeyPatch) -> Iterator[Door]:
    """Run a store with one empty bucket, which this process and its children reach through a door."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    server = subprocess.Popen(
        [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={key: value for key, value in os.environ.items() if not key.startswith("AWS_")},
    )
    try:
        _make_bucket(server, port)
        door = Door(port)
        front = ThreadingHTTPServer(("127.0.0.1", 0), _handler(door))
        front.daemon_threads = True
        thread = threading.Thread(target=front.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True)
        thread.start()
        for name, value in {
            "AWS_ENDPOINT_URL": f"http://127.0.0.1:{front.server_port}",
            "AWS_ACCESS_KEY_ID": "somebody",
            "AWS_SECRET_ACCESS_KEY": "a secret",
            "AWS_REGION": "us-east-1",
        }.items():
            monkeypatch.setenv(name, value)
        try:
            yield door
        finally:
            door.mended.set()
            front.shutdown()
            thread.join(timeout=PATIENCE)
            front.server_close()
    finally:
        server.kill()
        server.wait()


def opened(*, preferred: bool = True) -> ObjectStore:
    return ObjectStore(f"s3://{BUCKET}/of/one", preferred=preferred)


def _make_bucket(server: subprocess.Popen[bytes], port: int) -> None:
    give_up_at = time.monotonic() + PATIENCE
    while True:
        try:
            request = urllib.request.Request(f"http://127.0.0.1:{port}/{BUCKET}", method="PUT")
            urllib.request.urlopen(request).close()
        except OSError:
            assert server.poll() is None, "the store ended"
            assert time.monotonic() < give_up_at, "the store does not start"
            time.sleep(0.05)
        else:
            return


def _handler(door: Door) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def _pass(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
            fault = door.strikes(self.command)
            if fault == "away":
                self.close_connection = True
                return
            if fault == "slow":
                door.mended.wait(60)
                self.close_connection = True
                return
            if fault in STATUSES:
                self._answer(STATUSES[fault], {}, b"<Error/>")
                return
            behind = http.client.HTTPConnection("127.0.0.1", door.port, timeout=60)
            behind.request(self.command, self.path, body, dict(self.headers.items()))
            reply = behind.getresponse()
            content = reply.read()
            behind.close()
            if fault == "wrong":
                content = bytes([content[0] ^ 1]) + content[1:]
            self._answer(reply.status, dict(reply.getheaders()), content)

        do_GET = do_PUT = do_POST = do_HEAD = do_DELETE = _pass  # noqa: N815 - the names that are called

        def _answer(self, status: int, headers: dict[str, str], content: bytes) -> None:
            self.send_response_only(status)
            kept = {"connection", "content-length", "transfer-encoding", "server"}
            for name, value in headers.items():
                if name.lower() not in kept:
                    self.send_header(name, value)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: object) -> None:
            """Stay quiet."""

    return Handler
