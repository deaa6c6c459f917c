"""Validations, at once or by a worker: how well a model with given parameters reproduces a recording, and what to try if not."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from sqlalchemy.orm import Session

from api.convert.recordings import Values, window
from api.convert.signals import check_name
from api.convert.studies import warnings_to_wire
from api.convert.validations import validation_to_wire
from api.convert.values import overrides_from_wire, si
from api.problems.documents import at, invalid
from api.problems.pointers import Place
from api.schemas.validations import ValidationRequest
from api.services.identifications.identified import Adjusted, adjusted_by
from api.services.jobs import costs, jobs
from api.services.operation.app_context import Caller, Installation
from api.services.recordings.recordings import recording_of
from api.services.studies.results import Study
from api.services.systems.systems import Subject, compiled, subject_of
from engine.diagram.diagram import Diagram
from engine.exact.nonlinear.recorded import WALL_LIMIT
from engine.model.between_samples import tried
from engine.model.errors import EngineError, UnresolvedError
from engine.model.names import no_parameter
from engine.model.parameters import ParameterInfo
from engine.recordings.validation.between import Chosen, chosen
from engine.recordings.validation.diagnosis import diagnose
from engine.recordings.validation.response import Between, respond, tangents
from engine.recordings.validation.steps import Movable
from engine.recordings.validation.validate import Compared, Validated, validate
from engine.recordings.validation.verdict import Grade
from optimizers.recorded.recording import Recording
from storage.errors import NotFoundError
from storage.repositories import DatasetRepository, ProcessingRepository
from storage.session import Database

KIND = "validation"
_MOST_MOVABLE = 20
"""Parameters that a diagnosis tries by itself."""
_JOB_SECONDS = 600.0
_AT_ONCE = 4
"""Numbers that are read inside a request, in units of those that a reply may hold: 160 MB."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prepared:
    """A validation that has been proven to make sense; ``begin`` is the first sample of the experiment that ``part`` lies in."""

    diagram: Diagram
    recording: Recording
    begin: int
    part: slice
    window: tuple[float, float]
    overrides: Mapping[str, float]
    adjusted: Adjusted | None
    offsets: Mapping[str, float] | None
    movable: tuple[Movable, ...]
    request: ValidationRequest


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Asked:
    """What a request says beside its recording."""

    overrides: Mapping[str, float]
    adjusted: Adjusted | None
    offsets: Mapping[str, float] | None
    movable: tuple[Movable, ...]


def _asked(request: ValidationRequest, diagram: Diagram, *, database: Database, workspace: str) -> _Asked:
    adjusted = None
    if request.identification is not None:
        adjusted = adjusted_by(request.identification, diagram, database=database, workspace=workspace)
    given = overrides_from_wire(request.parameters, diagram, place=("parameters",))
    overrides = {**(adjusted.values if adjusted else {}), **given}
    return _Asked(
        overrides=overrides,
        adjusted=adjusted,
        offsets=_offsets(request, diagram, adjusted),
        movable=_movable(request, diagram, overrides),
    )


def prepare(request: ValidationRequest, diagram: Diagram, *, database: Database, workspace: str) -> Prepared:
    """Prove that a validation makes sense.

    Raises
    ------
    api.problems.documents.Problem, EngineError
        422 with the place of what is wrong.
    """
    asked = _asked(request, diagram, database=database, workspace=workspace)
    recording = recording_of(
        request.dataset, request.inputs, request.outputs, diagram, database=database, workspace=workspace
    )
    if asked.adjusted and asked.adjusted.between:  # what was found once is not asked again
        recording = recording.with_undecided(asked.adjusted.between)
    chosen = window(request.window, length=recording.end, name="window") or (0.0, recording.end)
    part = recording.within(chosen)
    if part.stop - part.start < 2:
        raise invalid(f"window must hold at least 2 samples, got {max(part.stop - part.start, 0)}", "window")
    return Prepared(
        diagram=diagram,
        recording=recording,
        begin=_begin(request, part, recording, database=database, workspace=workspace),
        part=part,
        window=chosen,
        overrides=asked.overrides,
        adjusted=asked.adjusted,
        offsets=asked.offsets,
        movable=asked.movable,
        request=request,
    )


