"""The optimisation methods and their options, made from the catalogue."""

from __future__ import annotations

import functools
import operator
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from pydantic import Field, create_model

from api.schemas.values import Document
from engine.model.parameters import Param
from optimizers.methods import Method, catalogue


def _option(param: Param) -> tuple[Any, Any]:
    """A text of the choices, a whole number, or a whole number for each variable; the method itself checks more."""
    kind: Any = Literal[param.choices] if param.choices else int | dict[str, int]
    return kind | None, Field(default=None, description=f"{param.doc} (default {param.default})")


def _model(method: type[Method]) -> type[Document]:
    fields: dict[str, Any] = {"kind": (Literal[method.kind], Field(description=method.title))}
    fields |= {param.name: _option(param) for param in method.options}
    name = "".join(part.capitalize() for part in method.kind.split("_"))
    return create_model(f"{name}Method", __doc__=method.title, __base__=Document, **fields)


if TYPE_CHECKING:
    MethodDocument: TypeAlias = Document  # the union is made from the catalogue when this module is imported
else:
    MethodDocument = Annotated[
        functools.reduce(operator.or_, [_model(method) for method in catalogue().values()]),
        Field(discriminator="kind"),
    ]
