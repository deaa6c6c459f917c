"""How a recording was made from others: the steps, and which recordings they began with."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import ForeignKey
from sqlalchemy.orm import Mapped, mapped_column

from storage.models.base import Base, Id, utc_now


class Processing(Base):
    """The processing that made a dataset.

    ``steps`` are those of the contract with all their numbers, in order, applied to each source by itself; ``combine``
    says how the sources became one (None for a single one). ``experiments`` counts the samples of each experiment, one
    after the other. ``versions`` are those of the software that computed it.
    """

    __tablename__ = "processing"

    dataset_id: Mapped[str] = mapped_column(ForeignKey("dataset.id", ondelete="CASCADE"), primary_key=True)
    steps: Mapped[list[Any]]
    combine: Mapped[str | None]
    experiments: Mapped[list[Any] | None]
    versions: Mapped[dict[str, Any]]
    created_at: Mapped[datetime] = mapped_column(default=utc_now)


class ProcessingSource(Base):
    """A recording that a processing began with; it cannot be deleted before what was made of it."""

    __tablename__ = "processing_source"

    dataset_id: Mapped[str] = mapped_column(ForeignKey("dataset.id", ondelete="CASCADE"), primary_key=True)
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    source_id: Mapped[str] = mapped_column(Id, index=True)
