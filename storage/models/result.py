"""What was computed: a JSON body, the arrays in it as blobs, and what it was computed from."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import ForeignKey, Index
from sqlalchemy.orm import Mapped, mapped_column

from storage.models.base import Base, Id, Word, utc_now


class Result(Base):
    """A kept answer. ``request`` is the body that asked for it, ``versions`` the software that gave it."""

    __tablename__ = "result"
    __table_args__ = (
        Index(None, "workspace_id", "created_at", "id"),
        Index(None, "workspace_id", "kind", "created_at", "id"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"))
    kind: Mapped[str] = mapped_column(Word)
    body: Mapped[dict[str, Any]]
    request: Mapped[dict[str, Any] | None]
    system_id: Mapped[str | None] = mapped_column(ForeignKey("system.id"), index=True)
    system_revision: Mapped[int | None]
    versions: Mapped[dict[str, Any]]
    created_at: Mapped[datetime] = mapped_column(default=utc_now)


class ResultArray(Base):
    """An array of a result; the body holds ``{"$array": position}`` in its place."""

    __tablename__ = "result_array"

    result_id: Mapped[str] = mapped_column(ForeignKey("result.id", ondelete="CASCADE"), primary_key=True)
    position: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    sha256: Mapped[str] = mapped_column(ForeignKey("blob.sha256"), index=True)
