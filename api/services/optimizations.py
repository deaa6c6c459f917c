"""Optimisations: proven to make sense when they are asked for, computed by a worker."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sqlalchemy.orm import Session

from api.convert.optimizations import problem_from_wire, result_to_wire
from api.convert.studies import warnings_to_wire
from api.schemas.jobs import OptimizationRequest
from api.services.datasets import reader_of
from api.services.installation import Caller, Installation
from api.services.jobs import job_to_wire
from api.services.systems import Subject, compiled, subject_of
from engine.study import simulate
from optimizers import methods
from optimizers.problem import Problem
from optimizers.result import Monitor
from storage.session import Database

KIND = "optimization"
_CURVE_SAMPLES = 1000


def method_options(request: OptimizationRequest) -> tuple[str, dict[str, Any]]:
    """Return the kind of the method and its options as given."""
    given = request.method.model_dump(exclude_unset=True)
    return given.pop("kind"), given


def prepare(service: Installation, caller: Caller, request: OptimizationRequest) -> Subject:
    """Prove that an optimisation can be run.

    Raises
    ------
    api.errors.Problem, EngineError
        422 with the place of what is wrong.
    """
    subject = subject_of(service, caller, request.system)
    problem_from_wire(request, subject.diagram, read_channel=reader_of(service.database, caller.workspace))
    kind, options = method_options(request)
    methods.catalogue()[kind].resolve(options)
    return subject


def submit(
    service: Installation, session: Session, caller: Caller, request: OptimizationRequest, subject: Subject
) -> dict[str, Any]:
    """Write the job down, in the caller's transaction, with the document revision it is about."""
    body = {
        "request": {**request.model_dump(by_alias=True, exclude_unset=True), "system": subject.document},
        "system_reference": dict(subject.reference) if subject.reference else None,
        "warnings": subject.warnings(),
    }
    return job_to_wire(service.queue.enqueue(session, kind=KIND, body=body, workspace_id=caller.workspace))


def run(body: Mapping[str, Any], *, database: Database, workspace: str, monitor: Monitor) -> dict[str, Any]:
    """Compute an optimisation (in a worker) and return what is remembered of it."""
    request = OptimizationRequest.model_validate(body["request"])
    diagram = compiled(body["request"]["system"], place=("system",))
    problem = problem_from_wire(request, diagram, read_channel=reader_of(database, workspace))
    kind, options = method_options(request)
    result = methods.minimize(kind, problem, options, monitor=monitor)
    monitor.progress(1.0, "curves before and after")
    reference = body["system_reference"]
    place = ("system",) if reference is None else None
    return result_to_wire(
        result,
        request,
        curves={"before": _curves(problem, {}), "after": _curves(problem, result.best)},
        system=reference,
        warnings=warnings_to_wire(diagram.warnings, place=place),
    )


def _curves(problem: Problem, overrides: Mapping[str, float]) -> dict[str, Any]:
    """Return the curves of every experiment in the system as it is (the first scenario's parameters included)."""
    values = {**problem.scenarios[0], **overrides}
    values = {path: value for path, value in values.items() if path not in problem.commands}
    curves: dict[str, Any] = {}
    for experiment in problem.experiments_at(overrides):
        found = simulate(
            problem.diagram,
            signals=experiment.signals,
            overrides=values,
            duration=experiment.duration,
            samples=_CURVE_SAMPLES,
            metrics=(),
        )
        curves[experiment.name] = {"time": found.time, "outputs": dict(found.curves), "verdict": str(found.verdict)}
    return curves