def _begin(request: ValidationRequest, part: slice, recording: Recording, *, database: Database, workspace: str) -> int:
    """Return where the experiment begins that the window lies in: a model does not run across the joints of a merge.

    Raises
    ------
    Problem
        422 for a window that holds a joint.
    """
    with database.session() as session:
        counts = ProcessingRepository(session, workspace).experiments(request.dataset) or (recording.samples,)
    begin = 0
    for count in counts:
        if begin <= part.start and part.stop <= begin + count:
            return begin
        begin += count
    ends = ", ".join(f"{end * recording.sample_time:g}" for end in np.cumsum(counts)[:-1])
    raise invalid(
        f"window must lie in one of the {len(counts)} experiments, which are joined at {ends} s, "
        f"got {part.start * recording.sample_time:g} to {(part.stop - 1) * recording.sample_time:g} s",
        "window",
    )


def _offsets(request: ValidationRequest, diagram: Diagram, adjusted: Adjusted | None) -> dict[str, float] | None:
    """Return the offset of each output, None where they are to be estimated."""
    if request.offsets == "estimate":
        return None
    values = dict.fromkeys(request.outputs, 0.0)
    if isinstance(request.offsets, str):
        if adjusted is not None and "offsets" not in request.model_fields_set:
            values |= {name: value for name, value in adjusted.offsets.items() if name in values}
        return values
    for name, value in request.offsets.items():
        place = ("offsets", name)
        check_name(name, tuple(request.outputs), name="output", what="the outputs compared", place=place)
        values[name] = si(value, diagram.output_units.get(name, ""), name=f"offset of {name}", place=place)
    return values


def _movable(request: ValidationRequest, diagram: Diagram, values: Mapping[str, float]) -> tuple[Movable, ...]:
    """Return the parameters that a diagnosis may move: those named, else the system's own, else those of its blocks."""
    if request.diagnose == "never":
        return ()
    if request.movable is None:
        # what is 0 is switched off (a lag, a delay): its absence is part of the structure
        free = [i for i in diagram.parameters.values() if not i.bound and values.get(i.path, i.value) != 0.0]
        own = [info for info in free if "." not in info.path]
        # the document's author named what matters; without such names, every number of a block may be the one
        chosen = (own or free)[:_MOST_MOVABLE]
        return tuple(_moving(info, values.get(info.path, info.value)) for info in chosen)
    found = []
    for i, path in enumerate(dict.fromkeys(request.movable)):
        info = diagram.parameters.get(path)
        if info is None:
            raise invalid(no_parameter(path, diagram.parameters), "movable", i)
        if info.bound:
            raise invalid(f"{path} must be a number to be moved, but an expression gives it", "movable", i)
        found.append(_moving(info, values.get(path, info.value)))
    return tuple(found)


def _moving(info: ParameterInfo, value: float) -> Movable:
    # a mass may become small, never 0
    lower = info.lower + 0.01 * (value - info.lower) if info.lower_open and np.isfinite(info.lower) else info.lower
    return Movable(parameter=info.path, value=value, lower=min(lower, value), upper=info.upper, unit=info.unit)


