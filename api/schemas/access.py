"""Keys, workspaces, sign-ins and the audit log: what is asked and what is replied."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import AwareDatetime, Field

from api.schemas.replies import Reply
from api.schemas.values import Document, Identifier

Scope = Literal["read", "write", "run", "acquire", "admin"]
_Count = Annotated[int, Field(ge=0, le=2**53)]


class KeyRequest(Document):
    """A key to make; the reply shows it once."""

    name: str = Field(min_length=1, max_length=200, examples=["lab PC 3"])
    scopes: list[Scope] = Field(min_length=1, max_length=5, description="what it may do; `admin` may everything")
    expires_at: AwareDatetime | None = Field(default=None, strict=False, description="RFC 3339 with a time zone")
    workspace: Identifier | None = Field(
        default=None, description="another workspace than the caller's; for whoever runs the installation"
    )


class RotationRequest(Document):
    """How a key is replaced."""

    overlap: float = Field(default=0.0, ge=0.0, le=30 * 86400, description="s for which the old key opens, too")


class KeyReply(Reply):
    """A key without its token."""

    id: str
    workspace: str
    name: str
    scopes: list[Scope]
    prefix: str = Field(description="how the token begins")
    created_at: datetime
    expires_at: datetime | None
    last_used_at: datetime | None = Field(description="to the minute")
    revoked_at: datetime | None


class NewKeyReply(KeyReply):
    """A key that was just made."""

    key: str | None = Field(description="the token, shown only now: null when an `Idempotency-Key` repeats the reply")
    replaces: str | None = Field(default=None, description="the key that it was rotated from")


class LimitsDocument(Document):
    """What a workspace may have; what is not given is as everywhere."""

    systems: _Count | None = None
    schedules: _Count | None = None
    webhooks: _Count | None = None
    stored_bytes: _Count | None = Field(default=None, description="documents, recordings and results, uncompressed")
    jobs: _Count | None = Field(default=None, description="queued or running")
    running_jobs: Annotated[int, Field(ge=1, le=10**9)] | None = Field(
        default=None, description="computed at the same time; the others wait"
    )


class WorkspaceRequest(Document):
    """A workspace: everything in it is seen with its own keys only."""

    name: str = Field(min_length=1, max_length=200)
    limits: LimitsDocument | None = None


class Amounts(Reply):
    """Systems, schedules, webhooks, stored bytes, unfinished jobs, and those of them that are computed."""

    systems: int
    schedules: int
    webhooks: int
    stored_bytes: int
    jobs: int
    running_jobs: int


class WorkspaceHead(Reply):
    """A workspace as it is listed."""

    id: str
    name: str
    revision: int
    created_at: datetime


class WorkspaceReply(WorkspaceHead):
    """A workspace with its limits and what is used of them."""

    document: WorkspaceRequest
    limits: Amounts
    used: Amounts


class CallerReply(Reply):
    """Who calls."""

    principal: str = Field(description="id of the key, or of the browser's sign-in")
    name: str
    workspace: str
    scopes: list[Scope]
    expires_at: datetime | None = Field(description="end of the sign-in; null for a key")
    csrf_token: str | None = Field(
        description="what a browser sends as `X-CSRF-Token` with whatever changes something; null for a key"
    )


class TicketReply(Reply):
    """The right to open one WebSocket, `/v1/live?ticket=...`."""

    ticket: str
    expires_at: datetime


class AuditReply(Reply):
    """A change: who did what to what."""

    id: str
    created_at: datetime
    principal: str
    request_id: str | None
    action: str = Field(examples=["system.update"])
    target: str
    detail: dict[str, Any] | None
