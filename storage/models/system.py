"""System documents: a head that names the current revision, and immutable revisions."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import ForeignKey, Index
from sqlalchemy.orm import Mapped, mapped_column

from storage.models.base import Base, Id, utc_now


class System(Base):
    """The head of a system document; deleted softly, because results remember its revisions."""

    __tablename__ = "system"
    __table_args__ = (Index(None, "workspace_id", "created_at", "id"),)

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"))
    name: Mapped[str]
    revision: Mapped[int] = mapped_column(default=1)
    created_at: Mapped[datetime] = mapped_column(default=utc_now)
    updated_at: Mapped[datetime] = mapped_column(default=utc_now)
    deleted_at: Mapped[datetime | None]


class SystemRevision(Base):
    """One state of a system document, never changed once written; numbers count from 1."""

    __tablename__ = "system_revision"

    system_id: Mapped[str] = mapped_column(ForeignKey("system.id"), primary_key=True)
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    document: Mapped[dict[str, Any]]
    schema_version: Mapped[int]
    created_at: Mapped[datetime] = mapped_column(default=utc_now)
