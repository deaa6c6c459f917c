"""What a process of its own computes for one large request, and ends: its memory is given back, and it can be killed."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from api.problems.documents import Problem
from api.problems.exceptions import KNOWN, problem_of
from api.processes.worker import bound_memory, installed, opened, prepare
from api.services.jobs.computing import REFUSED
from api.services.studies.results import with_text
from api.services.studies.studied import STUDIES
from api.settings import Settings
from storage.jobs.compute import ComputeJob, Reporter

__all__ = ["prepare", "run"]

#: How much less of the machine it gets than whoever answers the others.
_NICE = 10


def run(job: ComputeJob, _: Reporter) -> Mapping[str, Any]:
    """Compute a study: ``{"study": Study}``, or ``{"refused": Problem}``."""
    settings: Settings = job.body["settings"]
    os.nice(_NICE)
    limit = bound_memory(settings.request_memory)
    with opened(job.database_url) as database:
        service = installed(database, settings)
        try:
            request = job.body["model"].model_validate(job.body["request"])
            study = with_text(STUDIES[job.kind](service, job.body["caller"], request))
        except MemoryError:
            detail = (
                f"a request must need at most {limit} bytes of memory (SERVOTUNE_REQUEST_MEMORY), got one that needs "
                "more: ask for less at a time"
            )
            return {REFUSED: Problem(422, "too-large", detail)}
        except KNOWN as error:
            return {REFUSED: problem_of(error)}
    # What is not kept travels as the text that is sent, and only so.
    return {"study": study if job.body["kept"] else replace(study, body={})}
