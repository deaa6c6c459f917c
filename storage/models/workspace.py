"""Workspaces keep users apart; API keys let them in."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import BigInteger, ForeignKey
from sqlalchemy.orm import Mapped, mapped_column

from storage.models.base import Base, Id, Sha256, Word, utc_now

#: The workspace that the first migration creates; its admins run the installation.
DEFAULT_WORKSPACE = "ws_default"


class Workspace(Base):
    """A closed room: every other row belongs to exactly one.

    ``limits`` are those that differ from `storage.quotas.DEFAULTS`; ``stored_bytes`` is what its documents, segments
    and arrays take before compression.
    """

    __tablename__ = "workspace"

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    name: Mapped[str] = mapped_column(unique=True)
    revision: Mapped[int] = mapped_column(default=1, server_default="1")
    limits: Mapped[dict[str, Any] | None]
    stored_bytes: Mapped[int] = mapped_column(BigInteger, default=0, server_default="0")
    created_at: Mapped[datetime] = mapped_column(default=utc_now)


class ApiKey(Base):
    """A key of which only the SHA-256 is kept.

    The token has 256 random bits, so a fast hash is enough; ``prefix`` is what lists show.
    """

    __tablename__ = "api_key"

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"), index=True)
    name: Mapped[str]
    prefix: Mapped[str] = mapped_column(Word)
    sha256: Mapped[str] = mapped_column(Sha256, unique=True)
    scopes: Mapped[list[Any]]
    created_at: Mapped[datetime] = mapped_column(default=utc_now)
    expires_at: Mapped[datetime | None]
    last_used_at: Mapped[datetime | None]
    revoked_at: Mapped[datetime | None]
