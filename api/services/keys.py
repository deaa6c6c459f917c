"""Keys: the first admin key of an installation, and who is behind a token."""

from __future__ import annotations

from api.services.installation import Caller
from storage.models import DEFAULT_WORKSPACE
from storage.repositories import ApiKeyRepository, authenticate
from storage.session import Database

#: What a key may be allowed to do; admin may everything.
SCOPES = ("read", "write", "run", "acquire", "admin")


def caller_of(database: Database, token: str) -> Caller | None:
    """Return who calls with this token, None when it opens nothing."""
    with database.session() as session:
        key = authenticate(session, token)
        if key is None:
            return None
        return Caller(key=key.id, workspace=key.workspace_id, scopes=frozenset(str(scope) for scope in key.scopes))


def bootstrap(database: Database, token: str | None) -> str | None:
    """Make the first admin key of an installation.

    Parameters
    ----------
    token : str or None
        The operator's own key; it is made an admin key whenever it is not one yet.

    Returns
    -------
    str or None
        The token of a key that was made at random now, and that nobody can read again.
    """
    with database.session() as session:
        keys = ApiKeyRepository(session, DEFAULT_WORKSPACE)
        if token is not None:
            keys.create(name="bootstrap", scopes=["admin"], token=token)
            return None
        if keys.any():
            return None
        return keys.create(name="first admin key", scopes=["admin"])[1]
