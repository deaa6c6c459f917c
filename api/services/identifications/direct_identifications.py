"""Identifications without a system document, by a worker: black boxes, drives, static curves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import TypeAdapter
from sqlalchemy.orm import Session

from api.convert.direct_identifications import (
    black_box_from_wire,
    black_box_to_wire,
    drive_from_wire,
    drive_to_wire,
    static_curve_to_wire,
)
from api.convert.recordings import Values
from api.problems.pointers import Place
from api.schemas.identifications import AnyIdentification, BlackBoxRequest, DirectRequest, InverseDynamicsRequest
from api.services.jobs import jobs
from api.services.operation.app_context import Caller, Installation
from api.services.recordings.datasets import read_recording
from api.services.recordings.recordings import check_lengths
from api.settings import Settings
from optimizers.black_box import black_box, checked
from optimizers.estimation.inverse_dynamics import drive_parameters
from optimizers.estimation.static_curve import static_curve
from optimizers.recorded.recorded_data import clipped, held
from optimizers.search.limits import Limited
from optimizers.search.result import Monitor
from storage.session import Database

KIND = "identification"
_ADAPTER: TypeAdapter[Any] = TypeAdapter(AnyIdentification)


def prepare(service: Installation, caller: Caller, request: DirectRequest) -> None:
    """Prove that the recording is there and fits to what is asked.

    Raises
    ------
    api.problems.documents.Problem, EngineError
        422 with the place of what is wrong.
    """
    read = _Read(request, service.database, caller.workspace)
    if isinstance(request, BlackBoxRequest):
        experiment, settings = black_box_from_wire(request, read.channels, read.sample_time)
        room = service.settings.job_plan
        checked(experiment, settings["method"], settings["orders"], settings["largest_delay"], most_bytes=room)
    elif isinstance(request, InverseDynamicsRequest):
        drive_from_wire(request, read.channels, read.sample_time)


def submit(service: Installation, session: Session, caller: Caller, request: DirectRequest) -> dict[str, Any]:
    """Write the job down, in the caller's transaction."""
    body = {"request": request.model_dump(by_alias=True, exclude_unset=True, exclude={"queue"})}
    return jobs.enqueue(service, session, caller, kind=KIND, body=body, queue=request.queue)


def run(
    body: Mapping[str, Any], *, database: Database, workspace: str, monitor: Monitor, seconds: float | None = None
) -> dict[str, Any]:
    """Compute the model (in a worker), within so many ``seconds`` if it is a search, and return what is remembered of it."""
    request = _ADAPTER.validate_python(body["request"])
    read = _Read(request, database, workspace)
    if isinstance(request, BlackBoxRequest):
        experiment, settings = black_box_from_wire(request, read.channels, read.sample_time)
        model = black_box(experiment, monitor=Limited(monitor, seconds), most_bytes=Settings().job_plan, **settings)
        found, said = black_box_to_wire(model), list(model.warnings)
    elif isinstance(request, InverseDynamicsRequest):
        recording, treatment, terms = drive_from_wire(request, read.channels, read.sample_time)
        found, said = drive_to_wire(drive_parameters(recording, treatment, **terms)), read.clipped()
    else:
        signals = read.channels
        curve = static_curve(signals[request.input], signals[request.output], degree=request.degree)
        found, said = static_curve_to_wire(curve), read.clipped()
    return {**found, "method": request.method, "dataset": request.dataset, "datasets": [request.dataset], "system": None,
            "warnings": [{"pointer": "/dataset", "detail": sentence} for sentence in said]}  # fmt: skip


class _Read:
    """The channels that a request names, in SI."""

    def __init__(self, request: DirectRequest, database: Database, workspace: str) -> None:
        names = _names(request)
        read = read_recording(database, workspace, request.dataset, names)
        check_lengths({channel: read.channels[channel].size for channel in names.values()}, names)
        self.channels: Mapping[str, Values] = read.channels
        self.sample_time = read.sample_time

    def clipped(self) -> list[str]:
        """Return a sentence on each end at which a channel is cut."""
        moving = ((name, values) for name, values in self.channels.items() if not held(values))
        return [sentence for name, values in moving for sentence in clipped(name, values)]


def _names(request: DirectRequest) -> dict[Place, str]:
    """Return every channel by its place in the request."""
    if isinstance(request, BlackBoxRequest):
        found: dict[Place, str] = {("inputs", name): channel for name, channel in request.inputs.items()}
        return found | {("outputs", name): channel for name, channel in request.outputs.items()}
    if isinstance(request, InverseDynamicsRequest):
        motion: dict[Place, str | None] = {("position",): request.position, ("velocity",): request.velocity}
        found = {place: channel for place, channel in motion.items() if channel is not None}
        return {("force",): request.force, **found, **{("further", k): v for k, v in request.further.items()}}
    return {("input",): request.input, ("output",): request.output}
