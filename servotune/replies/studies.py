"""Responses in time and over frequency."""

from __future__ import annotations

from typing import NotRequired, TypedDict

from servotune.replies.cycles import LimitCycle, OperatingPoint, PredictedCycle
from servotune.replies.values import Metric, Root, Warned


class SimulationVariant(TypedDict):
    """The responses of one set of parameter values."""

    parameters: dict[str, float]
    verdict: str
    time: list[float]
    outputs: dict[str, list[float]]
    metrics: dict[str, dict[str, Metric]]
    error_estimate: NotRequired[float | None]
    limit_cycle: NotRequired[LimitCycle | None]


class Simulation(TypedDict):
    """Responses to a command."""

    variants: list[SimulationVariant]
    warnings: NotRequired[list[Warned]]


class Crossing(TypedDict):
    """One crossing of the open loop and the margin there."""

    frequency: float
    value: float


class Margins(TypedDict):
    """Every crossing of the open loop where its gain is `smallest_loop_gain` or more."""

    gain: list[Crossing]
    phase: list[Crossing]
    delay: list[Crossing]
    smallest_loop_gain: float


class Nyquist(TypedDict):
    """The Nyquist criterion: closed-loop unstable poles = open-loop unstable poles - encirclements of -1."""

    encirclements: int
    open_loop_unstable_poles: int
    closed_loop_unstable_poles: int


class Unbounded(TypedDict):
    """A frequency at which the response is null, since it meets a pole on the imaginary axis."""

    frequency: float
    verdict: str
    advice: str


FrequencyPath = TypedDict(
    "FrequencyPath",
    {
        "from": str, "to": str, "frequency": list[float], "magnitude": list[float | None], "phase": list[float | None],
        "real": list[float | None], "imag": list[float | None], "metrics": dict[str, Metric], "zeros": list[Root] | None,
        "unbounded": NotRequired[list[Unbounded] | None],
    },
)  # fmt: skip
"""One of several paths of a frequency response; `zeros` is null where delays make them endless."""


class FrequencyVariant(TypedDict):
    """The frequency response of one set of parameter values (rad/s, rad)."""

    parameters: dict[str, float]
    verdict: str
    frequency: list[float]
    magnitude: list[float | None]
    phase: list[float | None]
    real: list[float | None]
    imag: list[float | None]
    metrics: dict[str, Metric]
    margins: NotRequired[Margins | None]
    nyquist: NotRequired[Nyquist | None]
    poles: list[Root]
    zeros: NotRequired[list[Root] | None]
    paths: NotRequired[list[FrequencyPath] | None]
    unbounded: NotRequired[list[Unbounded] | None]
    operating_point: NotRequired[OperatingPoint | None]
    limit_cycles: NotRequired[list[PredictedCycle] | None]


class FrequencyResponse(TypedDict):
    """Frequency responses."""

    variants: list[FrequencyVariant]
    warnings: NotRequired[list[Warned]]
