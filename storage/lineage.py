"""Which stored things a document names.

Whatever is made writes down what it was made from: every identifier that its request holds anywhere, and every model as
``{"id": "sys_...", "revision": 3}``. No service has to list them, and a new kind of request has a lineage from its first day.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from sqlalchemy.orm import Session

from storage.insertion import insert_if_absent
from storage.models.lineage import LineageEdge

_SOURCE = re.compile(r"(?:ds|job|res|acq)_[0-9a-z]{26}")
_MODEL = re.compile(r"sys_[0-9a-z]{26}")
_MOST = 1000
"""Sources of one thing: a merge of recordings has dozens."""


def model_key(system: str, revision: int) -> str:
    """Return the key of a revision of a system document.

    >>> model_key("sys_1", 3)
    'sys_1@3'
    """
    return f"{system}@{revision}"


def sources_in(document: Any) -> list[str]:
    """Return the keys of everything that a JSON document names, each once, in its order."""
    found: dict[str, None] = {}
    pending = [document]
    while pending and len(found) < _MOST:
        match pending.pop():
            case {"id": str(system), "revision": int(number)} if _MODEL.fullmatch(system):
                found[model_key(system, number)] = None
            case dict() as members:
                pending += reversed(list(members.values()))
            case list() as items:
                pending += reversed(items)
            case str(text) if _SOURCE.fullmatch(text):
                found[text] = None
    return list(found)


def remember(session: Session, workspace_id: str, target: str, sources: Iterable[str]) -> None:
    """Write down, in the caller's transaction, what a thing was made from; what is known already stays."""
    for source in sources:
        if source != target:
            insert_if_absent(session, LineageEdge, workspace_id=workspace_id, target=target, source=source)
