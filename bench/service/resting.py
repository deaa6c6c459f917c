"""What workers that have nothing to do cost the database: processor time of Postgres for each second."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path

from bench.service.workers import Desk, working

_TICK = os.sysconf("SC_CLK_TCK")


def resting(url: str, *, workers: int, seconds: float) -> float:
    """Return the cores that Postgres is busy with while so many workers wait for a job."""
    desk = Desk(url)
    try:
        with working(desk, url, workers):
            time.sleep(20.0)  # in which the last one has done what a worker does once
            begun, before = time.perf_counter(), _spent()
            time.sleep(seconds)
            return (_spent() - before) / (time.perf_counter() - begun)
    finally:
        desk.close()


def _spent() -> float:
    """Return the processor time (s) of every Postgres process that is a descendant of this one, ended ones included."""
    found = dict(filter(None, map(_read, Path("/proc").glob("[0-9]*/stat"))))
    total = 0.0
    for number, (name, fields) in found.items():
        if name == "postgres" and os.getpid() in _ancestors(found, number):
            parent, _ = found.get(int(fields[1]), ("", []))
            own = int(fields[11]) + int(fields[12])
            ended = 0 if parent == "postgres" else int(fields[13]) + int(fields[14])  # those of the postmaster alone
            total += (own + ended) / _TICK
    return total


def _read(path: Path) -> tuple[int, tuple[str, list[str]]] | None:
    try:
        head, _, rest = path.read_text().rpartition(")")
    except OSError:
        return None
    number, _, name = head.partition(" (")
    return int(number), (name, rest.split())


def _ancestors(found: dict[int, tuple[str, list[str]]], number: int) -> Iterator[int]:
    while number in found:
        number = int(found[number][1][1])
        yield number
