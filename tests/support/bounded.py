"""What a process of its own does in tests of its limit: computes, or waits, longer than it may compute."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from api.processes.large_request import bound_computing
from storage.jobs.compute import ComputeJob, Reporter


def run(job: ComputeJob, _: Reporter) -> Mapping[str, Any]:
    """Wait, or compute until somebody ends it."""
    bound_computing(job.body["seconds"])
    if job.kind == "waiting":
        time.sleep(1.5 * job.body["seconds"])
    while job.kind == "computing":
        sum(range(100_000))
    return {"done": job.kind}
