"""Compute functions for the tests of jobs."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from storage.jobs.compute import ComputeJob, Refusal, Reporter


def run(job: ComputeJob, reporter: Reporter) -> Mapping[str, Any]:
    if job.kind in _WHOLE:
        return _WHOLE[job.kind](job, reporter)
    return globals()[job.kind](job.body, reporter)


def square(body: dict[str, Any], reporter: Reporter) -> Mapping[str, Any]:
    """Report five steps, return an array."""
    for step in range(5):
        reporter.progress((step + 1) / 5, f"step {step + 1}")
        time.sleep(body.get("pause", 0.11))
    reporter.message("done")
    values = np.array(body["values"], dtype=np.float64)
    return {"squares": {"values": values**2}, "count": np.int64(len(values)), "process": os.getpid()}


def chatter(body: dict[str, Any], reporter: Reporter) -> Mapping[str, Any]:
    """Report far too often for ``seconds``."""
    end = time.monotonic() + body["seconds"]
    while (left := end - time.monotonic()) > 0:
        reporter.progress(1 - left / body["seconds"])
        reporter.message("busy")
    return {}


def spin(body: dict[str, Any], reporter: Reporter) -> NoReturn:
    """Tell the process id, then compute for ever."""
    reporter.message(str(os.getpid()))
    while True:
        pass


def linger(body: dict[str, Any], reporter: Reporter) -> NoReturn:
    """Tell the process id, then be in hand for ever and leave the processor to others."""
    reporter.message(str(os.getpid()))
    while True:
        time.sleep(3600)


def refuse(body: dict[str, Any], reporter: Reporter) -> NoReturn:
    raise Refusal(type="urn:test:refused", title="Refused", detail="gain must be > 0, got -1", at=["gain"])


def crash(body: dict[str, Any], reporter: Reporter) -> NoReturn:
    raise ZeroDivisionError("a secret of the implementation")


def not_json(body: dict[str, Any], reporter: Reporter) -> Mapping[str, Any]:
    return {"value": float("nan")}


def die(body: dict[str, Any], reporter: Reporter) -> NoReturn:
    os.kill(os.getpid(), body["signal"])
    raise AssertionError("unreachable")


def kill_worker(body: dict[str, Any], reporter: Reporter) -> Mapping[str, Any]:
    """Kill the worker ``times`` times and compute on for ever; succeed when begun once more."""
    log = Path(body["log"])
    with log.open("a") as lines:
        lines.write(f"{os.getpid()}\n")
    if len(log.read_text().splitlines()) > body["times"]:
        return {"done": True}
    zygote = Path(f"/proc/{os.getppid()}/status").read_text()
    worker = next(int(line.split()[1]) for line in zygote.splitlines() if line.startswith("PPid:"))
    os.kill(worker, signal.SIGKILL)
    while True:
        pass


def climb(job: ComputeJob, reporter: Reporter) -> Mapping[str, Any]:
    """Go up step by step, keep every step, and write each into a file; where ``die_at`` is reached, take the worker along."""
    first = 0 if job.state is None else job.state["step"]
    for step in range(first, job.body["steps"]):
        with Path(job.body["log"]).open("a") as lines:
            lines.write(f"{step}\n")
        reporter.keep({"step": step + 1})
        reporter.progress((step + 1) / job.body["steps"])
        while Path(job.body["log"]).with_suffix(".hold").exists():
            time.sleep(0.01)
        time.sleep(job.body.get("pause", 0.0))
    return {"begun_at": first}


_WHOLE = {"climb": climb}
