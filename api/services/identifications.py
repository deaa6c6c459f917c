"""Identifications (by a worker) and validations (at once): a recording and a model of what was recorded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from sqlalchemy.orm import Session

from api.convert.identifications import fit_to_wire, identification_from_wire, identified_to_wire
from api.convert.recordings import Values, window
from api.convert.signals import check_name
from api.convert.studies import warnings_to_wire
from api.convert.values import number, numbers, overrides_from_wire, si
from api.errors import at, invalid
from api.pointers import Place
from api.schemas.jobs import IdentificationRequest, ValidationRequest
from api.services.datasets import read_recording
from api.services.installation import Caller, Installation
from api.services.jobs import job_to_wire
from api.services.results import Study
from api.services.systems import Subject, compiled, subject_of
from engine.diagram import Diagram
from engine.fit import baselines, compare, passes, worst_interval
from engine.linear.sampled import simulate_sampled
from engine.nonlinear.recorded import simulate_recorded
from optimizers.identification import identify
from optimizers.recording import Recording
from optimizers.result import Monitor
from storage.session import Database

KIND = "identification"
_SEED = 0
"""Of the starts after the first one: the same request gives the same answer."""


def prepare(service: Installation, caller: Caller, request: IdentificationRequest) -> Subject:
    """Prove that an identification can be run.

    Raises
    ------
    api.errors.Problem, EngineError
        422 with the place of what is wrong.
    """
    subject = subject_of(service, caller, request.system)
    recording = _recording(request, subject.diagram, service.database, caller.workspace)
    identification_from_wire(request, subject.diagram, recording)
    return subject


def submit(
    service: Installation, session: Session, caller: Caller, request: IdentificationRequest, subject: Subject
) -> dict[str, Any]:
    """Write the job down, in the caller's transaction, with the document revision it is about."""
    body = {
        "request": {**request.model_dump(by_alias=True, exclude_unset=True), "system": subject.document},
        "system_reference": dict(subject.reference) if subject.reference else None,
        "warnings": subject.warnings(),
    }
    return job_to_wire(service.queue.enqueue(session, kind=KIND, body=body, workspace_id=caller.workspace))


def run(body: Mapping[str, Any], *, database: Database, workspace: str, monitor: Monitor) -> dict[str, Any]:
    """Compute an identification (in a worker) and return what is remembered of it."""
    request = IdentificationRequest.model_validate(body["request"])
    diagram = compiled(body["request"]["system"], place=("system",))
    problem = identification_from_wire(request, diagram, _recording(request, diagram, database, workspace))
    found = identify(problem, rng=np.random.default_rng(_SEED), monitor=monitor)
    reference = body["system_reference"]
    result = identified_to_wire(found, problem, system=reference)
    place = ("system",) if reference is None else None
    return {**result, "dataset": request.dataset, "warnings": warnings_to_wire(diagram.warnings, place=place)}


def _recording(
    request: IdentificationRequest | ValidationRequest, diagram: Diagram, database: Database, workspace: str
) -> Recording:
    """Return the recorded inputs and outputs, in SI, by the names of the diagram."""
    names: dict[Place, str] = {}
    for key, given, known, what in (
        ("inputs", request.inputs, diagram.inputs, "the system's inputs"),
        ("outputs", request.outputs, diagram.outputs, "the system's outputs"),
    ):
        for name, channel in given.items():
            check_name(name, known, name=key.removesuffix("s"), what=what, place=(key, name))
            names[key, name] = channel
    read = read_recording(database, workspace, request.dataset, names)
    return Recording(
        inputs={name: read.channels[channel] for name, channel in request.inputs.items()},
        outputs={name: read.channels[channel] for name, channel in request.outputs.items()},
        sample_time=read.sample_time,
    )


def run_validation(service: Installation, caller: Caller, request: ValidationRequest) -> Study:
    """Return how well the model with given parameters reproduces a recording, and the verdict against a limit."""
    subject = subject_of(service, caller, request.system)
    diagram = subject.diagram
    overrides = overrides_from_wire(request.parameters, diagram, place=("parameters",))
    recording = _recording(request, diagram, service.database, caller.workspace)
    chosen = window(request.window, length=recording.end, name="window") or (0.0, recording.end)
    part = recording.within(chosen)
    if part.stop - part.start < 2:
        raise invalid(f"window must hold at least 2 samples, got {max(part.stop - part.start, 0)}", "window")
    given = _offsets(request, diagram)
    with service.computing.slot():
        place = ("parameters",) if overrides else ("system",)
        simulated = _simulated(diagram, recording, overrides, samples=part.stop, place=place)
        inputs = np.array([values[part] for values in recording.inputs.values()])
        time = np.arange(part.start, part.stop) * recording.sample_time
        outputs: dict[str, Any] = {}
        fits = {}
        offsets: dict[str, float] = {}
        for name, values in recording.outputs.items():
            measured, model = values[part], simulated[name][part]
            if request.offsets == "estimate":
                offsets[name] = float(np.mean(measured - model))
            else:
                offsets[name] = given.get(name, 0.0)
            model = model + offsets[name]
            if not np.isfinite(model).all():
                raise invalid(
                    f"the model must have a finite response to the recording, output {name} grows beyond any number "
                    "(it is unstable at these parameters)",
                    *(("parameters",) if overrides else ("system",)),
                )
            fits[name] = compare(measured, model)
            begin, end = worst_interval(measured, model, sample_time=recording.sample_time)
            trivial = baselines(measured, inputs, constant=request.offsets != "none")
            outputs[name] = {
                **fit_to_wire(fits[name]),
                "worst_interval": [number(time[0] + begin), number(time[0] + end)],
                "baselines": {kind: fit_to_wire(fit) for kind, fit in trivial.items()},
                "offset": number(offsets[name]),
                "unit": diagram.output_units.get(name, ""),
                "curves": {"time": numbers(time), "measured": numbers(measured), "simulated": numbers(model)},
            }
    body = {
        "outputs": outputs,
        "verdict": "pass" if passes(fits, request.limit_percent) else "fail",
        "limit_percent": request.limit_percent,
        "window": list(chosen),
        "dataset": request.dataset,
        "system": dict(subject.reference) if subject.reference else None,
        "warnings": subject.warnings(),
    }
    return Study(body=body, request=request.model_dump(by_alias=True, exclude_unset=True), system=subject.reference)


def _offsets(request: ValidationRequest, diagram: Diagram) -> dict[str, float]:
    if isinstance(request.offsets, str):
        return {}
    values: dict[str, float] = {}
    for name, value in request.offsets.items():
        place = ("offsets", name)
        check_name(name, tuple(request.outputs), name="output", what="the outputs compared", place=place)
        values[name] = si(value, diagram.output_units.get(name, ""), name=f"offset of {name}", place=place)
    return values


def _simulated(
    diagram: Diagram, recording: Recording, overrides: Mapping[str, float], *, samples: int, place: Place
) -> dict[str, Values]:
    """Return the model's answer to the first ``samples`` of the recorded inputs; those not recorded are 0."""
    with at(*place):
        system = diagram.realize(overrides)
        laws = diagram.laws(overrides) if diagram.nonlinear else None
    rest = np.zeros(recording.samples)
    inputs = np.array([recording.inputs.get(name, rest)[:samples] for name in diagram.inputs])
    names = tuple(recording.outputs)
    if laws is not None:
        values, _ = simulate_recorded(laws, inputs, recording.sample_time, outputs=names)
        return dict(zip(names, values, strict=True))
    return dict(zip(names, simulate_sampled(system, inputs, recording.sample_time, outputs=names), strict=True))
