"""Optimisations: proven to make sense when they are asked for, computed by a worker."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError
from sqlalchemy.orm import Session

from api.convert.alternatives import altered
from api.convert.optima import result_to_wire, summary_to_wire
from api.convert.optimizations import problem_from_wire
from api.convert.studies import warnings_to_wire
from api.convert.values import number
from api.problems.documents import Problem as Refused
from api.problems.documents import invalid
from api.problems.pointers import Place
from api.schemas.optimizations import AlternativeDocument, OptimizationRequest
from api.schemas.systems import SystemDocument
from api.services.jobs import jobs
from api.services.operation.app_context import Caller, Installation
from api.services.recordings.datasets import reader_of
from api.services.systems.systems import Subject, compiled, document_of, subject_of
from engine.analysis.study import simulate
from engine.model.errors import EngineError
from optimizers import methods
from optimizers.evaluation.effort import metered, seconds_of
from optimizers.problem import Problem
from optimizers.search.result import Monitor
from optimizers.solving.solve import check_applicable, check_request, compare, solve
from storage.session import Database

KIND = "optimization"
_CURVE_SAMPLES = 1000


def method_options(request: OptimizationRequest) -> tuple[str, dict[str, Any]]:
    """Return the kind of the method and its options as given."""
    given = request.method.model_dump(exclude_unset=True)
    return given.pop("kind"), given


@dataclass(frozen=True, slots=True, kw_only=True)
class Prepared:
    """A request that can be run: its system, the documents of the structures that it compares, and which of them are stored.

    ``doubts`` are warnings of its goals.
    """

    subject: Subject
    alternatives: tuple[dict[str, Any], ...]
    stored: tuple[Mapping[str, Any], ...]
    doubts: tuple[Mapping[str, str], ...]


def prepare(service: Installation, caller: Caller, request: OptimizationRequest) -> Prepared:
    """Prove that an optimisation can be run, each of its alternatives if it has any.

    Raises
    ------
    api.problems.documents.Problem, EngineError
        422 with the place of what is wrong.
    """
    subject = subject_of(service, caller, request.system)
    read_channel = reader_of(service.database, caller.workspace)
    kind, options = method_options(request)
    method = methods.catalogue()[kind]
    resolved = method.resolve(options)
    if request.alternatives is None:
        problem = problem_from_wire(request, subject.diagram, read_channel=read_channel)
        _proven(problem, request)
        method.check(problem, resolved)
        return Prepared(subject=subject, alternatives=(), stored=(), doubts=_doubts(problem))
    documents, stored = [], []
    told: tuple[Mapping[str, str], ...] = ()  # the goals of all are the same
    for index, alternative in enumerate(request.alternatives):
        place = ("alternatives", index)
        document, reference = _document(service, caller, subject, alternative, place)
        stored += [] if reference is None else [dict(reference)]
        diagram = compiled(document, place=(*place, "system"))
        try:
            problem = problem_from_wire(
                request, diagram, read_channel=read_channel, variables=alternative.variables
            )  # fmt: skip
            _proven(problem, request)
            method.check(problem, resolved)
            told = _doubts(problem)
        except EngineError as error:
            own = error.at[:1] == ("variables",) and alternative.variables is not None
            raise (error.within(*place) if own else error).of(f"alternative {alternative.name!r}") from error
        written = alternative.model_dump(by_alias=True, exclude_unset=True, include={"variables"})
        documents.append({"name": alternative.name, "system": document, **written})
    names = [alternative.name for alternative in request.alternatives]
    for index, name in enumerate(names):
        if name in names[:index]:
            raise invalid(
                f"name must be different for each alternative, got {name!r} twice", "alternatives", index, "name"
            )
    return Prepared(subject=subject, alternatives=tuple(documents), stored=tuple(stored), doubts=told)


def _proven(problem: Problem, request: OptimizationRequest) -> None:
    check_applicable(problem)
    check_request(problem, checks=request.cross_check, samples=request.yield_samples)


def _doubts(problem: Problem) -> tuple[Mapping[str, str], ...]:
    return tuple(warnings_to_wire(problem.doubts, place=()))


def _document(
    service: Installation, caller: Caller, subject: Subject, alternative: AlternativeDocument, place: Place
) -> tuple[dict[str, Any], Mapping[str, Any] | None]:
    """Return the document of an alternative (a system of its own, or the request's with its differences), and what is stored."""
    reference = None
    if alternative.system is None:
        document = altered(subject.document, alternative, place)
    else:
        for key in ("add", "remove"):
            if getattr(alternative, key) is not None:
                raise invalid(f"{key} must be left out beside a system of its own", *place, key)
        try:
            own = subject_of(service, caller, alternative.system)
        except Refused as error:
            raise error.within(*place) from error
        document, reference = own.document, own.reference
    try:
        return document_of(SystemDocument.model_validate(document)), reference
    except ValidationError as error:
        raise invalid(
            f"alternative {alternative.name!r} makes no system: {error.errors()[0]['msg']}", *place
        ) from error


def submit(
    service: Installation, session: Session, caller: Caller, request: OptimizationRequest, prepared: Prepared
) -> dict[str, Any]:
    """Write the job down, in the caller's transaction, with the document revision it is about."""
    subject = prepared.subject
    asked = {**request.model_dump(by_alias=True, exclude_unset=True, exclude={"queue"}), "system": subject.document}
    if prepared.alternatives:
        asked["alternatives"] = list(prepared.alternatives)
    body = {
        "request": asked,
        "system_reference": dict(subject.reference) if subject.reference else None,
        "alternative_references": list(prepared.stored),
        "warnings": [*subject.warnings(), *prepared.doubts],
    }
    return jobs.enqueue(service, session, caller, kind=KIND, body=body, queue=request.queue)


def run(
    body: Mapping[str, Any], *, database: Database, workspace: str, monitor: Monitor, seconds: float | None = None
) -> dict[str, Any]:
    """Compute an optimisation (in a worker) and return what is remembered of it.

    Parameters
    ----------
    seconds : float, optional
        How long it may take: a search that does not end before is stopped, and its best point is the result.
    """
    with metered() as effort:
        found = _computed(body, database=database, workspace=workspace, monitor=monitor, seconds=seconds)
        spent = effort.spent()
        return {**found, "seconds": seconds_of(spent), "effort": spent}


def _computed(
    body: Mapping[str, Any], *, database: Database, workspace: str, monitor: Monitor, seconds: float | None
) -> dict[str, Any]:
    request = OptimizationRequest.model_validate(body["request"])
    read_channel = reader_of(database, workspace)
    kind, options = method_options(request)
    samples = request.yield_samples
    extras: dict[str, Any] = {}
    if request.alternatives is None:
        diagram = compiled(body["request"]["system"], place=("system",))
        problem = problem_from_wire(request, diagram, read_channel=read_channel)
        result = solve(
            kind, problem, options, monitor=monitor, checks=request.cross_check, samples=samples, seconds=seconds
        )
    else:
        problems = {
            alternative["name"]: problem_from_wire(
                request, compiled(alternative["system"], place=("alternatives", i, "system")), read_channel=read_channel,
                variables=request.alternatives[i].variables,
            )
            for i, alternative in enumerate(body["request"]["alternatives"])
        }  # fmt: skip
        compared = compare(
            kind, problems, options, monitor=monitor, checks=request.cross_check, samples=samples, seconds=seconds
        )  # fmt: skip
        problem, result = problems[compared.best], compared.results[compared.best]
        diagram = problem.diagram
        extras = {
            "chosen": compared.best,
            "alternatives": [
                {"name": name, **summary_to_wire(found, request.goals), "objective": number(compared.objectives[name])}
                for name, found in compared.results.items()
            ],
        }
    monitor.progress(1.0, "curves before and after")
    reference = body["system_reference"]
    place = ("system",) if reference is None else None
    wire = result_to_wire(
        result,
        request.goals,
        curves={"before": _curves(problem, {}), "after": _curves(problem, result.best)},
        system=reference,
        warnings=[*warnings_to_wire(diagram.warnings, place=place), *warnings_to_wire(problem.doubts, place=())],
    )
    return wire | extras


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
