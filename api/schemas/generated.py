"""Pydantic models made from declared parameters, so that a catalogue entry is written once, in the core."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, Literal

from pydantic import Field, create_model

from api.schemas.values import Document, Name, Quantity, Root, Rows, Scalar, Scalars
from engine.model.parameters import Param


def document_of(
    kind: str,
    title: str,
    parameters: Iterable[Param],
    *,
    expressions: bool,
    extra: dict[str, Any] | None = None,
    base: type[Document] = Document,
) -> type[Document]:
    """Return the model of ``{"kind": kind, parameter: value, ...}``.

    Parameters
    ----------
    kind : str
        The value of ``kind`` that chooses this model.
    title : str
        One sentence for the API reference.
    parameters : iterable of Param
        What the catalogue declares.
    expressions : bool
        Whether a value may be an expression (blocks), or only a number or quantity (signals).
    extra : mapping
        Further fields, as ``create_model`` takes them.
    base : type
        What else such a document has.
    """
    fields: dict[str, Any] = {"kind": (Literal[kind], Field(description=title))}
    for param in parameters:
        fields[param.name] = _field(param, expressions=expressions)
    name = "".join(part.capitalize() for part in kind.split("_"))
    return create_model(
        f"{name}{'Block' if expressions else 'Signal'}", __doc__=title, __base__=base, **fields, **(extra or {})
    )


def _field(param: Param, *, expressions: bool) -> tuple[Any, Any]:
    scalar = Scalar if expressions else Quantity
    shapes: dict[str, Any] = {
        "scalar": scalar, "list": Scalars, "lists": Rows, "roots": list[Root], "matrix": Rows, "text": str, "integer": int,
        "names": list[Name],
    }  # fmt: skip
    kind = Literal[param.choices] if param.choices else shapes[param.shape]
    extra: dict[str, Any] = {"x-symbol": param.symbol, "x-unit": param.unit, "x-scale": param.scale}
    if math.isfinite(param.lower):
        extra["x-lower"] = param.lower
    if math.isfinite(param.upper):
        extra["x-upper"] = param.upper
    if param.required and param.default is None:
        return kind, Field(description=param.doc, json_schema_extra=extra)
    # An explicit null is refused: leaving a parameter out is how it is left out.
    return kind, Field(default=param.default, description=param.doc, json_schema_extra=extra)
