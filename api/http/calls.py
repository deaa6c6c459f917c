"""One request from key to reply: the session, the ``Idempotency-Key``, paging and conditional headers."""

from __future__ import annotations

import asyncio
import hashlib
import re
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import replace
from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import Depends, Header, Query, Request
from fastapi.responses import Response
from pydantic import AfterValidator, AwareDatetime, BaseModel
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool
from starlette.types import Receive

from api.problems.documents import Problem
from api.schemas.replies import JobReply
from api.services.jobs.computing import Recall
from api.services.operation.app_context import Caller, Installation
from api.services.studies.results import encoded, keep
from api.services.studies.studied import proven, studied, submit
from storage.pagination import Narrowing
from storage.repositories import Answer, IdempotencyRepository
from storage.repositories.idempotency import Claim

JSON = "application/json"
#: The longest answer (bytes) that is kept for a repetition of a request that creates nothing.
_LARGEST_KEPT = 1 << 20
Prefer = Annotated[
    str | None,
    Header(max_length=200, description="`respond-async` hands the work to a worker and answers 202 with its job"),
]
#: What an operation that knows this header may answer.
BY_A_WORKER: dict[int | str, dict[str, Any]] = {202: {"model": JobReply, "description": "A worker computes it"}}
Limit = Annotated[int, Query(ge=1, le=1000, description="most items on a page")]
Cursor = Annotated[str | None, Query(max_length=500, description="`next_cursor` of the page before")]
Name = Annotated[
    str | None,
    Query(
        max_length=200,
        pattern=r"^[^\x00]*$",
        description="part of the name, in capital or small letters, or the whole id",
    ),
]


def _in_utc(instant: datetime) -> datetime:
    try:
        return instant.astimezone(UTC)
    except OverflowError:
        raise ValueError(f"must lie in the years 1 to 9999 of UTC, got {instant.isoformat()}") from None


Instant = Annotated[AwareDatetime, AfterValidator(_in_utc)]
After = Annotated[Instant | None, Query(description="made at this instant or later")]
Before = Annotated[Instant | None, Query(description="made earlier than this instant")]
Force = Annotated[bool, Query(description="delete it although others depend on it (409 lists them)")]
IfMatch = Annotated[str | None, Header(alias="If-Match", description="the ETag that the change is meant for")]


def of_a_time(after: After = None, before: Before = None) -> Narrowing:
    """Return which rows of a list were asked for."""
    return Narrowing(after=after, before=before)


def of_a_name(name: Name = None, after: After = None, before: Before = None) -> Narrowing:
    """Return which rows of a list of named things were asked for."""
    return Narrowing(name=name or None, after=after, before=before)


OfATime = Annotated[Narrowing, Depends(of_a_time)]
OfAName = Annotated[Narrowing, Depends(of_a_name)]


async def installation(request: Request) -> Installation:
    """Return the running service."""
    found: Installation = request.app.state.installation
    return found


InstallationDep = Annotated[Installation, Depends(installation)]


def answer(body: Any, *, status: int = 200, headers: Mapping[str, str] | None = None) -> Answer:
    """Return a reply whose body is JSON, arrays as lists; a NaN outside of them is an error of ours, never an answer."""
    return Answer(status_code=status, headers=dict(headers or {}), body=encoded(body))


def shown_once(
    body: Mapping[str, Any], *, secret: Mapping[str, str], status: int, headers: Mapping[str, str]
) -> Answer:
    """Return a reply with a secret in it, which is not kept: a repetition of the reply says null in its place."""
    kept = answer({**body, **dict.fromkeys(secret)}, status=status, headers=headers)
    return replace(kept, first_body=answer({**body, **secret}).body)


def respond(given: Answer, *, replayed: bool = False) -> Response:
    """Return the response that carries an answer."""
    headers = dict(given.headers) | ({"Idempotency-Replayed": "true"} if replayed else {})
    body = given.body if given.first_body is None else given.first_body
    return Response(body, status_code=given.status_code, headers=headers, media_type=JSON)


def accepted(job: Mapping[str, Any]) -> Answer:
    """Return the answer to one who preferred to wait for a worker."""
    headers = {"Location": f"/v1/jobs/{job['id']}", "Retry-After": "1", "Preference-Applied": "respond-async"}
    return answer(job, status=202, headers=headers)


