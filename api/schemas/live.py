"""What a front panel says over `/v1/live`: open a system once, then name values again and again."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from api.schemas.signals import Inputs
from api.schemas.studies import Names
from api.schemas.systems import SystemRef
from api.schemas.values import AutoOrQuantity, Document, Identifier, OpenAt, Path, Port

MOST_VECTORS = 12
"""Of one message: the moving curve, its reference, snapshots, comparisons."""
MOST_OVERLAYS = 4
"""Recorded channels that are seen over the curves."""


class LiveFrequency(Document):
    """The loop opened at a block's output, or a path from an input to an output."""

    open_at: OpenAt | None = None
    source: Port | None = Field(default=None, alias="from")
    target: Port | None = Field(default=None, alias="to")

    @model_validator(mode="after")
    def _loop_or_path(self) -> LiveFrequency:
        if (self.open_at is None) == (self.source is None) or (self.source is None) != (self.target is None):
            raise ValueError("must have either open_at, or from and to")
        return self


class LiveMeasured(Document):
    """A recorded channel to be seen over the curve of an output."""

    output: Path
    dataset: Identifier
    channel: str = Field(min_length=1, max_length=200)
    start: float = Field(
        default=0.0, allow_inf_nan=False, description="s of the recording at which the model's time is 0"
    )
    relative: bool = Field(default=False, description="its change since then, for a model that starts from 0")


class LiveOpen(Document):
    """Begin, or begin anew with another system or other curves."""

    type: Literal["open"]
    system: SystemRef
    parameters: list[Path] = Field(default_factory=list, max_length=50, description="what the vectors are made of")
    input: Inputs | None = Field(default=None, description="default: a unit step at the first input")
    outputs: Names | None = Field(default=None, description="default: all")
    frequency: LiveFrequency | None = None
    metrics: Names = Field(default_factory=list, description="measured when the values rest")
    output: Path | None = Field(default=None, description="whose time metrics are measured; default: the first")
    duration: AutoOrQuantity = "auto"
    measured: list[LiveMeasured] = Field(default_factory=list, max_length=MOST_OVERLAYS)
    samples: int = Field(default=1000, ge=2, le=20_000)


class LiveSet(Document):
    """Compute the curves at these values; what was asked for before and not answered yet is forgotten."""

    type: Literal["set"]
    seq: int = Field(ge=0)
    vectors: list[Annotated[list[float], Field(max_length=50)]] = Field(min_length=1, max_length=MOST_VECTORS)
    measure: int = Field(default=1, ge=0, le=MOST_VECTORS, description="how many of the vectors, the first ones")


LiveMessage = Annotated[LiveOpen | LiveSet, Field(discriminator="type")]
