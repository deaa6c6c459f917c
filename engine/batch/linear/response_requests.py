"""The requests of the responses to one command, and what the march and the readings need of them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from engine.batch.linear.commands import Command, commanded
from engine.batch.linear.evaluate import Drive
from engine.batch.linear.pieces import Plan
from engine.model.masks import Envelope, Polyline

if TYPE_CHECKING:
    from engine.analysis.measuring import MetricRequest

INTEGRALS: Final = frozenset({"iae", "ise", "itae", "ie"})
_RESPONSE_BAND: Final = 0.05
_PERIODS: Final = 3.0


@dataclass(kw_only=True, eq=False)
class ResponseRequests:
    """The requests of the responses to one command: ``columns`` of the results, with the number of the output of each."""

    inputs: list[int]
    signals: list[Any]
    columns: list[int] = field(default_factory=list)
    requests: list[MetricRequest] = field(default_factory=list)
    orders: list[int] = field(default_factory=list)
    outputs: list[int] = field(default_factory=list)

    def add(self, column: int, request: MetricRequest, order: int, output: int) -> None:
        """Add the derivative of some order of an output."""
        self.columns.append(column)
        self.requests.append(request)
        self.orders.append(order)
        self.outputs.append(output)

    def of(self, outputs: Collection[int]) -> ResponseRequests:
        """Return the requests of some of the outputs."""
        if len(outputs) == len(set(self.outputs)):
            return self
        part = ResponseRequests(inputs=self.inputs, signals=self.signals)
        for own in zip(self.columns, self.requests, self.orders, self.outputs, strict=True):
            if own[3] in outputs:
                part.add(*own)
        return part

    @property
    def marks(self) -> list[float]:
        """Instants at which pieces must end, s."""
        found = {self.loading}
        for request in self.requests:
            if request.duration is not None:
                found.add(request.duration)
            found.update(t for line, _ in lines_of(request) for t in line.times)
        return sorted(found)

    @cached_property
    def loading(self) -> float:
        """When the last command begins, s."""
        return max((s.breakpoints()[0] for s in self.signals if s.breakpoints()), default=0.0)

    @cached_property
    def start(self) -> float:
        """When the first command begins, s."""
        return min((t for s in self.signals for t in s.breakpoints()), default=0.0)

    @cached_property
    def endless(self) -> bool:
        """Whether a command never settles."""
        return any(s.final() is None for s in self.signals)

    @cached_property
    def beyond(self) -> float:
        """How much longer than a lifetime an endless command is followed, s."""
        last = max((t for s in self.signals for t in (*s.breakpoints(), s.end() or 0.0)), default=0.0)
        return last + _PERIODS * max((s.repeats_after() or 0.0 for s in self.signals), default=0.0)

    @cached_property
    def until(self) -> float:
        """Up to when the requests look, s: infinite where one has no duration."""
        ends = []
        for request in self.requests:
            until = request.duration if within(request) else None
            whole = np.inf if until is None else until
            ends.append(max((line.times[-1] for line, _ in lines_of(request)), default=whole))
        return max(ends)

    def command(self, horizon: float) -> Command:
        """Return the command as states."""
        return commanded(self.signals, horizon, self.marks)


def within(request: MetricRequest) -> bool:
    """Return whether a request looks no further than its duration."""
    return request.windowed or request.metric in INTEGRALS or request.metric == "control_effort_rms"


def lines_of(request: MetricRequest) -> list[tuple[Polyline, float]]:
    """Return the straight lines that a response is held against, each with the side that is looked at."""
    if request.metric == "tracking_error" and isinstance(request.mask, Polyline):
        return [(request.mask, 1.0)]
    if request.metric == "envelope" and isinstance(request.mask, Envelope):
        return list(request.mask.sides)
    return []


def number_of(request: MetricRequest) -> float:
    """Return the number that a reading takes: a band, a duration or a unit."""
    if request.metric == "settling_time":
        return request.options.settling_band
    if request.metric == "response_time":
        return _RESPONSE_BAND
    if request.metric == "recovery_time":
        return float(request.options.recovery_band or 0.0)
    if isinstance(request.mask, Envelope):
        return request.mask.unit
    return float(request.duration or 0.0)


def lines_within(k: int, request: MetricRequest, command: Command) -> list[tuple[float, ...]]:
    """Return the straight lines of request ``k``: its number, first and last corner, start (s), value, slope, and the side."""
    return [
        (
            k, int(np.searchsorted(command.times, part.start)), int(np.searchsorted(command.times, part.end)),
            part.start, part.value, part.slope, sign,
        )
        for line, sign in lines_of(request)
        for part in line.segments
    ]  # fmt: skip


def plan_of(response: ResponseRequests, command: Command) -> tuple[Plan, Drive]:
    """Return the corners at which a command is set, and what it is in the equations."""
    last = -1 if command.endless else int(np.searchsorted(command.times, command.last))
    climbs = command.endless and not command.turning and all(s.repeats_after() is None for s in response.signals)
    plan = Plan(times=command.times, states=command.states, last=last, impulses=command.impulses)
    drive = Drive(
        flow=command.flow, drive=command.drive, jumps=command.jumps, sizes=np.abs(command.states).max(axis=0),
        rate=command.rate, climbs=int(climbs),
    )  # fmt: skip
    return plan, drive
