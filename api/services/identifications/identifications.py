"""Identifications, by a worker: a recording and a model of what was recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from sqlalchemy.orm import Session

from api.convert.identifications import identification_from_wire, identified_to_wire
from api.convert.studies import warnings_to_wire
from api.problems.pointers import Place
from api.schemas.identifications import IdentificationRequest
from api.schemas.jobs import RecordedInput
from api.services.identifications import direct_identifications
from api.services.identifications.measured_experiments import dataset_of, frequency_experiment_of
from api.services.jobs import jobs
from api.services.operation.app_context import Caller, Installation
from api.services.recordings.recordings import recording_of
from api.services.systems.systems import Subject, compiled, subject_of
from api.settings import Settings
from engine.diagram.diagram import Diagram
from optimizers.identification import Expected, expected, identify
from optimizers.recorded.recording import Identification, Recording
from optimizers.search.limits import Limited
from optimizers.search.result import Monitor
from storage.session import Database

KIND = "identification"
_SEED = 0
"""Of the starts after the first one: the same request gives the same answer."""
_LONG: Final = 60.0
"""Seconds from which on it is said that a search will be long,"""
_LARGE: Final = 1e9
"""and bytes from which on it is said that it is large."""
_SHORTER: Final = "a recording that is shorter, or decimated, or fewer starts take less; a time limit ends it with the best until then"


@dataclass(frozen=True, slots=True, kw_only=True)
class Prepared:
    """An identification that can be run, and what it will take."""

    subject: Subject
    cost: Expected

    def warnings(self) -> list[dict[str, str]]:
        """Return the system's warnings, and what is known beforehand of a long search."""
        said = self.subject.warnings()
        if self.cost.seconds > _LONG or self.cost.bytes > _LARGE:
            said.append({"pointer": "/parameters", "detail": f"{_words(self.cost)}: {_SHORTER}"})
        return said


def prepare(service: Installation, caller: Caller, request: IdentificationRequest) -> Prepared:
    """Prove that an identification can be run, and in how much memory.

    Raises
    ------
    api.problems.documents.Problem, EngineError
        422 with the place of what is wrong.
    """
    subject = subject_of(service, caller, request.system)
    problem = _problem(request, subject.diagram, service.database, caller.workspace)
    return Prepared(subject=subject, cost=expected(problem, most_bytes=service.settings.job_plan))


def submit(
    service: Installation, session: Session, caller: Caller, request: IdentificationRequest, prepared: Prepared
) -> dict[str, Any]:
    """Write the job down, in the caller's transaction, with the document revision it is about."""
    subject = prepared.subject
    body = {
        "request": {
            **request.model_dump(by_alias=True, exclude_unset=True, exclude={"queue"}),
            "system": subject.document,
        },
        "system_reference": dict(subject.reference) if subject.reference else None,
        "warnings": prepared.warnings(),
    }
    return jobs.enqueue(service, session, caller, kind=KIND, body=body, queue=request.queue)


def run(
    body: Mapping[str, Any], *, database: Database, workspace: str, monitor: Monitor, seconds: float | None = None
) -> dict[str, Any]:
    """Compute an identification (in a worker), within so many ``seconds``, and return what is remembered of it."""
    if body["request"].get("method", "grey_box") != "grey_box":
        return direct_identifications.run(
            body, database=database, workspace=workspace, monitor=monitor, seconds=seconds
        )
    request = IdentificationRequest.model_validate(body["request"])
    diagram = compiled(body["request"]["system"], place=("system",))
    problem = _problem(request, diagram, database, workspace)
    cost = expected(problem, most_bytes=Settings().job_plan)
    monitor.progress(0.0, _words(cost))
    found = identify(problem, rng=np.random.default_rng(_SEED), monitor=Limited(monitor, seconds))
    reference = body["system_reference"]
    result = identified_to_wire(found, problem, system=reference)
    place = ("system",) if reference is None else None
    datasets = _datasets(request, database, workspace)
    remarks = (*diagram.warnings, *(diagram.analysis if request.frequency_responses else ()))
    return {
        **result,
        "dataset": datasets[0],
        "datasets": datasets,
        "expected": asdict(cost),
        "warnings": warnings_to_wire(remarks, place=place) + result["warnings"],
    }


def _problem(request: IdentificationRequest, diagram: Diagram, database: Database, workspace: str) -> Identification:
    recordings = _recordings(request, diagram, database, workspace)
    frequency = []
    for k, one in enumerate(request.frequency_responses or ()):
        name = one.name or f"response_{k + 1}"
        place: Place = ("frequency_responses", k)
        frequency.append(
            frequency_experiment_of(one, diagram, name=name, database=database, workspace=workspace, place=place)
        )
    return identification_from_wire(request, diagram, recordings, frequency)


def _recordings(
    request: IdentificationRequest, diagram: Diagram, database: Database, workspace: str
) -> list[Recording]:
    """Return what was recorded in each experiment."""
    if request.dataset is not None:
        given: list[tuple[str, Mapping[str, str | RecordedInput], Mapping[str, str], Place]] = [
            (request.dataset, request.inputs or {}, request.outputs or {}, ())
        ]
    else:
        given = [(e.dataset, e.inputs, e.outputs, ("experiments", k)) for k, e in enumerate(request.experiments or ())]
    return [
        recording_of(dataset, inputs, outputs, diagram, database=database, workspace=workspace, place=place)
        for dataset, inputs, outputs, place in given
    ]


def _datasets(request: IdentificationRequest, database: Database, workspace: str) -> list[str]:
    """Return every dataset once."""
    recorded = [request.dataset] if request.dataset is not None else [e.dataset for e in request.experiments or ()]
    measured = [dataset_of(one, database=database, workspace=workspace) for one in request.frequency_responses or ()]
    return list(dict.fromkeys([*recorded, *measured]))


def _words(cost: Expected) -> str:
    """Say what an identification will take."""
    return f"about {cost.evaluations} simulations, {cost.seconds:.2g} s and {cost.bytes / 1e9:.2g} GB are expected"
