"""Places in a JSON document: RFC 6901 pointers, and what pydantic calls a location.

A place is a tuple of keys and indices counted from the root of the request body; "/" and "~" in a key are escaped.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Place = tuple[str | int, ...]


def pointer(place: Sequence[str | int]) -> str:
    """Return the RFC 6901 pointer of a place.

    >>> pointer(("system", "blocks", "motor", "area"))
    '/system/blocks/motor/area'
    >>> pointer(())
    ''
    """
    return "".join("/" + str(part).replace("~", "~0").replace("/", "~1") for part in place)


def place_in(body: Any, location: Sequence[str | int], *, names_a_field: bool) -> Place:
    """Return where in ``body`` a pydantic location points.

    Pydantic puts the tag of a union's chosen member into its locations; a tag is no part of the document. Every
    union over objects here is tagged by ``kind``, so a part equal to the object's ``kind`` is the tag (once).

    Parameters
    ----------
    body : JSON value
        The document that was validated.
    location : sequence of str or int
        pydantic's ``loc`` without its leading "body".
    names_a_field : bool
        True where the last part is a key that need not be in the document (missing or not allowed).
    """
    place: list[str | int] = []
    node = body
    tag_seen = False
    for i, part in enumerate(location):
        if isinstance(node, dict) and not tag_seen and node.get("kind") == part:
            tag_seen = True
        elif isinstance(node, dict) and part in node:
            node, tag_seen = node[str(part)], False
            place.append(part)
        elif isinstance(node, list) and isinstance(part, int) and 0 <= part < len(node):
            node, tag_seen = node[part], False
            place.append(part)
        elif names_a_field and i == len(location) - 1:
            place.append(part)
    return tuple(place)
