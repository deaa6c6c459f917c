"""Every study by its kind: what computes it, in a thread or, when it is large, in a process of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pydantic import BaseModel

from api.services import frfs, spectra, studies, validations
from api.services.computing import LargeError, Recall
from api.services.installation import Caller, Installation
from api.services.results import Study, with_text
from storage.jobs.compute import ComputeJob

STUDIES: Mapping[str, Callable[[Installation, Caller, Any], Study]] = {
    "simulation": studies.run_simulation,
    "frequency_response": studies.run_frequency_response,
    "influence": studies.run_influence,
    "spectrum": spectra.run_spectra,
    frfs.KIND: frfs.run_frf,
    validations.KIND: validations.run_validation,
}


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

    def quick() -> Study:
        return with_text(STUDIES[kind](service, caller, request))

    try:
        return await computing.in_thread(computing.quick, caller.workspace, caller.principal, quick, recall=recall)
    except LargeError:
        pass
    job = ComputeJob(
        id=request_id,
        kind=kind,
        body={
            "settings": service.settings,
            "caller": caller,
            "model": type(request),
            # as it came: models of blocks, which are made from the catalogue, cannot be sent themselves
            "request": request.model_dump(by_alias=True, exclude_unset=True),
            "kept": kept,
        },
        workspace_id=caller.workspace,
        database_url=service.database.url,
        request_id=request_id,
    )
    found: Study = (await computing.in_child(job, caller.principal, recall=recall))["study"]
    return found
