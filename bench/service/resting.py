"""What workers that have nothing to do cost the database: processor time of Postgres for each second."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path

from bench.service.workers import Desk, working

_TICK = os.sysconf("SC_CLK_TCK")


def resting(url: str, *, workers: int, seconds: float) -> float:
    """Return the cores that Postgres is busy with while so many workers wait for a job."""
    desk = Desk(url)
    try:
        with working(desk, url, workers):
            time.sleep(5.0)  # in which the last one has done what a worker does once
            begun, before = time.perf_counter(), _spent()
            time.sleep(seconds)
            return (_spent() - before) / (time.perf_counter() - begun)
    finally:
        desk.close()


def _spent() -> float:
    """Return the processor time (s) of every Postgres process that is a descendant of this one, ended ones included."""
    names = subprocess.run(["pgrep", "-x", "postgres"], check=False, capture_output=True, text=True).stdout.split()  # noqa: S607
    total = 0.0
    for pid in names:
        try:
            fields = (Path("/proc") / pid / "stat").read_text().rpartition(")")[2].split()
        except FileNotFoundError:
            continue
        parent = (Path("/proc") / fields[1] / "comm").read_text().strip()
        own = int(fields[11]) + int(fields[12])
        ended = 0 if parent == "postgres" else int(fields[13]) + int(fields[14])  # those of the postmaster alone
        total += (own + ended) / _TICK
    return total
