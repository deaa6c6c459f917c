"""What was made from what."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import ForeignKey, Index
from sqlalchemy.orm import Mapped, mapped_column

from storage.models.base import Base, Word, utc_now


class LineageEdge(Base):
    """``target`` was made from ``source``, written in the transaction that made it.

    Both are identifiers (``ds_...``, ``job_...``, ``res_...``, ``acq_...``), that of a model with its revision:
    ``sys_...@3``. Without foreign keys: what was made remembers its origin longer than that exists.
    """

    __tablename__ = "lineage_edge"
    __table_args__ = (Index(None, "workspace_id", "source"),)

    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"), primary_key=True)
    target: Mapped[str] = mapped_column(Word, primary_key=True)
    source: Mapped[str] = mapped_column(Word, primary_key=True)
    created_at: Mapped[datetime] = mapped_column(default=utc_now)
