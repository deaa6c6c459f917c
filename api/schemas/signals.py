"""The command signals, made from the catalogue; a sampled one may also name a channel of a dataset, some hold others."""

from __future__ import annotations

import functools
import operator
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from pydantic import Discriminator, Field, Tag, model_validator

from api.schemas.generated import document_of
from api.schemas.values import Document, Identifier, Path, Quantity
from engine.model.between_samples import BetweenSamples
from engine.signals import Signal, catalogue

MOST_POINTS = 100_000
"""Of a sampled command: the exact response costs up to a millisecond for each."""


class SampledSignal(Document):
    """A recorded or computed command: its points, or the channel of a dataset that holds them."""

    kind: Literal["sampled"]
    time: list[Quantity] | None = Field(default=None, min_length=2, max_length=MOST_POINTS, description="s, increasing")
    values: list[Quantity] | None = Field(default=None, min_length=2, max_length=MOST_POINTS)
    dataset: Identifier | None = None
    channel: str | None = Field(default=None, min_length=1, max_length=200)
    between_samples: BetweenSamples = Field(
        default=BetweenSamples.LINEAR,
        strict=False,  # a word on the wire
        description="hold: what a D/A converter puts out; band_limited: smooth, as behind an anti-aliasing filter",
    )

    @model_validator(mode="after")
    def _points_or_channel(self) -> SampledSignal:
        points = (self.time is not None, self.values is not None)
        channel = (self.dataset is not None, self.channel is not None)
        if (all(points) and not any(channel)) or (all(channel) and not any(points)):
            return self
        raise ValueError("must have either time and values, or dataset and channel")


if TYPE_CHECKING:
    SignalDocument: TypeAlias = Document  # the union is made from the catalogue when this module is imported
else:

    def _model(kind: str, signal: type[Signal]) -> type[Document]:
        inner = [param for param in signal.parameters if param.shape == "signal"]
        plain = [param for param in signal.parameters if param.shape != "signal"]
        # What a command is made of may be any command: the name is looked up here once the union exists.
        extra = {param.name: ("SignalDocument", Field(description=param.doc)) for param in inner}
        return document_of(kind, signal.title, plain, expressions=False, extra={"__module__": __name__, **extra})

    _MODELS: list[Any] = [_model(kind, signal) for kind, signal in catalogue().items() if kind != "sampled"]
    SignalDocument = Annotated[functools.reduce(operator.or_, [*_MODELS, SampledSignal]), Field(discriminator="kind")]
    for _made in _MODELS:
        _made.model_rebuild()


class InputDocument(Document):
    """The command that enters at one input block; other inputs are 0."""

    port: Path = Field(examples=["reference"])
    signal: SignalDocument


def _one_or_many(value: Any) -> str:
    return "many" if isinstance(value, list) else "one"


Inputs = Annotated[
    Annotated[InputDocument, Tag("one")]
    | Annotated[list[InputDocument], Field(min_length=1, max_length=50), Tag("many")],
    Discriminator(_one_or_many),
]
"""One command, or several at once."""
