"""API keys: made once, shown once, kept as a SHA-256."""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Sequence
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import ColumnElement, or_, select, update
from sqlalchemy.orm import Session

from storage.audit import record
from storage.blobs import sha256_of
from storage.errors import NotFoundError, StateError
from storage.ids import new_id
from storage.insertion import insert_if_absent
from storage.models import ApiKey
from storage.models.base import utc_now
from storage.pagination import Page, paginate

#: Characters of a token that lists show.
PREFIX_LENGTH = 10

#: ``last_used_at`` is written at most this often, also where several processes notice the use.
_LAST_USED_RESOLUTION = timedelta(minutes=1)


def authenticate(session: Session, token: str) -> ApiKey | None:
    """Return the key that ``token`` belongs to, in any workspace, or None when there is none that opens."""
    return session.scalar(select(ApiKey).where(ApiKey.sha256 == sha256_of(token.encode()), *opens()))


def note_uses(session: Session, identifiers: Iterable[str]) -> None:
    """Write down that keys are used now, where that was not done within the last minute."""
    now = utc_now()
    long_ago = or_(ApiKey.last_used_at.is_(None), ApiKey.last_used_at < now - _LAST_USED_RESOLUTION)
    session.execute(
        update(ApiKey)
        .where(ApiKey.id.in_(list(identifiers)), long_ago)
        .values(last_used_at=now)
        .execution_options(synchronize_session=False)
    )


def opens() -> tuple[ColumnElement[bool], ...]:
    """Return the conditions under which a key opens: neither revoked nor expired."""
    return ApiKey.revoked_at.is_(None), or_(ApiKey.expires_at.is_(None), ApiKey.expires_at > utc_now())


class ApiKeyRepository:
    """The keys of one workspace."""

    def __init__(self, session: Session, workspace_id: str) -> None:
        self._session = session
        self._workspace_id = workspace_id

    def create(
        self, *, name: str, scopes: Sequence[str], token: str | None = None, expires_at: datetime | None = None
    ) -> tuple[ApiKey, str]:
        """Make a key; return it with its token, which cannot be read again.

        Parameters
        ----------
        token : str, optional
            A token chosen by the operator (a bootstrap key); when a key with this token exists, that one is returned.
        expires_at : datetime, optional
            When it stops to open.
        """
        token = token or "st_" + secrets.token_urlsafe(32)
        sha256 = sha256_of(token.encode())
        new = insert_if_absent(
            self._session,
            ApiKey,
            id=new_id("key"),
            workspace_id=self._workspace_id,
            name=name,
            prefix=token[:PREFIX_LENGTH],
            sha256=sha256,
            scopes=list(scopes),
            expires_at=expires_at,
        )
        key = self._session.scalars(select(ApiKey).where(ApiKey.sha256 == sha256)).one()
        if new:
            record(self._session, self._workspace_id, "key.create", key.id, name=name, scopes=list(scopes))
        return key, token

    def get(self, identifier: str) -> ApiKey:
        """Return a key, whether it opens or not; raise `NotFoundError` when it is not in this workspace."""
        key = self._session.get(ApiKey, identifier, populate_existing=True)
        if key is None or key.workspace_id != self._workspace_id:
            raise NotFoundError("key", identifier)
        return key

    def page(self, *, cursor: str | None = None, limit: int = 100) -> Page[ApiKey]:
        """Return the keys of the workspace, newest first."""
        return paginate(self._session, self._rows(), ApiKey, cursor=cursor, limit=limit)

    def has_admin(self) -> bool:
        """Return whether an admin key still opens the workspace."""
        return any("admin" in key.scopes for key in self._session.scalars(self._rows().where(*opens())))

    def rotate(self, identifier: str, *, overlap: timedelta) -> tuple[ApiKey, str]:
        """Make a key that may the same as an old one, which opens for ``overlap`` longer; return it with its token.

        Raises
        ------
        StateError
            When the old one does not open any more.
        """
        until = utc_now() + overlap
        old = self.get(identifier)
        ended = self._session.execute(
            update(ApiKey)
            .where(ApiKey.id == identifier, *opens())
            .values(expires_at=until if old.expires_at is None else min(until, old.expires_at))
            .returning(ApiKey.id)
            .execution_options(synchronize_session=False)
        ).one_or_none()
        if ended is None:
            raise StateError(f"key {identifier!r} must be one that still opens to be rotated")
        new, token = self.create(name=old.name, scopes=old.scopes, expires_at=old.expires_at)
        record(self._session, self._workspace_id, "key.rotate", identifier, successor=new.id)
        return new, token

    def revoke(self, identifier: str) -> ApiKey:
        """Let a key open nothing any more; the first time counts."""
        self.get(identifier)
        revoked = self._session.execute(
            update(ApiKey)
            .where(ApiKey.id == identifier, ApiKey.revoked_at.is_(None))
            .values(revoked_at=utc_now())
            .returning(ApiKey.id)
            .execution_options(synchronize_session=False)
        ).one_or_none()
        if revoked is not None:
            record(self._session, self._workspace_id, "key.revoke", identifier)
        return self.get(identifier)

    def _rows(self) -> Any:
        return select(ApiKey).where(ApiKey.workspace_id == self._workspace_id)
