"""Browsers that have signed in, and the tickets with which they open a WebSocket."""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from sqlalchemy import and_, delete, or_, select, union_all
from sqlalchemy.orm import Session

from storage.audit import record
from storage.blobs import sha256_of
from storage.ids import new_id
from storage.models import ApiKey, SignIn, Ticket
from storage.models.base import utc_now
from storage.repositories.api_keys import opens


@dataclass(frozen=True, slots=True, kw_only=True)
class Visitor:
    """Who came in by a cookie or a ticket; ``expires_at`` is the end of that, ``key_id`` the key behind a cookie."""

    principal: str
    workspace_id: str
    scopes: frozenset[str]
    name: str
    expires_at: datetime
    key_id: str | None = None


class SignInRepository:
    """The sign-ins of the installation: a cookie belongs to one of them, in whatever workspace."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def open(
        self,
        *,
        workspace_id: str,
        name: str,
        lasts: timedelta,
        key_id: str | None = None,
        scopes: Sequence[str] | None = None,
    ) -> tuple[SignIn, str]:
        """Sign a browser in, with what a key may or with scopes of its own; return the token for its cookie."""
        token = secrets.token_urlsafe(32)
        row = SignIn(
            id=new_id("in"),
            workspace_id=workspace_id,
            sha256=sha256_of(token.encode()),
            name=name,
            key_id=key_id,
            scopes=list(scopes) if scopes is not None else None,
            expires_at=utc_now() + lasts,
        )
        self._session.add(row)
        self._session.flush()
        record(self._session, workspace_id, "sign_in.open", row.id, name=name, key=key_id)
        return row, token

    def visitor(self, token: str) -> Visitor | None:
        """Return who has this cookie, None when it is over or the key behind it does not open any more."""
        row = self._session.scalar(
            select(SignIn).where(SignIn.sha256 == sha256_of(token.encode()), SignIn.expires_at > utc_now())
        )
        if row is None:
            return None
        scopes = row.scopes
        if row.key_id is not None:
            key = self._session.scalar(select(ApiKey).where(ApiKey.id == row.key_id, *opens()))
            if key is None:
                return None
            scopes = key.scopes
        return Visitor(
            principal=row.id,
            workspace_id=row.workspace_id,
            scopes=frozenset(str(scope) for scope in scopes or ()),
            name=row.name,
            expires_at=row.expires_at,
            key_id=row.key_id,
        )

    def close(self, identifier: str) -> None:
        """Sign a browser out; nothing happens when it is out."""
        row = self._session.get(SignIn, identifier)
        if row is not None:
            self._session.delete(row)
            self._session.flush()
            record(self._session, row.workspace_id, "sign_in.close", identifier)

    def give_ticket(
        self, *, principal: str, workspace_id: str, scopes: Sequence[str], lasts: timedelta
    ) -> tuple[str, datetime]:
        """Return a ticket that opens one WebSocket as ``principal``, and when it expires."""
        ticket, expires_at = secrets.token_urlsafe(32), utc_now() + lasts
        self._session.add(
            Ticket(
                sha256=sha256_of(ticket.encode()),
                workspace_id=workspace_id,
                principal=principal,
                scopes=list(scopes),
                expires_at=expires_at,
            )
        )
        self._session.flush()
        return ticket, expires_at

    def redeem(self, ticket: str) -> Visitor | None:
        """Take a ticket; of two who show the same one, one gets in."""
        row = self._session.execute(
            delete(Ticket)
            .where(Ticket.sha256 == sha256_of(ticket.encode()), Ticket.expires_at > utc_now())
            .returning(Ticket.principal, Ticket.workspace_id, Ticket.scopes, Ticket.expires_at)
            .execution_options(synchronize_session=False)
        ).one_or_none()
        if row is None:
            return None
        return Visitor(
            principal=row.principal,
            workspace_id=row.workspace_id,
            scopes=frozenset(str(scope) for scope in row.scopes),
            name="",
            expires_at=row.expires_at,
        )

    def forget(self) -> None:
        """Delete what is over."""
        now = utc_now()
        self._session.execute(delete(SignIn).where(SignIn.expires_at <= now))
        self._session.execute(delete(Ticket).where(Ticket.expires_at <= now))


def open_principals(session: Session, principals: Iterable[str]) -> frozenset[str]:
    """Return which keys and sign-ins of these, by their ids, (still) open, in whatever workspace."""
    among = list(principals)
    keys = select(ApiKey.id).where(ApiKey.id.in_(among), *opens())
    sign_ins = (
        select(SignIn.id)
        .outerjoin(ApiKey, ApiKey.id == SignIn.key_id)
        .where(SignIn.id.in_(among), SignIn.expires_at > utc_now(), or_(SignIn.key_id.is_(None), and_(*opens())))
    )
    return frozenset(session.scalars(union_all(keys, sign_ins)))
