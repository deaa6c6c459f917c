"""The values that documents are made of: numbers, quantities, expressions, names.

A value is checked by one function instead of a union of models, so that a wrong one gives one sentence at one place.
"""

from __future__ import annotations

import re
import sys
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, PlainValidator, Tag, WithJsonSchema
from pydantic_core import PydanticCustomError
from typing_extensions import TypeAliasType

from engine.model.metric_options import MEANINGS
from engine.recordings.sample_rates import LEAST_RATE, MOST_RATE

NAME = "^[A-Za-z][A-Za-z0-9_]*$"
PATH = "^[A-Za-z][A-Za-z0-9_]*(\\.[A-Za-z][A-Za-z0-9_]*)*$"


SampleRate = Annotated[float, Field(ge=LEAST_RATE, le=MOST_RATE)]
"""Samples per second of a recording, wherever a request says it."""


class Document(BaseModel):
    """Base of every request: unknown fields refused, no conversion between types, finite numbers."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


_LONGEST = 100
_WRITTEN = re.compile(
    r"\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)(?:\s*([^\s0-9.,=+*/-][^=]*?)|\s+(1/[^=]*?))\s*"
)
"""A number, and a unit that begins with no digit but that of 1/s."""


def _wrong(rule: str, got: Any) -> PydanticCustomError:
    shown = repr(got)
    shown = shown if len(shown) <= 60 else shown[:57] + "..."
    return PydanticCustomError("value", "must be {rule}, got {got}", {"rule": rule, "got": shown})


def is_number(value: Any) -> bool:
    """Say whether a JSON value is a finite number (true and false are none)."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def is_quantity(value: Any) -> bool:
    """Say whether a JSON value is {"value": number, "unit": text} and nothing else."""
    return (
        isinstance(value, dict)
        and set(value) == {"value", "unit"}
        and is_number(value["value"])
        and isinstance(value["unit"], str)
        and value["unit"] != ""
    )


def quantity_of(value: Any) -> Any:
    """Return a quantity written as a text, "50 deg" say, as {"value", "unit"}; anything else as it is."""
    written = _WRITTEN.fullmatch(value) if isinstance(value, str) and len(value) <= _LONGEST else None
    return value if written is None else {"value": float(written[1]), "unit": written[2] or written[3]}


def is_expression(value: Any) -> bool:
    """Say whether a JSON value is text that begins with "="."""
    return isinstance(value, str) and value.startswith("=")


def _quantity(value: Any) -> Any:
    found = quantity_of(value)
    if is_number(found) or is_quantity(found):
        return found
    raise _wrong('a number or a quantity {"value", "unit"} or "50 deg"', value)


def _scalar(value: Any) -> Any:
    found = quantity_of(value)
    if is_number(found) or is_quantity(found) or is_expression(found):
        return found
    raise _wrong('a number, a quantity {"value", "unit"} or "50 deg", or an expression "=..."', value)


def _root(value: Any) -> Any:
    if isinstance(value, list) and len(value) == 2 and all(is_number(part) for part in value):
        return value
    found = quantity_of(value)
    if is_number(found) or is_quantity(found) or is_expression(found):
        return found
    raise _wrong("a number, a quantity, an expression or [real, imaginary]", value)


QUANTITY_SCHEMA: dict[str, Any] = {
    "type": "object",
    "required": ["value", "unit"],
    "additionalProperties": False,
    "properties": {"value": {"type": "number"}, "unit": {"type": "string", "minLength": 1, "examples": ["cm**2"]}},
}
_NUMBER: dict[str, Any] = {"type": "number", "description": "in the declared SI unit"}
_EXPRESSION: dict[str, Any] = {"type": "string", "pattern": "^=", "examples": ["=kp/20"]}
_TEXT: dict[str, Any] = {
    "type": "string", "pattern": f"^{_WRITTEN.pattern}$", "maxLength": _LONGEST, "description": "a number with its unit",
    "examples": ["50 deg", "6 dB", "5 %"],
}  # fmt: skip
_QUANTITIES: list[dict[str, Any]] = [_NUMBER, QUANTITY_SCHEMA, _TEXT]
_QUANTITY_OR_NUMBER = {"anyOf": _QUANTITIES}
SCALAR_SCHEMA: dict[str, Any] = {"anyOf": [*_QUANTITIES, _EXPRESSION]}