def prefers_job(prefer: str | None) -> bool:
    """Return whether the header ``Prefer`` asks for a job (RFC 7240)."""
    return prefer is not None and "respond-async" in prefer.lower()


@asynccontextmanager
async def recalled(receive: Receive) -> AsyncIterator[Recall]:
    """Give what ends a computation when the caller, whose body has been read, goes away before it is answered."""
    recall = Recall()

    async def listen() -> None:
        while (await receive())["type"] != "http.disconnect":
            continue
        recall.ask()

    listening = asyncio.create_task(listen())
    try:
        yield recall
    finally:
        listening.cancel()


class Creation:
    """A POST that creates, done once for each ``Idempotency-Key``."""

    def __init__(
        self,
        service: Installation,
        *,
        principal: str,
        key: str | None,
        endpoint: str,
        body: bytes,
        receive: Receive,
        request_id: str,
    ) -> None:
        self._service = service
        self._database = service.database
        self._receive = receive
        self._request_id = request_id
        self._principal = principal
        self._key = key
        self._endpoint = endpoint
        self._body_sha256 = hashlib.sha256(body).hexdigest()

    def create(self, work: Callable[[Session], Answer]) -> Response:
        """Do ``work`` in one transaction with the stored answer, or repeat the answer that was given before."""
        claim = self._claim()
        if isinstance(claim, Answer):
            return respond(claim, replayed=True)
        done = False
        try:
            given, done = self._write(claim, work, creates=True)
        finally:
            if not done:
                self._abandon(claim)
        return respond(given)

    async def study(
        self, caller: Caller, kind: str, request: BaseModel, *, kept: bool, prefer: str | None = None
    ) -> Response:
        """Compute outside of any transaction; then store the answer, and the study itself if it is to be kept.

        Whoever prefers to be answered at once gets a job.

        Raises
        ------
        RecalledError
            When the caller has left.
        """
        async with recalled(self._receive) as recall:
            if prefers_job(prefer):
                await proven(self._service, caller, kind, request, recall=recall)
                return await run_in_threadpool(
                    self.create, lambda session: accepted(submit(self._service, session, caller, kind, request))
                )
            claim = await run_in_threadpool(self._claim) if self._key is not None else None
            if isinstance(claim, Answer):
                return respond(claim, replayed=True)
            done = False
            try:
                study = await studied(
                    self._service, caller, kind, request, recall=recall, request_id=self._request_id, kept=kept
                )
                if not kept and claim is None:
                    return respond(Answer(status_code=200, headers={}, body=study.reply()))

                def work(session: Session) -> Answer:
                    number = keep(session, caller, kind, study) if kept else None
                    return Answer(status_code=200, headers={}, body=study.reply(number))

                given, done = await run_in_threadpool(self._write, claim, work, creates=kept)
            finally:
                if claim is not None and not done:
                    await run_in_threadpool(self._abandon, claim)
        return respond(given)

    def _claim(self) -> Claim | Answer | None:
        """Return the claim to answer this key, or the answer that it was given; None without a key."""
        if self._key is None:
            return None
        with self._database.session() as session:
            return self._keys(session).claim(self._key, endpoint=self._endpoint, body_sha256=self._body_sha256)

    def _write(self, claim: Claim | None, work: Callable[[Session], Answer], *, creates: bool) -> tuple[Answer, bool]:
        """Return the answer, and whether it is kept for this key."""
        with self._database.session() as session:
            given = work(session)
            # What creates nothing comes out the same again: a large answer need not be kept to be repeated.
            repeatable = creates or len(given.body) <= _LARGEST_KEPT
            if claim is not None and repeatable:
                self._keys(session).finish(claim, given)
        return given, repeatable

    def _abandon(self, claim: Claim | None) -> None:
        if claim is not None:
            with self._database.session() as session:
                self._keys(session).abandon(claim)

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
    return Creation(
        service, principal=caller.principal, key=key, endpoint=endpoint, body=await request.body(),
        receive=request.receive, request_id=request.state.request_id,
    )  # fmt: skip


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
