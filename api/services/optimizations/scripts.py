"""A finished or running optimisation as a script of its own, which repeats it through the client library."""

from __future__ import annotations

import json
import pprint
from typing import Any

from sqlalchemy.orm import Session

from api.problems.documents import Problem
from api.services.operation.app_context import Caller
from api.services.optimizations.optimizations import KIND
from storage.models import Job
from storage.repositories import JobRepository, ResultRepository

_TEMPLATE = '''\
"""Repeats optimisation {identifier} of {date} through the client library.

Set SERVOTUNE_URL and SERVOTUNE_KEY, or edit the call of `connect` below. {versions}
"""

import os

import servotune

REQUEST = {request}

EXPECTED = {expected}
"""What the job found, None while it has found nothing."""


def main() -> int:
    url = os.environ.get("SERVOTUNE_URL", "http://127.0.0.1:8000")
    with servotune.connect(url, key=os.environ.get("SERVOTUNE_KEY")) as client:
        result = client.optimize(**REQUEST).wait()
    print(result["status"], "-", result["advice"])
    for name, value in result["best"].items():
        before = "" if EXPECTED is None else f"   (then {{EXPECTED['best'].get(name)}})"
        print(f"  {{name}} = {{value:.10g}}{{before}}")
    print("certificate:", "valid" if result["certificate"]["valid"] else "refused")
    if EXPECTED is None:
        return 0
    same = result["status"] == EXPECTED["status"] and all(
        abs(result["best"][name] - value) <= 1e-6 * max(abs(value), 1e-300) for name, value in EXPECTED["best"].items()
    )
    print("the same as then" if same else "NOT the same as then")
    return 0 if same else 1


if __name__ == "__main__":
    raise SystemExit(main())
'''


def script_of(session: Session, caller: Caller, identifier: str) -> str:
    """Return the script of an optimisation.

    Raises
    ------
    api.problems.documents.Problem
        409 for a job of another kind.
    """
    job = JobRepository(session, caller.workspace).get(identifier)
    if job.kind != KIND:
        raise Problem(
            409, "no-script", f"job {identifier!r} must be an optimization to have a script, it is {job.kind}"
        )
    expected = None
    if job.result_id is not None:
        results = ResultRepository(session, caller.workspace)
        body = results.body(results.get(job.result_id))
        expected = {"status": body["status"], "best": body["best"], "objective": body.get("objective")}
    return _TEMPLATE.format(
        identifier=job.id, date=job.created_at.date().isoformat(), versions=_about(job), request=_literal(job.body["request"]),
        expected=_literal(expected),
    )  # fmt: skip


def _about(job: Job) -> str:
    reference = job.body.get("system_reference")
    if reference is None:
        return "The system stands in the request."
    return f"The system is written out as it was: {reference['id']}, revision {reference['revision']}."


def _literal(value: Any) -> str:
    """Return a JSON value as Python text that gives it back to the last digit."""
    plain = json.loads(json.dumps(value))
    return pprint.pformat(plain, width=110, sort_dicts=False, compact=True)
