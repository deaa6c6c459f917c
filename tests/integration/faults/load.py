"""Clients that ask as long as they are let, and remember what they were answered; workers as processes of their own."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import httpx

from tests.support.desk import COMPUTE

WORK = """
import logging, sys, threading
from storage import processes
from storage.jobs.worker import Worker
logging.basicConfig(level=logging.INFO, format="%(asctime)s %(process)d %(name)s: %(message)s")
if sys.argv[5] == "elsewhere":
    processes.this_process = lambda: None
Worker(sys.argv[1], compute=sys.argv[2], slots=int(sys.argv[3]), heartbeat=float(sys.argv[4])).run(threading.Event())
"""


def start_worker(
    url: str,
    *,
    slots: int = 1,
    log: Path | None = None,
    compute: str = COMPUTE,
    heartbeat: float = 0.2,
    elsewhere: bool = False,
) -> subprocess.Popen[bytes]:
    """Start a worker, by default one whose heart beats so fast that it is missed after two seconds.

    One ``elsewhere`` is as if on another machine: nobody can look whether its process exists.
    """
    command = [sys.executable, "-c", WORK, url, compute, str(slots), str(heartbeat)]
    with (log or Path("/dev/null")).open("ab") as written:
        return subprocess.Popen([*command, "elsewhere" if elsewhere else "here"], stderr=written)


@contextmanager
def workers(
    url: str, count: int, *, log: Path | None = None, heartbeat: float = 0.2
) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Run workers until the end."""
    running = [start_worker(url, log=log, heartbeat=heartbeat) for _ in range(count)]
    try:
        yield running
    finally:
        for worker in running:
            worker.kill()
            worker.wait()


@dataclass
class Load:
    """Threads that each do ``work(client, number)`` again and again; number counts what all of them do."""

    connect: Callable[[], httpx.Client]
    work: Callable[[httpx.Client, int], httpx.Response]
    threads: int
    statuses: Counter[int] = field(default_factory=Counter)
    cut_off: int = 0
    texts: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._number = 0
        self._threads = [threading.Thread(target=self._run) for _ in range(self.threads)]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()

    @property
    def done(self) -> int:
        """How many answers there were."""
        return sum(self.statuses.values())

    def wait(self, count: int, timeout: float = 60.0) -> None:
        """Wait for so many more answers."""
        until, wanted = time.monotonic() + timeout, self.done + count
        while self.done < wanted:
            assert time.monotonic() < until, f"{self.done} of {wanted} answers: {self.statuses}, {self.cut_off} cut off"
            time.sleep(0.01)

    def _run(self) -> None:
        with self.connect() as client:
            while not self._stop.is_set():
                with self._lock:
                    self._number += 1
                    number = self._number
                try:
                    reply = self.work(client, number)
                except httpx.TransportError:
                    self.cut_off += 1
                    time.sleep(0.02)
                    continue
                with self._lock:
                    self.statuses[reply.status_code] += 1
                    if reply.status_code >= 500:
                        self.texts.append(reply.text)


def summed(statuses: Counter[int], *expected: int) -> dict[int, int]:
    """Return the answers that were none of those expected."""
    return {status: count for status, count in statuses.items() if status not in expected}


Document = dict[str, Any]
