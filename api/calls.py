"""One request from key to reply: the session, the ``Idempotency-Key``, paging and conditional headers."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from fastapi import Depends, Header, Query, Request
from fastapi.responses import Response
from sqlalchemy.orm import Session

from api.convert.values import listed
from api.problems import Problem
from api.services.installation import Caller, Installation
from api.services.results import Study, keep
from storage.repositories import Answer, IdempotencyRepository

JSON = "application/json"
#: The longest answer (bytes) that is kept for a repetition of a request that creates nothing.
_LARGEST_KEPT = 1 << 20
Limit = Annotated[int, Query(ge=1, le=1000, description="most items on a page")]
Cursor = Annotated[str | None, Query(max_length=500, description="`next_cursor` of the page before")]
Force = Annotated[bool, Query(description="delete it although others depend on it (409 lists them)")]
IfMatch = Annotated[str | None, Header(alias="If-Match", description="the ETag that the change is meant for")]


async def installation(request: Request) -> Installation:
    """Return the running service."""
    found: Installation = request.app.state.installation
    return found


InstallationDep = Annotated[Installation, Depends(installation)]


def answer(body: Any, *, status: int = 200, headers: Mapping[str, str] | None = None) -> Answer:
    """Return a reply whose body is JSON, arrays as lists; a NaN outside of them is an error of ours, never an answer."""
    text = json.dumps(body, ensure_ascii=False, allow_nan=False, separators=(",", ":"), default=_json)
    return Answer(status_code=status, headers=dict(headers or {}), body=text.encode())


def shown_once(
    body: Mapping[str, Any], *, secret: Mapping[str, str], status: int, headers: Mapping[str, str]
) -> Answer:
    """Return a reply with a secret in it, which is not kept: a repetition of the reply says null in its place."""
    kept = answer({**body, **dict.fromkeys(secret)}, status=status, headers=headers)
    return replace(kept, first_body=answer({**body, **secret}).body)


def _json(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return listed(value)
    raise TypeError(f"a reply must be made of JSON values and arrays, got {type(value).__name__}")


def respond(given: Answer, *, replayed: bool = False) -> Response:
    """Return the response that carries an answer."""
    headers = dict(given.headers) | ({"Idempotency-Replayed": "true"} if replayed else {})
    body = given.body if given.first_body is None else given.first_body
    return Response(body, status_code=given.status_code, headers=headers, media_type=JSON)


class Creation:
    """A POST that creates, done once for each ``Idempotency-Key``."""

    def __init__(self, service: Installation, *, principal: str, key: str | None, endpoint: str, body: bytes) -> None:
        self._database = service.database
        self._principal = principal
        self._key = key
        self._endpoint = endpoint
        self._body_sha256 = hashlib.sha256(body).hexdigest()

    def create(self, work: Callable[[Session], Answer]) -> Response:
        """Do ``work`` in one transaction with the stored answer, or repeat the answer that was given before."""
        return self._once(lambda: work, creates=True)

    def study(self, caller: Caller, kind: str, compute: Callable[[], Study], *, kept: bool) -> Response:
        """Compute outside of any transaction; then store the answer, and the study itself if it is to be kept."""
        if not kept and self._key is None:
            return respond(answer(compute().body))

        def prepare() -> Callable[[Session], Answer]:
            computed = compute()
            return lambda session: answer(keep(session, caller, kind, computed) if kept else computed.body)

        return self._once(prepare, creates=kept)

    def _once(self, prepare: Callable[[], Callable[[Session], Answer]], *, creates: bool) -> Response:
        if self._key is None:
            work = prepare()
            with self._database.session() as session:
                given = work(session)
            return respond(given)
        with self._database.session() as session:
            claim = self._keys(session).claim(self._key, endpoint=self._endpoint, body_sha256=self._body_sha256)
        if isinstance(claim, Answer):
            return respond(claim, replayed=True)
        done = False
        try:
            work = prepare()
            with self._database.session() as session:
                given = work(session)
                # What creates nothing comes out the same again: a large answer need not be kept to be repeated.
                repeatable = creates or len(given.body) <= _LARGEST_KEPT
                if repeatable:
                    self._keys(session).finish(claim, given)
            done = repeatable
        finally:
            if not done:
                with self._database.session() as session:
                    self._keys(session).abandon(claim)
        return respond(given)

    def _keys(self, session: Session) -> IdempotencyRepository:
        return IdempotencyRepository(session, self._principal)


async def creation(
    request: Request,
    service: InstallationDep,
    key: Annotated[
        str | None,
        Header(
            alias="Idempotency-Key", min_length=1, max_length=200, description="repeats the first answer to this key"
        ),
    ] = None,
) -> Creation:
    """Return the once-only door of a POST that creates."""
    caller: Caller = request.state.caller
    query = f"?{request.url.query}" if request.url.query else ""
    endpoint = f"{request.method} {request.url.path}{query}"
    return Creation(service, principal=caller.principal, key=key, endpoint=endpoint, body=await request.body())


CreationDep = Annotated[Creation, Depends(creation)]


def etag(revision: int) -> str:
    """Return the entity tag of a revision."""
    return f'"{revision}"'


def expected_revision(if_match: str | None, current: Callable[[], int]) -> int:
    """Return the revision that a change is meant for.

    Raises
    ------
    Problem
        428 without ``If-Match``, 412 when it is no tag of ours.
    """
    if if_match is None:
        raise Problem(
            428, "precondition-required", "the header If-Match must be sent with the ETag of the document, got none"
        )
    if if_match.strip() == "*":
        return current()
    found = re.fullmatch(r'\s*(?:W/)?"?(\d{1,9})"?\s*', if_match)
    if found is None:
        raise Problem(
            412, "revision-conflict", f"the header If-Match must be an ETag of this document, got {if_match!r}"
        )
    return int(found[1])
