"""What is to follow a recording, judged before there is one: hours on a rig are not spent for a misspelt parameter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from api.convert.drives import UNITS
from api.convert.signals import check_name
from api.convert.values import overrides_from_wire
from api.problems.documents import at, invalid
from api.problems.faults import validation_problem
from api.schemas.acquisitions import AcquisitionBody, FollowUpDocument
from api.schemas.identifications import IdentificationRequest
from api.schemas.validations import ValidationRequest
from api.services.operation.app_context import Caller, Installation
from api.services.recordings.recordings import check_unit
from api.services.systems.systems import subject_of
from engine.diagram.diagram import Diagram
from engine.model.names import no_parameter

_LATER = "ds_that_will_be_recorded"
"""Stands for the recording that there is not yet."""


def check_chain(service: Installation, caller: Caller, body: AcquisitionBody, rig: Mapping[str, Any]) -> None:
    """Refuse steps that could not begin once the recording is there, as far as that can be told without it.

    Parameters
    ----------
    rig : mapping
        Its document: the units of the channels.

    Raises
    ------
    Problem
        422 with the place of what is wrong.
    """
    units = {entry["name"]: UNITS[entry.get("kind", "voltage")] for entry in rig.get("outputs", ())}
    units |= {entry["name"]: entry.get("unit", "") for entry in rig.get("inputs", ())}
    measured = {name: units.get(name, "") for name in body.channels}
    for i, step in enumerate(body.then):
        if "dataset" in step.body:
            raise invalid("body of a step must be without dataset: it is that of the recording", "then", i, "body")
        if step.kind == "average":
            if body.averages < 2 or i > 0:
                raise invalid("average must be the first step, after at least 2 repetitions", "then", i, "kind")
            continue
        with at("then", i, "body"):
            _check_step(service, caller, step, measured)


def _check_step(service: Installation, caller: Caller, step: FollowUpDocument, measured: Mapping[str, str]) -> None:
    request = _read(step)
    diagram = subject_of(service, caller, request.system).diagram
    for key, given, known, units in (
        ("inputs", request.inputs or {}, diagram.inputs, diagram.references.input_units),
        ("outputs", request.outputs or {}, diagram.outputs, diagram.output_units),
    ):
        for name, entry in given.items():
            channel = entry if isinstance(entry, str) else entry.channel
            check_name(name, known, name=key.removesuffix("s"), what=f"the system's {key}", place=(key, name))
            if channel not in measured:
                told = ", ".join(measured)
                raise invalid(f"channel must be one that is measured ({told}), got {channel!r}", key, name)
            check_unit(measured[channel], units.get(name, ""), channel=channel, port=(key, name))
    _check_parameters(request, diagram)


def _check_parameters(request: IdentificationRequest | ValidationRequest, diagram: Diagram) -> None:
    if isinstance(request, ValidationRequest):
        overrides_from_wire(request.parameters, diagram, place=("parameters",))
        return
    for k, choice in enumerate(request.parameters):
        path = choice if isinstance(choice, str) else choice.parameter
        if path not in diagram.parameters:
            raise invalid(no_parameter(path, diagram.parameters), "parameters", k)


def _read(step: FollowUpDocument) -> IdentificationRequest | ValidationRequest:
    body = {"dataset": _LATER, **step.body}
    model = IdentificationRequest if step.kind == "identification" else ValidationRequest
    try:
        return model.model_validate(body)
    except ValidationError as error:
        found = [{**entry, "loc": ("body", *entry["loc"])} for entry in error.errors()]
        raise validation_problem(found, body) from error
