"""What the workers of the benchmark compute."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from storage.jobs.compute import ComputeJob, Parts, Reporter


def run(job: ComputeJob, reporter: Reporter) -> Mapping[str, Any] | Parts:
    """Do nothing; or spend ``work`` seconds of processor time in each of ``count`` parts."""
    if job.kind == "nothing":
        return {}
    if "part" not in job.body:
        return {"parts": len(job.parts)} if job.parts else Parts(documents=[{}] * job.body["count"])
    until = time.thread_time() + job.body["work"]
    while time.thread_time() < until:
        reporter.progress(0.5)
    return {}
