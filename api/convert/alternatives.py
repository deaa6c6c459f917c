"""Structures to be compared: a system document with parts removed and added."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from api.problems.documents import invalid
from api.problems.pointers import Place
from api.schemas.optimizations import AlternativeDocument


def altered(document: Mapping[str, Any], alternative: AlternativeDocument, place: Place) -> dict[str, Any]:
    """Return the document of an alternative that is described by its differences; what it does not name stays.

    Raises
    ------
    api.problems.documents.Problem
        422 for a part that is to be removed and is not there.
    """
    changed: dict[str, Any] = {
        **document,
        "parameters": dict(document.get("parameters", {})),
        "blocks": dict(document["blocks"]),
        "connections": list(document.get("connections", [])),
        "outputs": dict(document["outputs"]),
    }
    removed, added = alternative.remove, alternative.add
    if removed is not None:
        for index, name in enumerate(removed.blocks):
            if changed["blocks"].pop(name, None) is None:
                raise invalid(f"blocks must name blocks of the system, got {name!r}", *place, "remove", "blocks", index)
            changed["connections"] = [
                c for c in changed["connections"] if name not in {_block(c["from"]), _block(c["to"])}
            ]
        for index, connection in enumerate(removed.connections):
            wire = connection.model_dump(by_alias=True)
            if wire not in changed["connections"]:
                raise invalid(
                    f"connections must be those of the system, got {wire['from']} -> {wire['to']}",
                    *place,
                    "remove",
                    "connections",
                    index,
                )
            changed["connections"].remove(wire)
    if added is not None:
        wire = added.model_dump(by_alias=True, exclude_unset=True)
        for part in ("parameters", "blocks", "outputs"):
            changed[part] |= wire.get(part, {})
        changed["connections"] += wire.get("connections", [])
    return changed


def _block(endpoint: str) -> str:
    return endpoint.split(".", 1)[0]
