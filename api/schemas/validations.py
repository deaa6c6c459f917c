"""The body of a validation: a model with given parameters against a recording."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from api.schemas.jobs import Channels, Window
from api.schemas.queue import QueueDocument
from api.schemas.systems import SystemRef
from api.schemas.values import Document, Identifier, Name, Overrides, Path, Quantity


class ValidationRequest(Document):
    """A model with given parameters against a recording."""

    system: SystemRef
    dataset: Identifier
    inputs: Channels = Field(description="input port -> channel")
    outputs: dict[Name, str] = Field(min_length=1, max_length=50, description="output -> channel")
    parameters: Overrides = Field(default_factory=dict, description="adjusted values; the document's are the theory")
    identification: Identifier | None = Field(
        default=None,
        description="a finished identification whose parameters (and offsets) are taken where none is given",
    )
    offsets: dict[Name, Quantity] | Literal["none", "estimate"] = Field(
        default="none", description="a constant for each output: given, estimated, or none"
    )
    window: Window | None = None
    limit_percent: float = Field(default=10.0, gt=0.0)
    diagnose: Literal["failed", "always", "never"] = Field(
        default="failed", description="when to look for what would make the error smaller"
    )
    movable: list[Path] | None = Field(
        default=None,
        max_length=50,
        description="parameters that the diagnosis may move; by default those of the system, else of its blocks",
    )
    points: int | None = Field(
        default=None, ge=2, description="most points of each curve in the reply; every sample by default"
    )
    keep: bool = False
    queue: QueueDocument | None = Field(default=None, description="of the job, where a worker does it")
