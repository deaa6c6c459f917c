"""A job that needs more memory than it may have ends with a sentence, and its worker goes on; answered errors hold nothing."""

from __future__ import annotations

import gc
import json
import os
import subprocess
import sys

import pytest

from tests.integration.api.documents import LAG

# What a child of a worker does, with a job that allocates as much as it is told to.
CHILD = """
import json, sys
import numpy as np
from api.processes import worker
from storage.jobs.compute import ComputeJob, Refusal

worker._RUN["hungry"] = lambda job, database, reporter: {"sum": float(np.ones(job.body["numbers"]).sum())}
job = ComputeJob(
    id="job_1", kind="hungry", body={"numbers": int(sys.argv[1])}, workspace_id="ws", database_url="sqlite:///x.db"
)
try:
    print(json.dumps(worker.run(job, None)))
except Refusal as refusal:
    print(json.dumps(refusal.problem))
"""


@pytest.mark.parametrize(("numbers", "fits"), [(1_000, True), (300_000_000, False)])
def test_a_job_has_no_more_memory_than_it_may(numbers, fits) -> None:
    environment = os.environ | {"SERVOTUNE_JOB_MEMORY": str(2 << 30), "PYTHONPATH": ":".join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", CHILD, str(numbers)], env=environment, capture_output=True, text=True, check=True
    )
    said = json.loads(done.stdout)
    if fits:
        assert said.pop("versions").keys() == {"numpy", "scipy", "servotune"}
        assert said == {"sum": 1000.0}
    else:
        assert said["type"] == "urn:servotune:problem:too-large"
        assert said["detail"] == (
            "a job must need at most 2147483648 bytes of memory (SERVOTUNE_JOB_MEMORY), got one that needs more"
        )


#: Bodies that are refused while they are parsed, by their schema, and by what computes.
REFUSED = [
    '{"marked": [[1]], "marked": [[2]]}',
    '{"marked": [[1]]}',
    json.dumps({"system": LAG | {"outputs": {"marked": "nowhere"}}, "input": {"port": "u", "signal": {"kind": "step"}}}),
]  # fmt: skip


@pytest.mark.parametrize("body", REFUSED)
def test_an_answered_error_does_not_hold_its_document(sqlite_service, body) -> None:
    """Errors and the frames that they have passed hold each other: documents stayed until the next full collection."""
    headers = {"Content-Type": "application/json"}
    with sqlite_service.client() as client:
        client.post("/v1/simulations", content=body, headers=headers)  # what is loaded with the first one is loaded
        gc.collect()
        gc.disable()
        try:
            for _ in range(3):
                assert client.post("/v1/simulations", content=body, headers=headers).status_code == 422
            client.get("/healthz")  # the answer before has left
            held = [one for one in gc.get_objects() if type(one) is dict and "marked" in one]
        finally:
            gc.enable()
    assert held == []