Quantity = TypeAliasType(
    "Quantity",
    Annotated[Any, PlainValidator(_quantity), WithJsonSchema(_QUANTITY_OR_NUMBER)],
)
"""A number in SI, {"value", "unit"}, or both as a text: "50 deg"."""
Scalar = TypeAliasType(
    "Scalar",
    Annotated[Any, PlainValidator(_scalar), WithJsonSchema(SCALAR_SCHEMA)],
)
"""A number in SI, a quantity, or an expression."""
Root = TypeAliasType(
    "Root",
    Annotated[
        Any,
        PlainValidator(_root),
        WithJsonSchema(
            {"anyOf": [SCALAR_SCHEMA, {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}]}
        ),
    ],
)
"""A zero or pole: real as a scalar, complex as [real, imaginary]."""
Scalars = Annotated[list[Scalar], Field(min_length=1, max_length=100_000)]
Rows = Annotated[list[list[Scalar]], Field(max_length=500)]
Name = Annotated[str, Field(pattern=NAME, max_length=64)]
Path = Annotated[str, Field(pattern=PATH, max_length=300)]
Port = Path
Identifier = Annotated[str, Field(min_length=1, max_length=64)]
Overrides = Annotated[dict[Path, Quantity], Field(description="parameter path -> value", max_length=200)]


def _change(value: Any) -> Any:
    value = quantity_of(value)
    if is_number(value) or is_quantity(value):
        return value
    if isinstance(value, dict) and set(value) == {"change"} and is_number(value["change"]) and value["change"] != 0:
        return value
    raise _wrong('a new value (number or {"value", "unit"}) or {"change": relative change, not 0}', value)


_CHANGE_SCHEMA: dict[str, Any] = {
    "type": "object",
    "required": ["change"],
    "additionalProperties": False,
    "properties": {"change": {"type": "number", "description": "relative, not 0", "examples": [0.1]}},
}
Change = TypeAliasType(
    "Change",
    Annotated[Any, PlainValidator(_change), WithJsonSchema({"anyOf": [*_QUANTITIES, _CHANGE_SCHEMA]})],
)
"""A new value, or a relative change of the present one."""


def _auto_or_quantity(value: Any) -> Any:
    value = quantity_of(value)
    if value == "auto" or is_number(value) or is_quantity(value):
        return value
    raise _wrong('"auto", a number or a quantity {"value", "unit"}', value)


AutoOrQuantity = TypeAliasType(
    "AutoOrQuantity",
    Annotated[
        Any,
        PlainValidator(_auto_or_quantity),
        WithJsonSchema({"anyOf": [{"const": "auto"}, *_QUANTITIES]}),
    ],
)
"""A quantity, or "auto": the service chooses."""


def _auto_or_quantities(value: Any) -> Any:
    value = [quantity_of(item) for item in value] if isinstance(value, list) else value
    if value == "auto" or (isinstance(value, list) and len(value) > 0 and all(map(is_scalar_quantity, value))):
        return value
    raise _wrong('"auto" or a list of numbers or quantities', value)


def is_scalar_quantity(value: Any) -> bool:
    """Say whether a JSON value is a number or a quantity, as a text or not."""
    return is_number(value) or is_quantity(quantity_of(value))


AutoOrQuantities = TypeAliasType(
    "AutoOrQuantities",
    Annotated[
        Any,
        PlainValidator(_auto_or_quantities),
        WithJsonSchema({"anyOf": [{"const": "auto"}, {"type": "array", "minItems": 1, "items": _QUANTITY_OR_NUMBER}]}),
    ],
)
"""A list of quantities, or "auto"."""

Band = Annotated[list[Quantity], Field(min_length=2, max_length=2, description="[low, high] in rad/s")]


def _place_or_places(value: Any) -> str:
    return "places" if isinstance(value, list) else "place"


OpenAt = Annotated[
    Annotated[Port, Tag("place")] | Annotated[list[Port], Field(min_length=1, max_length=20), Tag("places")],
    Discriminator(_place_or_places),
    Field(
        description="an output, or several opened together: the loop is cut at the first, the others are 0 from there on"
    ),
]
"""Where a loop is opened."""


class OfResponses(Document):
    """Numbers that metrics of a response take."""

    settling_band: Quantity | None = Field(default=None, description=f"{MEANINGS['settling_band']}; default 0.02")
    recovery_band: Quantity | None = Field(default=None, description=MEANINGS["recovery_band"])
    derivative: Literal[0, 1, 2] | None = Field(
        default=None, description=f"{MEANINGS['derivative']}; follows from the output's unit where that says it"
    )


class OfPaths(Document):
    """Numbers that metrics of a path take."""

    noise_density: Quantity | None = Field(default=None, description=MEANINGS["noise_density"])