def compute(prepared: Prepared, *, seconds: float, tell: Callable[[float, str], None] = lambda *_: None) -> Validated:
    """Simulate, compare, and look for what would make the error smaller.

    Parameters
    ----------
    prepared : Prepared
    seconds : float
        What a diagnosis of a nonlinear system may take, and trying its steps as long again.
    tell : callable
        Takes the finished share and a line.

    Raises
    ------
    api.problems.documents.Problem
        422 where the model has no finite answer.
    """
    diagram, recording, part, begin = prepared.diagram, prepared.recording, prepared.part, prepared.begin
    shown = slice(part.start - begin, part.stop - begin)
    # what comes after the window does not matter to a causal system
    inputs = {name: values[begin : part.stop] for name, values in recording.inputs.items()}
    names = tuple(recording.outputs)

    def simulated_with(
        between: Between, overrides: Mapping[str, float], limit: float = WALL_LIMIT
    ) -> dict[str, Values]:
        found = respond(
            diagram, inputs, recording.sample_time, outputs=names, overrides=overrides, between=between, wall_limit=limit
        )  # fmt: skip
        return {name: values[shown] for name, values in found.items()}

    tell(0.1, "simulating")
    measured = {name: values[part] for name, values in recording.outputs.items()}
    simulated, between, decided = _best_way(prepared, measured, simulated_with, seconds=seconds)

    def answer(overrides: Mapping[str, float], wall_limit: float = WALL_LIMIT) -> dict[str, Values]:
        return simulated_with(between, overrides, wall_limit)

    theoretical = None
    if prepared.overrides:
        tell(0.4, "simulating with the document's own parameters")
        with suppress(EngineError):  # a theory that cannot be simulated has no fit
            theoretical = answer({})
    found = validate(
        Compared(
            measured=measured,
            simulated=simulated,
            theoretical=theoretical,
            inputs={name: values[part] for name, values in recording.inputs.items()},
            sample_time=recording.sample_time,
            offsets=prepared.offsets,
        ),
        limit_percent=prepared.request.limit_percent,
    )
    found = replace(found, between=decided)
    wanted = prepared.request.diagnose
    if wanted == "never" or (wanted == "failed" and found.grade is not Grade.FAIL):
        return found
    tell(0.6, "looking for what would make the error smaller")
    try:
        by = tangents(
            diagram, inputs, recording.sample_time, outputs=names, overrides=prepared.overrides, between=between,
            parameters=[movable.parameter for movable in prepared.movable], wall_limit=seconds,
        )  # fmt: skip
    except UnresolvedError as error:
        note = f"no parameter was moved: {error.message}"
        return found.diagnosed(diagnose(found.comparisons({})), note=note)
    parts = {output: {name: values[shown] for name, values in own.items()} for output, own in by.items()}
    # where a response is near its limit of growth, its derivative may be beyond it
    told = [m for m in prepared.movable if all(np.isfinite(own[m.parameter]).all() for own in parts.values())]
    kept = {output: {m.parameter: own[m.parameter] for m in told} for output, own in parts.items()}
    diagnosis = diagnose(found.comparisons(kept), told)
    tell(0.8, "trying the steps")
    end = time.monotonic() + (seconds if diagram.nonlinear else math.inf)
    return found.diagnosed(diagnosis).checked(
        lambda values: answer({**prepared.overrides, **values}, min(end - time.monotonic(), WALL_LIMIT)),
        go_on=lambda: time.monotonic() < end,
    )


def _best_way(
    prepared: Prepared, measured: Mapping[str, Values], simulate: Callable[..., dict[str, Values]], *, seconds: float
) -> tuple[dict[str, Values], Between, Chosen | None]:
    """Return the response that fits best, what its inputs do between their samples, and how that was decided, if it was."""
    recording = prepared.recording
    place: Place = ("parameters",) if prepared.overrides else ("system",)
    ways = {way: recording.with_undecided(way).between_samples for way in tried(recording.undecided)}
    first, *others = ways
    with at(*place):
        answers = {first: simulate(ways[first], prepared.overrides)}
    _check_finite(answers[first], place)
    for way in others:
        with suppress(EngineError):  # a response that cannot be followed, or not in this time, is none to choose
            answers[way] = simulate(ways[way], prepared.overrides, seconds)
    decided = chosen(measured, answers, prepared.offsets)
    return answers[decided.way], ways[decided.way], decided if recording.undecided else None


def _check_finite(simulated: Mapping[str, Values], place: Place) -> None:
    for name, values in simulated.items():
        if not np.isfinite(values).all():
            what = f"output {name} grows beyond any number (it is unstable at these parameters)"
            raise invalid(f"the model must have a finite response to the recording, {what}", *place)


