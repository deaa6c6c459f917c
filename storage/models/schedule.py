"""Work that is asked for again and again, and what became of it each time."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum
from typing import Any

from sqlalchemy import CheckConstraint, ForeignKey, Index
from sqlalchemy.orm import Mapped, mapped_column

from storage.models.base import Base, Id, Word, utc_now


class RunOutcome(StrEnum):
    """What became of one instant of a schedule."""

    STARTED = "started"
    WAITING = "waiting"
    SKIPPED = "skipped"
    MISSED = "missed"
    REFUSED = "refused"


class Schedule(Base):
    """A job body and when it is run; ``next_at`` is the instant that is to be dealt with next, None while it is paused.

    ``newest`` is the name of recordings, the newest of which stands in for the one that the body names.
    """

    __tablename__ = "schedule"
    __table_args__ = (
        Index(None, "workspace_id", "created_at", "id"),
        Index(None, "next_at"),
        CheckConstraint("overlap IN ('skip', 'queue', 'cancel_previous')", name="overlap"),
        CheckConstraint("missed IN ('none', 'one', 'all')", name="missed"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"))
    name: Mapped[str]
    cron: Mapped[str]
    time_zone: Mapped[str]
    kind: Mapped[str] = mapped_column(Word)
    body: Mapped[dict[str, Any]]
    overlap: Mapped[str] = mapped_column(Word)
    missed: Mapped[str] = mapped_column(Word)
    newest: Mapped[str | None]
    paused: Mapped[bool]
    revision: Mapped[int] = mapped_column(default=1)
    next_at: Mapped[datetime | None]
    created_at: Mapped[datetime] = mapped_column(default=utc_now)


class ScheduleRun(Base):
    """One instant of a schedule, or several that were missed together; ``detail`` says why nothing was started."""

    __tablename__ = "schedule_run"
    __table_args__ = (
        Index(None, "schedule_id", "created_at", "id"),
        Index(None, "outcome"),
        CheckConstraint("outcome IN ('started', 'waiting', 'skipped', 'missed', 'refused')", name="outcome"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    schedule_id: Mapped[str] = mapped_column(ForeignKey("schedule.id", ondelete="CASCADE"))
    due_at: Mapped[datetime]
    outcome: Mapped[str] = mapped_column(Word)
    job_id: Mapped[str | None] = mapped_column(ForeignKey("job.id", ondelete="SET NULL"), index=True)
    detail: Mapped[str | None]
    created_at: Mapped[datetime] = mapped_column(default=utc_now)
