"""What the workers of the benchmark compute."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from storage.jobs.compute import ComputeJob, Reporter


def run(job: ComputeJob, reporter: Reporter) -> Mapping[str, Any]:
    """Do nothing; or spend ``work`` seconds of processor time."""
    until = time.thread_time() + job.body.get("work", 0.0)
    while time.thread_time() < until:
        reporter.progress(0.5)
    return {}
