"""API keys: made once, shown once, kept as a SHA-256."""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from datetime import timedelta
from typing import Any

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from storage.blobs import sha256_of
from storage.errors import NotFoundError
from storage.ids import new_id
from storage.insertion import insert_if_absent
from storage.models import ApiKey
from storage.models.base import utc_now
from storage.pagination import Page, paginate

#: Characters of a token that lists show.
PREFIX_LENGTH = 10

#: ``last_used_at`` is written at most this often, so that reads stay reads.
_LAST_USED_RESOLUTION = timedelta(minutes=1)


def authenticate(session: Session, token: str) -> ApiKey | None:
    """Return the key that ``token`` belongs to, in any workspace, or None when there is none or it was revoked."""
    key = session.scalar(select(ApiKey).where(ApiKey.sha256 == sha256_of(token.encode()), ApiKey.revoked_at.is_(None)))
    if key is None:
        return None
    now = utc_now()
    if key.last_used_at is None or now - key.last_used_at > _LAST_USED_RESOLUTION:
        key.last_used_at = now
    return key


class ApiKeyRepository:
    """The keys of one workspace."""

    def __init__(self, session: Session, workspace_id: str) -> None:
        self._session = session
        self._workspace_id = workspace_id

    def create(self, *, name: str, scopes: Sequence[str], token: str | None = None) -> tuple[ApiKey, str]:
        """Make a key; return it with its token, which cannot be read again.

        Parameters
        ----------
        token : str, optional
            A token chosen by the operator (a bootstrap key); when a key with this token exists, that one is returned.
        """
        token = token or "st_" + secrets.token_urlsafe(32)
        sha256 = sha256_of(token.encode())
        insert_if_absent(
            self._session,
            ApiKey,
            id=new_id("key"),
            workspace_id=self._workspace_id,
            name=name,
            prefix=token[:PREFIX_LENGTH],
            sha256=sha256,
            scopes=list(scopes),
        )
        return self._session.scalars(select(ApiKey).where(ApiKey.sha256 == sha256)).one(), token

    def get(self, identifier: str) -> ApiKey:
        """Return a key, revoked or not; raise `NotFoundError` when it is not in this workspace."""
        key = self._session.get(ApiKey, identifier)
        if key is None or key.workspace_id != self._workspace_id:
            raise NotFoundError("key", identifier)
        return key

    def page(self, *, cursor: str | None = None, limit: int = 100) -> Page[ApiKey]:
        """Return the keys of the workspace, newest first."""
        return paginate(self._session, self._rows(), ApiKey, cursor=cursor, limit=limit)

    def any(self) -> bool:
        """Return whether the workspace has a key that still opens it."""
        return self._session.scalar(self._rows().where(ApiKey.revoked_at.is_(None)).limit(1)) is not None

    def revoke(self, identifier: str) -> ApiKey:
        """Let a key open nothing any more; the first time counts."""
        self.get(identifier)
        self._session.execute(
            update(ApiKey).where(ApiKey.id == identifier, ApiKey.revoked_at.is_(None)).values(revoked_at=utc_now())
        )
        return self.get(identifier)

    def _rows(self) -> Any:
        return select(ApiKey).where(ApiKey.workspace_id == self._workspace_id)
