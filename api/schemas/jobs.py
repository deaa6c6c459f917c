"""The body of an identification: what a measurement asks for."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from api.schemas.queue import QueueDocument
from api.schemas.systems import SystemRef
from api.schemas.values import Document, Identifier, Name, Path, Quantity

Window = Annotated[list[Quantity], Field(min_length=2, max_length=2, description="[t0, t1] in s")]


class IdentifiedParameter(Document):
    """A parameter to estimate, with bounds and start where they are not those of the parameter itself."""

    parameter: Path
    lower: Quantity | None = None
    upper: Quantity | None = None
    start: Quantity | None = None


def _path_or_document(value: Any) -> str:
    return "path" if isinstance(value, str) else "document"


ParameterChoice = Annotated[
    Annotated[Path, Tag("path")] | Annotated[IdentifiedParameter, Tag("document")], Discriminator(_path_or_document)
]
Channels = Annotated[dict[Path, str], Field(min_length=1, max_length=50)]


class IdentificationRequest(Document):
    """A model, a recording, what is measured where, and what is to be estimated."""

    system: SystemRef
    dataset: Identifier
    inputs: Channels = Field(description="input port -> channel")
    outputs: dict[Name, str] = Field(min_length=1, max_length=50, description="output -> channel")
    parameters: list[ParameterChoice] = Field(min_length=1, max_length=50)
    split: float = Field(default=0.5, gt=0.0, lt=1.0, description="share of the recording that estimates")
    offsets: Literal["none", "estimate"] = "none"
    estimation: Window | None = None
    validation: Window | None = None
    queue: QueueDocument | None = None
