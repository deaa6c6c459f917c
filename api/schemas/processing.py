"""The body of a processing: which recordings, and what is done to them step by step."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from api.schemas.datasets import ChannelName
from api.schemas.queue import QueueDocument
from api.schemas.values import Document, Identifier, Quantity, SampleRate, is_scalar_quantity

Names = Annotated[list[ChannelName], Field(min_length=1, max_length=500)]
_SOME = "all channels by default"


class CalibrateStep(Document):
    """value = scale x + offset, in a new unit: volts into the force that they command."""

    kind: Literal["calibrate"]
    channel: ChannelName
    scale: float
    offset: float = 0.0
    unit: str | None = Field(default=None, max_length=64, description="the channel's by default")


class DetrendStep(Document):
    """The mean, or the line of the least squares, is taken away."""

    kind: Literal["detrend"]
    trend: Literal["mean", "linear"] = "mean"
    channels: Names | None = Field(default=None, description=_SOME)


def _one_or_two(value: Any) -> str:
    return "one" if is_scalar_quantity(value) else "two"


Edges = Annotated[
    Annotated[Quantity, Tag("one")]
    | Annotated[list[Quantity], Field(min_length=2, max_length=2, description="rad/s"), Tag("two")],
    Discriminator(_one_or_two),
]


class FilterStep(Document):
    """A filter that runs forward and backward: its magnitude counts twice, nothing is delayed."""

    kind: Literal["filter"]
    band: Literal["low_pass", "high_pass", "band_pass", "band_stop"]
    frequency: Edges = Field(description="edge of one pass, rad/s; two edges of a band")
    order: int = Field(default=4, ge=1, le=20, description="of one pass")
    family: Literal["butterworth", "chebyshev1"] = "butterworth"
    ripple: float = Field(default=0.05, gt=0.0, le=10.0, description="of one pass, dB; chebyshev1")
    channels: Names | None = Field(default=None, description=_SOME)


class ResampleStep(Document):
    """Another sample rate, a rational multiple of the old one; a linear-phase low pass keeps out what would be folded.

    A recording with uneven instants becomes an even one by interpolation, which is its first step.
    """

    kind: Literal["resample"]
    rate: SampleRate = Field(description="samples per second; of uneven instants at least their mean rate")
    method: Literal["linear", "cubic"] | None = Field(
        default=None, description="of interpolation, for uneven instants only; linear by default"
    )
    longest: Quantity | None = Field(
        default=None,
        description="s, for uneven instants only: between samples further apart they are missing; ten median steps by default",
    )


class DecimateStep(Document):
    """One sample of `factor`, after a Chebyshev low pass that runs forward and backward."""

    kind: Literal["decimate"]
    factor: int = Field(ge=2, le=100)
    order: int = Field(default=8, ge=1, le=20, description="of one pass")
    ripple: float = Field(default=0.05, gt=0.0, le=10.0, description="of one pass, dB")
    keep: Literal["first", "last"] = Field(default="first", description="the end that is certainly kept")


class CutStep(Document):
    """The samples from `start` to `end`, both included."""

    kind: Literal["cut"]
    start: Quantity | None = Field(default=None, description="s from the first sample")
    end: Quantity | None = Field(default=None, description="s from the first sample")


class DifferentiateStep(Document):
    """The derivative by central differences, after a zero-phase Butterworth low pass where one is stated."""

    kind: Literal["differentiate"]
    channel: ChannelName
    name: ChannelName | None = Field(default=None, description="of the derivative; by default it replaces the channel")
    low_pass: Quantity | None = Field(default=None, description="rad/s")
    order: int = Field(default=4, ge=1, le=20, description="of one pass of the low pass")


class IntegrateStep(Document):
    """The integral by trapezoids, with a zero-phase Butterworth high pass after it where one is stated."""

    kind: Literal["integrate"]
    channel: ChannelName
    name: ChannelName | None = Field(default=None, description="of the integral; by default it replaces the channel")
    high_pass: Quantity | None = Field(default=None, description="rad/s")
    order: int = Field(default=2, ge=1, le=20, description="of one pass of the high pass")


class SelectStep(Document):
    """Only these channels, in this order."""

    kind: Literal["select"]
    channels: Names


class FillStep(Document):
    """Missing samples on the line between their neighbours."""

    kind: Literal["fill"]
    longest: Quantity = Field(description="s: longer gaps are refused")
    channels: Names | None = Field(default=None, description=_SOME)


StepDocument = Annotated[
    CalibrateStep
    | CutStep
    | DecimateStep
    | DetrendStep
    | DifferentiateStep
    | FillStep
    | FilterStep
    | IntegrateStep
    | ResampleStep
    | SelectStep,
    Field(discriminator="kind"),
]


class ProcessingRequest(Document):
    """A recording made from others, which stay as they are."""

    name: str = Field(min_length=1, max_length=200)
    sources: list[Identifier] = Field(
        min_length=1, max_length=100, description="recordings; the steps are done to each experiment by itself"
    )
    combine: Literal["append", "side_by_side"] = Field(
        default="append",
        description="several sources: experiments after one another, or channels beside one another",
    )
    steps: list[StepDocument] = Field(default_factory=list, max_length=100)
    queue: QueueDocument | None = Field(default=None, description="of the job, where a worker does it")
