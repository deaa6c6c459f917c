"""The system document: blocks, connections, parameters and outputs."""

from __future__ import annotations

import functools
import operator
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from pydantic import BeforeValidator, Discriminator, Field, Tag

from api.schemas.control_laws import KINDS, LimitedBlock
from api.schemas.generated import document_of
from api.schemas.values import Document, Identifier, Name, Path, Quantity, Scalar, is_number
from engine.elements import catalogue

MAX_BLOCKS = 500
"""Of one document; the core counts those of its subsystems too."""


class ParameterDocument(Document):
    """A named value that blocks share through expressions, with the bounds within which it may be chosen."""

    value: Scalar
    unit: str | None = Field(default=None, min_length=1, max_length=64, description="unit of a bare `value`")
    lower: Quantity | None = Field(default=None, description="smallest value that an optimisation may take")
    upper: Quantity | None = Field(default=None, description="largest value that an optimisation may take")
    scale: Literal["linear", "log"] | None = None
    doc: str = Field(default="", max_length=2000)


def _with_value(given: Any) -> Any:
    """Return a bare value as the parameter that has it, and nothing else said of it."""
    return {"value": given} if is_number(given) or isinstance(given, str) else given


Parameters = dict[
    Name, Annotated[ParameterDocument, BeforeValidator(_with_value, json_schema_input_type=Scalar | ParameterDocument)]
]
"""Parameters by name; a number or an expression alone is the value of one."""


class ConnectionDocument(Document):
    """A signal from an output port to an input port."""

    source: Path = Field(alias="from", examples=["motor.position"])
    target: Path = Field(alias="to", examples=["error.in2"])


class SubsystemBlock(Document):
    """A block that is a system itself: its inputs and outputs are the ports."""

    kind: Literal["subsystem"]
    system: SystemDocument


if TYPE_CHECKING:
    BlockDocument: TypeAlias = Document  # the union is made from the catalogue when this module is imported
else:
    _MODELS = [
        document_of(
            kind,
            element.title,
            element.parameters,
            expressions=True,
            base=LimitedBlock if kind in KINDS else Document,
        )
        for kind, element in catalogue().items()
    ]
    BlockDocument = Annotated[functools.reduce(operator.or_, [*_MODELS, SubsystemBlock]), Field(discriminator="kind")]


class SystemDocument(Document):
    """A diagram of blocks."""

    name: str = Field(default="", max_length=200)
    doc: str = Field(default="", max_length=20_000)
    parameters: Parameters = Field(default_factory=dict)
    blocks: dict[Name, BlockDocument] = Field(min_length=1, max_length=MAX_BLOCKS)
    connections: list[ConnectionDocument] = Field(default_factory=list)
    outputs: dict[Name, Path] = Field(min_length=1, examples=[{"position": "motor.position"}])


SubsystemBlock.model_rebuild()
SystemDocument.model_rebuild()


def _reference_or_document(value: Any) -> str:
    return "reference" if isinstance(value, str) else "document"


SystemRef = Annotated[
    Annotated[Identifier, Tag("reference")] | Annotated[SystemDocument, Tag("document")],
    Discriminator(_reference_or_document),
]
"""The identifier of a stored system, or the document itself."""
