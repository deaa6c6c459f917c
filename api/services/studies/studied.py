"""Every study by its kind: what computes it, in a thread or, when it is large, in a process of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

from pydantic import BaseModel
from sqlalchemy.orm import Session

from api.schemas.frfs import FrfRequest
from api.schemas.spectra import SpectrumRequest
from api.schemas.studies import FrequencyRequest, InfluenceRequest, SimulationRequest
from api.services.frequency import frfs, spectra
from api.services.jobs import jobs
from api.services.jobs.computing import LargeError, Recall
from api.services.operation.app_context import Caller, Installation
from api.services.studies import studies
from api.services.studies.results import Study, with_text
from api.services.systems.systems import at_revision, current_revision
from api.services.validations import validations
from storage.jobs.compute import ComputeJob

STUDIES: Mapping[str, Callable[[Installation, Caller, Any], Study]] = {
    "simulation": studies.run_simulation,
    "frequency_response": studies.run_frequency_response,
    "influence": studies.run_influence,
    "spectrum": spectra.run_spectra,
    frfs.KIND: frfs.run_frf,
    validations.KIND: validations.run_validation,
}

#: What a worker reads the requests of its jobs with.
MODELS: Mapping[str, type[BaseModel]] = {
    "simulation": SimulationRequest,
    "frequency_response": FrequencyRequest,
    "influence": InfluenceRequest,
    "spectrum": SpectrumRequest,
    frfs.KIND: FrfRequest,
}


async def proven(service: Installation, caller: Caller, kind: str, request: BaseModel, *, recall: Recall) -> None:
    """Check all that can be checked of a study before it is computed; raises as the study does."""
    computing = service.computing
    with suppress(LargeError):
        await computing.in_thread(
            computing.quick,
            caller.workspace,
            caller.principal,
            partial(STUDIES[kind], service, caller, request),
            recall=recall,
            proves=True,
        )


def submit(service: Installation, session: Session, caller: Caller, kind: str, request: BaseModel) -> dict[str, Any]:
    """Hand a study to a worker, with the present revision of the system that it names."""
    document = request.model_dump(by_alias=True, exclude_unset=True)
    system = document.get("system")
    reference = None
    if isinstance(system, str):
        reference = {"id": system, "revision": current_revision(session, caller, system)}
    body = {"request": document, "system_reference": reference}
    return jobs.enqueue(service, session, caller, kind=kind, body=body, queue=None)


def run(body: Mapping[str, Any], *, kind: str, service: Installation, workspace: str) -> dict[str, Any]:
    """Compute a study (in a worker) and return what is remembered of it."""
    reference = body["system_reference"]
    caller = Caller(principal="", workspace=workspace, scopes=frozenset())
    with at_revision(reference["revision"] if reference else None):
        return STUDIES[kind](service, caller, MODELS[kind].model_validate(body["request"])).body


async def studied(
    service: Installation,
    caller: Caller,
    kind: str,
    request: BaseModel,
    *,
    recall: Recall,
    request_id: str,
    kept: bool,
) -> Study:
    """Return a study with its text: computed in a thread where it is quick, in a process of its own where it is not.

    Raises
    ------
    RecalledError
        When ``recall`` was asked.
    Problem
        As the study does; 429 when too much of this caller waits.
    """
    computing = service.computing

    def quick() -> Study | dict[str, Any]:
        try:
            return with_text(STUDIES[kind](service, caller, request))
        except LargeError:
            # as it came: models of blocks, which are made from the catalogue, cannot be sent themselves
            return request.model_dump(by_alias=True, exclude_unset=True)

    first = await computing.in_thread(computing.quick, caller.workspace, caller.principal, quick, recall=recall)
    if isinstance(first, Study):
        return first
    job = ComputeJob(
        id=request_id,
        kind=kind,
        body={
            "settings": service.settings,
            "caller": caller,
            "model": type(request),
            "request": first,
            "kept": kept,
        },
        workspace_id=caller.workspace,
        database_url=service.database.url,
        request_id=request_id,
    )
    found: Study = (await computing.in_child(job, caller.principal, recall=recall))["study"]
    return found
