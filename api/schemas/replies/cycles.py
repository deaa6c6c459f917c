"""Where nonlinear systems rest and swing."""

from __future__ import annotations

from pydantic import Field

from api.schemas.replies.base import Number, Reply


class PredictedCycleReply(Reply):
    """A limit cycle by the describing function of one block; one that is not stable parts what dies from what grows."""

    block: str
    frequency: Number = Field(description="rad/s")
    amplitude: Number = Field(description="of the fundamental at the block's input")
    outputs: dict[str, Number] = Field(description="amplitude of each output's fundamental")
    stable: bool


class LimitCycleReply(Reply):
    """What a response swings in for ever, beside what describing functions predict."""

    frequency: Number = Field(description="rad/s")
    outputs: dict[str, Number] = Field(description="amplitude of each output's fundamental")
    predictions: list[PredictedCycleReply]


class OperatingPointReply(Reply):
    """Where a nonlinear system is linearised; where it does not rest, at its initial state."""

    inputs: dict[str, Number]
    outputs: dict[str, Number]
    rests: bool
