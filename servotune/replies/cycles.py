"""Where nonlinear systems rest and swing."""

from __future__ import annotations

from servotune.replies.base import Reply


class PredictedCycle(Reply):
    """A limit cycle (rad/s) by the describing function of one block; ``amplitude`` is that at the block's input."""

    block: str
    frequency: float
    amplitude: float
    outputs: dict[str, float]
    stable: bool


class LimitCycle(Reply):
    """What a response swings in for ever (rad/s, amplitudes of the fundamental), beside what is predicted."""

    frequency: float
    outputs: dict[str, float]
    predictions: list[PredictedCycle]


class OperatingPoint(Reply):
    """Where a nonlinear system is linearised (SI)."""

    inputs: dict[str, float]
    outputs: dict[str, float]
    rests: bool
