"""Workspaces keep users apart; API keys let them in."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import ForeignKey
from sqlalchemy.orm import Mapped, mapped_column

from storage.models.base import Base, Id, Sha256, Word, utc_now

#: The workspace that the first migration creates.
DEFAULT_WORKSPACE = "ws_default"


class Workspace(Base):
    """A closed room: every other row belongs to exactly one."""

    __tablename__ = "workspace"

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    name: Mapped[str] = mapped_column(unique=True)
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
    last_used_at: Mapped[datetime | None]
    revoked_at: Mapped[datetime | None]
