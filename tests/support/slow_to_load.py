"""A compute function whose module takes longer to load than its jobs may take."""

from __future__ import annotations

import time
from typing import Any

from storage.jobs.compute import ComputeJob, Reporter

LOADING = 3.0


def prepare() -> None:
    time.sleep(LOADING)


def run(job: ComputeJob, reporter: Reporter) -> dict[str, Any]:
    reporter.message("computes")
    return {"kind": job.kind}
