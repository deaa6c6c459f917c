"""Studies that were asked to be kept, with the document revision and the versions behind them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np
from sqlalchemy.orm import Session

from api.convert.values import listed
from api.services.operation.app_context import Caller
from storage.lineage import remember, sources_in
from storage.models import Result
from storage.pagination import Narrowing
from storage.repositories import ResultRepository


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """A computed reply, what asked for it, the stored system it used (None for a document in the request), and its text."""

    body: dict[str, Any]
    request: dict[str, Any] = field(default_factory=dict)
    system: Mapping[str, Any] | None = None
    text: bytes = b""

    def reply(self, identifier: str | None = None) -> bytes:
        """Return the text that is sent, with the identifier of what was kept in front."""
        return self.text if identifier is None else b'{"id":' + encoded(identifier) + b"," + self.text[1:]


def encoded(body: Any) -> bytes:
    """Return JSON, arrays as lists; a NaN outside of them is an error of ours, never an answer."""
    return json.dumps(body, ensure_ascii=False, allow_nan=False, separators=(",", ":"), default=_json).encode()


def _json(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return listed(value)
    raise TypeError(f"a reply must be made of JSON values and arrays, got {type(value).__name__}")


def with_text(study: Study) -> Study:
    """Return a study with the text that is sent, made where it is computed: a long one takes seconds."""
    return replace(study, text=encoded(study.body))


@cache
def versions() -> dict[str, str]:
    """Return the versions of the software that a result depends on."""
    return {name: version(name) for name in ("servotune", "numpy", "scipy")}


def keep(session: Session, caller: Caller, kind: str, study: Study) -> str:
    """Remember a study; return the identifier it is found under."""
    row = ResultRepository(session, caller.workspace).create(
        kind=kind,
        body=study.body,
        request=study.request,
        system_id=study.system["id"] if study.system else None,
        system_revision=study.system["revision"] if study.system else None,
        versions=versions(),
    )
    remember(session, caller.workspace, row.id, sources_in([study.request, study.system]))
    return row.id


def result_to_wire(repository: ResultRepository, row: Result) -> dict[str, Any]:
    """Return a kept result with its body."""
    return {**_head(row), "request": row.request, "result": repository.body(row)}


def _head(row: Result) -> dict[str, Any]:
    system = {"id": row.system_id, "revision": row.system_revision} if row.system_id else None
    return {
        "id": row.id,
        "kind": row.kind,
        "created_at": row.created_at.isoformat(),
        "system": system,
        "versions": row.versions,
    }


def get(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Return a kept result."""
    repository = ResultRepository(session, caller.workspace)
    return result_to_wire(repository, repository.get(identifier))


def page(
    session: Session, caller: Caller, *, kind: str | None, narrowing: Narrowing, cursor: str | None, limit: int
) -> dict[str, Any]:
    """Return one page of the kept results, without their bodies."""
    found = ResultRepository(session, caller.workspace).page(kind=kind, narrowing=narrowing, cursor=cursor, limit=limit)
    return {"items": [_head(row) for row in found.items], "next_cursor": found.next_cursor}


def delete(session: Session, caller: Caller, identifier: str) -> None:
    """Forget a kept result."""
    ResultRepository(session, caller.workspace).delete(identifier)
