"""Measurements on rigs: who may drive what, what was asked for, and what became of each attempt."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum
from typing import Any

from sqlalchemy import CheckConstraint, ForeignKey, ForeignKeyConstraint, Index, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from storage.models.base import Base, Id, Word, utc_now


class AcquisitionStatus(StrEnum):
    """From the request to the recording; the words of the contract."""

    QUEUED = "queued"
    CLAIMED = "claimed"
    RUNNING = "running"
    UPLOADING = "uploading"
    DONE = "done"
    FAILED = "failed"
    LOST = "lost"
    CANCELLED = "cancelled"

    @property
    def final(self) -> bool:
        """Whether nothing happens any more by itself (a person may try again, late samples may come)."""
        return self in FINAL


#: The rig moves, or is about to: such an attempt needs its lease.
ON_THE_RIG = (AcquisitionStatus.CLAIMED, AcquisitionStatus.RUNNING)
FINAL = (AcquisitionStatus.DONE, AcquisitionStatus.FAILED, AcquisitionStatus.LOST, AcquisitionStatus.CANCELLED)

_STATUS = "status IN ('queued', 'claimed', 'running', 'uploading', 'done', 'failed', 'lost', 'cancelled')"


class Rig(Base):
    """A test bench as its agent registered it last.

    ``document`` holds devices, inputs with their sensors and calibration, outputs with their limits. ``agent_id`` is the
    one agent that may drive it now.
    """

    __tablename__ = "rig"
    __table_args__ = (
        Index(None, "workspace_id", "created_at", "id"),
        UniqueConstraint("workspace_id", "name"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"))
    name: Mapped[str]
    document: Mapped[dict[str, Any]]
    # Without a foreign key, which would make a ring of rig and agent.
    agent_id: Mapped[str | None] = mapped_column(Id)
    created_at: Mapped[datetime] = mapped_column(default=utc_now)


class Agent(Base):
    """A lab PC's process; ``instance`` is what it calls itself for ever, whoever restarts it."""

    __tablename__ = "agent"
    __table_args__ = (
        Index(None, "workspace_id", "created_at", "id"),
        UniqueConstraint("rig_id", "instance"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"))
    rig_id: Mapped[str] = mapped_column(ForeignKey("rig.id"), index=True)
    instance: Mapped[str] = mapped_column(Word)
    name: Mapped[str]
    version: Mapped[str]
    seen_at: Mapped[datetime] = mapped_column(default=utc_now)
    created_at: Mapped[datetime] = mapped_column(default=utc_now)


class AcquisitionTemplate(Base):
    """A measurement to be asked for again."""

    __tablename__ = "acquisition_template"
    __table_args__ = (Index(None, "workspace_id", "created_at", "id"),)

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"))
    name: Mapped[str]
    document: Mapped[dict[str, Any]]
    revision: Mapped[int] = mapped_column(default=1)
    created_at: Mapped[datetime] = mapped_column(default=utc_now)


class Acquisition(Base):
    """A measurement that was asked for; ``attempt`` and ``status`` are those of its latest attempt."""

    __tablename__ = "acquisition"
    __table_args__ = (
        Index(None, "workspace_id", "created_at", "id"),
        CheckConstraint(_STATUS, name="status"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"))
    rig_id: Mapped[str] = mapped_column(ForeignKey("rig.id"), index=True)
    name: Mapped[str]
    document: Mapped[dict[str, Any]]
    attempt: Mapped[int] = mapped_column(default=1)
    status: Mapped[str] = mapped_column(Word, default=AcquisitionStatus.QUEUED)
    created_at: Mapped[datetime] = mapped_column(default=utc_now)


class AcquisitionAttempt(Base):
    """One go at a measurement, with the job that its user follows; ``facts`` is what the agent found out.

    ``late`` says that samples came after the attempt had been given up.
    """

    __tablename__ = "acquisition_attempt"
    __table_args__ = (CheckConstraint(_STATUS, name="status"), Index(None, "status"))

    acquisition_id: Mapped[str] = mapped_column(ForeignKey("acquisition.id", ondelete="CASCADE"), primary_key=True)
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    status: Mapped[str] = mapped_column(Word, default=AcquisitionStatus.QUEUED)
    job_id: Mapped[str] = mapped_column(ForeignKey("job.id"), index=True)
    agent_id: Mapped[str | None] = mapped_column(ForeignKey("agent.id"), index=True)
    lease_until: Mapped[datetime | None]
    dataset_id: Mapped[str | None] = mapped_column(ForeignKey("dataset.id", ondelete="SET NULL"), index=True)
    facts: Mapped[dict[str, Any] | None]
    error: Mapped[dict[str, Any] | None]
    late: Mapped[bool] = mapped_column(default=False)
    claimed_at: Mapped[datetime | None]
    ended_at: Mapped[datetime | None]
    created_at: Mapped[datetime] = mapped_column(default=utc_now)


class FollowUp(Base):
    """A step of the chain that begins when a recording is there: the next one waits for the end of the one before."""

    __tablename__ = "follow_up"
    __table_args__ = (
        CheckConstraint("status IN ('waiting', 'running', 'done', 'failed', 'skipped')", name="status"),
        ForeignKeyConstraint(
            ["acquisition_id", "attempt"],
            ["acquisition_attempt.acquisition_id", "acquisition_attempt.number"],
            ondelete="CASCADE",
        ),
        Index(None, "status"),
    )

    acquisition_id: Mapped[str] = mapped_column(Id, primary_key=True)
    attempt: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    kind: Mapped[str] = mapped_column(Word)
    body: Mapped[dict[str, Any]]
    status: Mapped[str] = mapped_column(Word, default="waiting")
    job_id: Mapped[str | None] = mapped_column(ForeignKey("job.id", ondelete="SET NULL"), index=True)
    result: Mapped[dict[str, Any] | None]
    detail: Mapped[str | None]
