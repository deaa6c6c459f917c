"""Who came in how, and what they changed: sign-ins of browsers, tickets, the audit log."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import ForeignKey, Index
from sqlalchemy.orm import Mapped, mapped_column

from storage.models.base import Base, Id, Sha256, Word, utc_now


class SignIn(Base):
    """A browser that has signed in; only the SHA-256 of its cookie is kept.

    One that came in with a key does what the key may, as long as the key opens; any other has ``scopes`` of its own.
    """

    __tablename__ = "sign_in"

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"), index=True)
    sha256: Mapped[str] = mapped_column(Sha256, unique=True)
    name: Mapped[str]
    key_id: Mapped[str | None] = mapped_column(ForeignKey("api_key.id"), index=True)
    scopes: Mapped[list[Any] | None]
    created_at: Mapped[datetime] = mapped_column(default=utc_now)
    expires_at: Mapped[datetime] = mapped_column(index=True)


class Ticket(Base):
    """The right to open one WebSocket, once and soon; only the SHA-256 of the ticket is kept."""

    __tablename__ = "ticket"

    sha256: Mapped[str] = mapped_column(Sha256, primary_key=True)
    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"), index=True)
    principal: Mapped[str] = mapped_column(Id)
    scopes: Mapped[list[Any]]
    expires_at: Mapped[datetime] = mapped_column(index=True)


class AuditEntry(Base):
    """One change: who (``principal``, the id of a key or a sign-in) did what (``action``) to what (``target``)."""

    __tablename__ = "audit_entry"
    __table_args__ = (Index(None, "workspace_id", "created_at", "id"), Index(None, "created_at"))

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"))
    principal: Mapped[str] = mapped_column(Id)
    request_id: Mapped[str | None] = mapped_column(Word)
    action: Mapped[str] = mapped_column(Word)
    target: Mapped[str] = mapped_column(Word)
    detail: Mapped[dict[str, Any] | None]
    created_at: Mapped[datetime] = mapped_column(default=utc_now)
