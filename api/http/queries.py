"""A query says each thing once: of two values the framework takes the last, and whoever wrote the first never hears of it."""

from __future__ import annotations

from collections import Counter
from typing import Any, get_args, get_origin

from fastapi import Request
from fastapi.dependencies.models import Dependant
from fastapi.dependencies.utils import get_flat_params
from fastapi.params import Query

from api.problems.documents import Fault, invalid_document


async def once(request: Request) -> None:
    """Refuse a parameter of the query that has one value and is given several.

    Raises
    ------
    Problem
        422 naming each of them.
    """
    given = Counter(name for name, _ in request.query_params.multi_items())
    repeated = {name: count for name, count in given.items() if count > 1}
    if not repeated:
        return
    single = _single(request.scope["route"].dependant)
    faults = [
        Fault(place=(name,), detail=f"query parameter {name} must stand once, got it {count} times")
        for name, count in repeated.items()
        if name in single
    ]
    if faults:
        raise invalid_document(faults)


def _single(dependant: Dependant) -> set[str]:
    """Return the parameters of a route's query that have one value."""
    fields = [field for field in get_flat_params(dependant) if isinstance(field.field_info, Query)]
    return {field.alias for field in fields if not _has_several(field.field_info.annotation)}


def _has_several(annotation: Any) -> bool:
    """Whether this is a list, or a list or nothing."""
    return any(get_origin(one) is list for one in (annotation, *get_args(annotation)))
