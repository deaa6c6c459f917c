"""Results: JSON documents whose arrays are kept as blobs.

A numpy array anywhere in the body is kept once and replaced by ``{"$array": position}``; reading puts it back.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from storage import quotas
from storage.audit import record
from storage.blobs import Array, Packed, get_array, packed_array, put_packed, without_those_kept
from storage.errors import NotFoundError
from storage.ids import new_id
from storage.models import Blob, Result, ResultArray
from storage.models.base import Document
from storage.pagination import EVERY, Narrowing, Page, paginate

_ARRAY = "$array"


@dataclass(frozen=True, slots=True, kw_only=True)
class PackedBody:
    """A body whose arrays are ready to be kept."""

    document: Document
    arrays: Sequence[Packed]


class ResultRepository:
    """The results of one workspace."""

    def __init__(self, session: Session, workspace_id: str) -> None:
        self._session = session
        self._workspace_id = workspace_id

    def pack(self, body: Mapping[str, Any]) -> PackedBody:
        """Compress the arrays of a body, and bring them to the object store: to be done before the transaction begins."""
        arrays: list[Array] = []
        document = _take_arrays(body, arrays)
        contents = [packed_array(array) for array in arrays]
        ready = {content.sha256: content for content in without_those_kept(self._session, contents)}
        return PackedBody(document=document, arrays=[ready[content.sha256] for content in contents])

    def create(
        self,
        *,
        kind: str,
        body: Mapping[str, Any] | PackedBody,
        request: Document | None = None,
        system_id: str | None = None,
        system_revision: int | None = None,
        versions: Mapping[str, str] | None = None,
        within_quota: bool = True,
    ) -> Result:
        """Keep a result; ``body`` is JSON that may hold numpy arrays anywhere, or what `pack` made of it.

        Raises
        ------
        QuotaExceededError
            When the workspace may not store that much; not asked ``within_quota`` (a finished job keeps what it found).
        """
        ready = body if isinstance(body, PackedBody) else self.pack(body)
        result = Result(
            id=new_id("res"),
            workspace_id=self._workspace_id,
            kind=kind,
            body=ready.document,
            request=request,
            system_id=system_id,
            system_revision=system_revision,
            versions=dict(versions or {}),
        )
        self._session.add(result)
        self._session.flush()
        put_packed(self._session, ready.arrays)
        for position, array in enumerate(ready.arrays):
            self._session.add(ResultArray(result_id=result.id, position=position, sha256=array.sha256))
        self._session.flush()
        record(self._session, self._workspace_id, "result.create", result.id, kind=kind)
        quotas.add_bytes(self._session, self._workspace_id, self._size(result), within_quota=within_quota)
        return result

    def get(self, identifier: str) -> Result:
        """Return a result without its arrays; raise `NotFoundError` when it is not in this workspace."""
        result = self._session.get(Result, identifier)
        if result is None or result.workspace_id != self._workspace_id:
            raise NotFoundError("result", identifier)
        return result

    def body(self, result: Result) -> Document:
        """Return the body of a result with its arrays (read-only) in their places."""
        rows = self._session.execute(
            select(ResultArray.position, ResultArray.sha256).where(ResultArray.result_id == result.id)
        )
        arrays = {position: get_array(self._session, sha256) for position, sha256 in rows}
        body = _put_arrays(result.body, arrays)
        assert isinstance(body, dict)
        return body

    def page(
        self,
        *,
        kind: str | None = None,
        narrowing: Narrowing = EVERY,
        cursor: str | None = None,
        limit: int = 100,
    ) -> Page[Result]:
        """Return the results of the workspace, newest first."""
        rows = select(Result).where(Result.workspace_id == self._workspace_id)
        if kind is not None:
            rows = rows.where(Result.kind == kind)
        return paginate(self._session, narrowing.of(rows, Result), Result, cursor=cursor, limit=limit)

    def delete(self, identifier: str) -> None:
        """Forget a result."""
        result = self.get(identifier)
        size = self._size(result)
        self._session.delete(result)
        self._session.flush()
        record(self._session, self._workspace_id, "result.delete", identifier)
        quotas.add_bytes(self._session, self._workspace_id, -size)

    def _size(self, result: Result) -> int:
        """Return what a result takes: its body and its arrays, bytes."""
        arrays = (
            select(func.sum(Blob.size))
            .join(ResultArray, ResultArray.sha256 == Blob.sha256)
            .where(ResultArray.result_id == result.id)
        )
        return len(json.dumps(result.body)) + int(self._session.scalar(arrays) or 0)


def _take_arrays(value: Any, arrays: list[Array]) -> Any:
    match value:
        case np.ndarray():
            arrays.append(value)
            return {_ARRAY: len(arrays) - 1}
        case np.generic():
            return value.item()
        case Mapping():
            if _ARRAY in value:
                raise ValueError(f"keys of a result must not be {_ARRAY!r}")
            return {key: _take_arrays(item, arrays) for key, item in value.items()}
        case list() | tuple():
            return [_take_arrays(item, arrays) for item in value]
        case _:
            return value


def _put_arrays(value: Any, arrays: Mapping[int, Array]) -> Any:
    match value:
        case {"$array": int(position)}:
            return arrays[position]
        case dict():
            return {key: _put_arrays(item, arrays) for key, item in value.items()}
        case list():
            return [_put_arrays(item, arrays) for item in value]
        case _:
            return value