def run_validation(service: Installation, caller: Caller, request: ValidationRequest) -> Study:
    """Return how well the model with given parameters reproduces a recording, and the verdict against a limit."""
    subject = subject_of(service, caller, request.system)
    samples = _samples(service, caller, request)
    limit = _AT_ONCE * service.settings.max_numbers
    if samples > limit:
        raise invalid(
            f"the recording must be at most {limit} samples x channels to be validated at once, got {samples} (a worker takes "
            "longer ones: Prefer: respond-async)",
            "dataset",
        )
    prepared = prepare(request, subject.diagram, database=service.database, workspace=caller.workspace)
    _check_size(service, prepared)
    seconds = (prepared.part.stop - prepared.begin) * prepared.recording.sample_time
    runs = 1 + len(prepared.movable)
    cost = costs.of_system(prepared.diagram, duration=seconds, variants=runs, overrides=prepared.overrides)
    found = service.computing.bounded(
        lambda: compute(prepared, seconds=service.settings.request_seconds / 3), cost + costs.of_numbers(10 * samples)
    )
    body = _wire(found, prepared, reference=subject.reference, warnings=subject.warnings())
    return Study(
        body=body,
        request=request.model_dump(by_alias=True, exclude_unset=True, exclude={"queue"}),
        system=subject.reference,
    )


def _samples(service: Installation, caller: Caller, request: ValidationRequest) -> int:
    """Return how many numbers of the recording are read, 0 for one that is not there."""
    with service.database.session() as session:
        try:
            row = DatasetRepository(session, caller.workspace).get(request.dataset)
        except NotFoundError:
            return 0
        return (row.sample_count or 0) * (len(request.inputs) + len(request.outputs))


def _check_size(service: Installation, prepared: Prepared) -> None:
    samples = prepared.part.stop - prepared.part.start
    shown = min(samples, prepared.request.points or samples)
    curves = 3 * len(prepared.recording.outputs)
    limit = service.settings.max_numbers
    if shown * curves > limit:
        raise invalid(
            f"points must be given where samples x curves are more than {limit}, got {shown} x {curves} (or ask for a "
            "shorter window)",
            "points",
        )


def submit(
    service: Installation, session: Session, caller: Caller, request: ValidationRequest, subject: Subject
) -> dict[str, Any]:
    """Write the job down, in the caller's transaction, with the document revision it is about."""
    body = {
        "request": {
            **request.model_dump(by_alias=True, exclude_unset=True, exclude={"queue"}),
            "system": subject.document,
        },
        "system_reference": dict(subject.reference) if subject.reference else None,
        "warnings": subject.warnings(),
    }
    return jobs.enqueue(service, session, caller, kind=KIND, body=body, queue=request.queue)


def prove(service: Installation, caller: Caller, request: ValidationRequest) -> Subject:
    """Prove that a validation can be run by a worker; raises as :func:`prepare` does.

    The samples of a long recording are left to the worker.
    """
    subject = subject_of(service, caller, request.system)
    proof = prepare if _samples(service, caller, request) <= _AT_ONCE * service.settings.max_numbers else _asked
    proof(request, subject.diagram, database=service.database, workspace=caller.workspace)
    return subject


def run(
    body: Mapping[str, Any], *, database: Database, workspace: str, tell: Callable[[float, str], None]
) -> dict[str, Any]:
    """Compute a validation (in a worker) and return what is remembered of it."""
    request = ValidationRequest.model_validate(body["request"])
    diagram = compiled(body["request"]["system"], place=("system",))
    prepared = prepare(request, diagram, database=database, workspace=workspace)
    found = compute(prepared, seconds=_JOB_SECONDS, tell=tell)
    reference = body["system_reference"]
    place = ("system",) if reference is None else None
    return _wire(found, prepared, reference=reference, warnings=warnings_to_wire(diagram.warnings, place=place))


def _wire(
    found: Validated, prepared: Prepared, *, reference: Mapping[str, Any] | None, warnings: list[dict[str, str]]
) -> dict[str, Any]:
    adjusted = prepared.adjusted
    instants = np.arange(prepared.part.start, prepared.part.stop) * prepared.recording.sample_time
    return {
        **validation_to_wire(
            found, prepared.diagram, time=instants, overrides=prepared.overrides,
            intervals=adjusted.intervals if adjusted else {}, points=prepared.request.points,
        ),
        "limit_percent": prepared.request.limit_percent,
        "window": list(prepared.window),
        "dataset": prepared.request.dataset,
        "identification": prepared.request.identification,
        "system": dict(reference) if reference else None,
        "warnings": warnings,
    }  # fmt: skip
