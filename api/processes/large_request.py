"""What a process of its own computes for one large request, and ends: its memory is given back, and it can be killed.

A large study, or a report: that loads what draws and what writes pages, and no other request waits for that.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from api.problems.documents import Problem
from api.problems.exceptions import KNOWN, problem_of
from api.processes.memory import bound_memory
from api.processes.worker import installed, opened
from api.processes.worker import prepare as prepare_to_compute
from api.services.jobs.computing import REFUSED, Computing
from api.services.operation.app_context import Installation
from api.services.reports import reports
from api.services.studies.results import with_text
from api.services.studies.studied import STUDIES
from api.settings import Settings
from storage.jobs.compute import ComputeJob, Reporter
from storage.jobs.zygote import Later
from storage.session import Database

#: How much less of the machine it gets than whoever answers the others.
_NICE = 10
#: What it may take on the clock (s) is for whoever waits for it to say, how much it may compute for `bound_computing`.
_UNHURRIED_S = 1e6


def prepare() -> Later | None:
    """Load what a worker loads, and what reports are written with: each of them would load it anew, a second or two."""
    later = prepare_to_compute()
    reports.warm()
    return later


def run(job: ComputeJob, _: Reporter) -> Mapping[str, Any]:
    """Compute ``{"study": Study}`` or ``{"report": bytes}``, or say ``{"refused": Problem}``."""
    settings: Settings = job.body["settings"]
    os.nice(_NICE)
    bound_computing(settings.request_seconds)
    limit = bound_memory(settings.request_memory)
    with opened(job.database_url) as database:
        try:
            return _report(job, database) if job.kind == reports.KIND else _study(job, database)
        except MemoryError:
            detail = (
                f"a request must need at most {limit} bytes of memory (SERVOTUNE_REQUEST_MEMORY), got one that needs "
                "more: ask for less at a time"
            )
            return {REFUSED: Problem(422, "too-large", detail)}
        except KNOWN as error:
            return {REFUSED: problem_of(error)}


def bound_computing(seconds: float) -> None:
    """Let the kernel end this process, in compiled code too, when it has computed for so long; what it waits for does not count."""
    signal.setitimer(signal.ITIMER_PROF, seconds)


def unhurried(service: Installation) -> Installation:
    """Return a service that looks at no clock: what a busy machine lets this process wait is no computing of its own."""
    settings = service.settings.model_copy(update={"request_seconds": _UNHURRIED_S})
    return replace(service, computing=Computing(settings))


def _report(job: ComputeJob, database: Database) -> Mapping[str, Any]:
    return {"report": reports.written(database, job.workspace_id, **job.body["wanted"])}


def _study(job: ComputeJob, database: Database) -> Mapping[str, Any]:
    service = unhurried(installed(database, job.body["settings"]))
    request = job.body["model"].model_validate(job.body["request"])
    study = with_text(STUDIES[job.kind](service, job.body["caller"], request))
    # What is not kept travels as the text that is sent, and only so.
    return {"study": study if job.body["kept"] else replace(study, body={})}
