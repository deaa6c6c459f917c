"""Keys and workspaces, for those who look after an installation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from servotune.replies.base import Reply
from servotune.transport import Transport


class Key(Reply):
    """A key; its token, `key`, is there only when it was just made."""

    id: str
    workspace: str
    name: str
    scopes: list[str]
    prefix: str
    created_at: str
    expires_at: str | None
    last_used_at: str | None
    revoked_at: str | None
    key: str | None
    replaces: str | None


class Workspace(Reply):
    """A workspace; `limits` and `used` count systems, schedules, stored bytes and unfinished jobs."""

    id: str
    name: str
    revision: int
    created_at: str
    limits: dict[str, int]
    used: dict[str, int]


class Keys:
    """The keys of the workspace; asks for the scope `admin`."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def create(
        self, name: str, *, scopes: Sequence[str], expires_at: str | None = None, workspace: str | None = None
    ) -> Key:
        """Make a key; what is returned is the only place that ever tells its token.

        Parameters
        ----------
        scopes : sequence of str
            Some of `"read"`, `"write"`, `"run"`, `"acquire"`, `"admin"`.
        expires_at : str, optional
            RFC 3339 with a time zone.
        workspace : str, optional
            Another one than that of the key that asks, for whoever runs the installation.
        """
        given = {"name": name, "scopes": list(scopes), "expires_at": expires_at, "workspace": workspace}
        document = {field: value for field, value in given.items() if value is not None}
        return Key(self._transport.post("/v1/keys", document, creates=True))

    def list(self) -> Iterator[Key]:
        """Yield the keys, those that open nothing any more among them."""
        return self._transport.items("/v1/keys", Key)

    def rotate(self, key: str, *, overlap: float = 0.0) -> Key:
        """Make a key that may the same; the old one (by its id) opens for `overlap` s longer."""
        return Key(self._transport.post(f"/v1/keys/{key}/rotate", {"overlap": overlap}, creates=True))

    def revoke(self, key: str) -> None:
        """Let a key (by its id) open nothing any more."""
        self._transport.send("DELETE", f"/v1/keys/{key}")


class Workspaces:
    """The workspaces of the installation, or the key's own."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def create(self, name: str, *, limits: Mapping[str, int] | None = None) -> Workspace:
        """Make a workspace; `limits` are those that differ from the usual ones."""
        document: dict[str, Any] = {"name": name} | ({"limits": dict(limits)} if limits else {})
        return Workspace(self._transport.post("/v1/workspaces", document, creates=True))

    def get(self, workspace: str) -> Workspace:
        """Return a workspace with its limits and what is used of them."""
        return Workspace(self._transport.get(f"/v1/workspaces/{workspace}"))

    def list(self) -> Iterator[Workspace]:
        """Yield the workspaces, without limits and use."""
        return self._transport.items("/v1/workspaces", Workspace)
