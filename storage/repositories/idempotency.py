"""Repeats the first answer to a request that comes again with the same ``Idempotency-Key``.

The claim is committed before the work begins, so that a second request learns that the first one runs; the answer
is kept in the work's own transaction, so that there is an answer exactly when there is a change. A claim whose process has
ended is free: at once where this machine can see that, else when it is older than any request may become.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta

from sqlalchemy import ColumnElement, CursorResult, delete, update
from sqlalchemy.orm import Session

from storage import processes
from storage.clock import moment, shared_now
from storage.errors import IdempotencyMismatchError, IdempotencyRunningError, StateError
from storage.ids import new_id
from storage.insertion import insert_if_absent
from storage.models import Idempotency

#: A request that has not answered after this long died with its process, wherever that was; the next one may take its key.
ABANDONED_AFTER = timedelta(minutes=5)


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """The right to do the work of one request; hand it to `IdempotencyRepository.finish` or ``abandon``."""

    key: str
    token: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What was answered the first time; ``first_body`` is sent then in place of ``body`` and never kept."""

    status_code: int
    headers: Mapping[str, str]
    body: bytes
    first_body: bytes | None = None


class IdempotencyRepository:
    """The idempotency keys of one principal (an API key's id)."""

    def __init__(self, session: Session, principal: str) -> None:
        self._session = session
        self._principal = principal

    def claim(self, key: str, *, endpoint: str, body_sha256: str) -> Claim | Answer:
        """Claim a key for a request, or return the answer that this request got before; commit at once.

        Parameters
        ----------
        endpoint : str
            Method and path, ``POST /v1/systems``.

        Raises
        ------
        IdempotencyMismatchError
            When the key was used for another request.
        IdempotencyRunningError
            When the first request has not answered yet.
        """
        token = new_id("idem")
        own = {"claim": token, "process": processes.this_process(), "created_at": moment(self._session)}
        asked = {"principal": self._principal, "key": key, "endpoint": endpoint, "body_sha256": body_sha256}
        if insert_if_absent(self._session, Idempotency, **asked, **own, state="running"):
            return Claim(key=key, token=token)
        row = self._session.get_one(Idempotency, (self._principal, key), populate_existing=True)
        if (row.endpoint, row.body_sha256) != (endpoint, body_sha256):
            raise IdempotencyMismatchError(
                f"Idempotency-Key {key!r} must be a new one, it was used for another request"
            )
        if row.state == "done":
            assert row.status_code is not None
            return Answer(status_code=row.status_code, headers=row.headers or {}, body=row.body or b"")
        if not self._abandoned(row) or not self._replace(row, token):
            raise IdempotencyRunningError(f"the first request with Idempotency-Key {key!r} has not finished yet")
        return Claim(key=key, token=token)

    def finish(self, claim: Claim, answer: Answer) -> None:
        """Keep the answer, in the transaction of the work that it tells of.

        Raises
        ------
        StateError
            When the claim was taken over meanwhile: the work must be rolled back.
        """
        done = self._session.execute(
            update(Idempotency)
            .where(*self._mine(claim))
            .values(state="done", status_code=answer.status_code, headers=dict(answer.headers), body=answer.body)
            .returning(Idempotency.key)
            .execution_options(synchronize_session=False)
        ).one_or_none()
        if done is None:
            raise StateError(f"the claim on Idempotency-Key {claim.key!r} has expired")

    def abandon(self, claim: Claim) -> None:
        """Free the key of a request that failed without changing anything, so that it may be tried again."""
        self._session.execute(delete(Idempotency).where(*self._mine(claim)))

    def _abandoned(self, row: Idempotency) -> bool:
        if processes.alive(row.process) is False:
            return True
        return abs(shared_now(self._session) - row.created_at) >= ABANDONED_AFTER

    def _replace(self, row: Idempotency, token: str) -> bool:
        taken = self._session.execute(
            update(Idempotency)
            .where(*self._mine(Claim(key=row.key, token=row.claim)))
            .values(claim=token, process=processes.this_process(), created_at=moment(self._session))
            .returning(Idempotency.key)
            .execution_options(synchronize_session=False)
        ).one_or_none()
        return taken is not None

    def _mine(self, claim: Claim) -> tuple[ColumnElement[bool], ...]:
        return (
            Idempotency.principal == self._principal,
            Idempotency.key == claim.key,
            Idempotency.claim == claim.token,
            Idempotency.state == "running",
        )


def forget(session: Session, *, before: datetime) -> int:
    """Delete keys made before a time (24 h ago is usual); return how many."""
    result = session.execute(delete(Idempotency).where(Idempotency.created_at < before))
    assert isinstance(result, CursorResult)
    return result.rowcount
