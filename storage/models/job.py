"""Long work: the job that a user sees, its events, and the workers that do it."""

from __future__ import annotations

from datetime import datetime
from enum import IntEnum, StrEnum
from typing import Any

from sqlalchemy import BigInteger, CheckConstraint, ForeignKey, Index, false
from sqlalchemy.orm import Mapped, mapped_column

from storage.models.base import Base, Id, Word, partial_index, utc_now


class JobStatus(StrEnum):
    """The words of the contract; the last three are final."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def final(self) -> bool:
        """Whether nothing happens any more."""
        return self in {JobStatus.SUCCEEDED, JobStatus.FAILED, JobStatus.CANCELLED}


class Priority(IntEnum):
    """Which of a workspace's jobs go first, as the job engine counts: a low number before a high one."""

    HIGH = 1
    NORMAL = 2
    LOW = 3


class Job(Base):
    """Long work that was asked for.

    ``attempts`` counts how often a worker began it; ``worker`` is who has it now; ``error`` is a problem
    (type, title, detail). ``last_event`` numbers the events. ``schedule_id`` is the schedule that asked for it, which
    may be gone.

    ``ticket`` is the job engine's workflow that carries the job, numbered by ``round``; a job without one waits: for being
    resumed, or for room in its workspace. ``part`` and ``parent_id`` are of earlier versions, which cut large jobs into parts that
    were jobs of their own.

    ``request_id`` is the request that asked for it, or the occasion (``tick_...``) on which a schedule did; ``traceparent`` is the
    span of that as W3C's Trace Context writes it, None where nobody collects traces.
    """

    __tablename__ = "job"
    __table_args__ = (
        Index(None, "workspace_id", "created_at", "id"),
        Index(None, "workspace_id", "status", "created_at", "id"),
        Index(None, "workspace_id", "kind", "created_at", "id"),
        Index(None, "workspace_id", "kind", "status", "created_at", "id"),
        partial_index("schedule_id", "created_at", "id", where="schedule_id IS NOT NULL"),
        partial_index("schedule_id", "status", "created_at", "id", where="schedule_id IS NOT NULL"),
        Index(None, "status"),
        partial_index("parent_id", "part", where="parent_id IS NOT NULL"),
        Index(None, "finished_at"),
        CheckConstraint("status IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')", name="status"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"))
    kind: Mapped[str] = mapped_column(Word)
    status: Mapped[str] = mapped_column(Word, default=JobStatus.QUEUED)
    progress: Mapped[float] = mapped_column(default=0.0)
    message: Mapped[str] = mapped_column(default="")
    body: Mapped[dict[str, Any]]
    result_id: Mapped[str | None] = mapped_column(ForeignKey("result.id"), index=True)
    error: Mapped[dict[str, Any] | None]
    attempts: Mapped[int] = mapped_column(default=0)
    worker: Mapped[str | None] = mapped_column(Word)
    last_event: Mapped[int] = mapped_column(default=0)
    schedule_id: Mapped[str | None] = mapped_column(Id)
    ticket: Mapped[str | None] = mapped_column(Word)
    round: Mapped[int] = mapped_column(default=0, server_default="0")
    priority: Mapped[int] = mapped_column(default=Priority.NORMAL, server_default="2")
    paused: Mapped[bool] = mapped_column(default=False, server_default=false())
    time_limit: Mapped[float | None]
    deadline: Mapped[datetime | None]
    parent_id: Mapped[str | None] = mapped_column(Id)
    part: Mapped[int | None]
    request_id: Mapped[str | None] = mapped_column(Word)
    traceparent: Mapped[str | None] = mapped_column(Word)
    created_at: Mapped[datetime] = mapped_column(default=utc_now)
    started_at: Mapped[datetime | None]
    finished_at: Mapped[datetime | None]


class JobEvent(Base):
    """Something that happened to a job; ids count from 1 within the job, without gaps until old ones are thinned out."""

    __tablename__ = "job_event"
    __table_args__ = (partial_index("at", where="type <> 'status'"),)

    job_id: Mapped[str] = mapped_column(ForeignKey("job.id", ondelete="CASCADE"), primary_key=True)
    id: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    type: Mapped[str] = mapped_column(Word)
    payload: Mapped[dict[str, Any]]
    at: Mapped[datetime] = mapped_column(default=utc_now)


class JobState(Base):
    """Where the computation of a job was last: the document that it goes on from, and the attempt that wrote it."""

    __tablename__ = "job_state"

    job_id: Mapped[str] = mapped_column(ForeignKey("job.id", ondelete="CASCADE"), primary_key=True)
    attempt: Mapped[int]
    state: Mapped[dict[str, Any]]
    at: Mapped[datetime] = mapped_column(default=utc_now)


class JobTally(Base):
    """How many jobs of a kind have ended so, and the seconds that they took: counters that only grow."""

    __tablename__ = "job_tally"

    kind: Mapped[str] = mapped_column(Word, primary_key=True)
    status: Mapped[str] = mapped_column(Word, primary_key=True)
    count: Mapped[int] = mapped_column(BigInteger, default=0)
    seconds: Mapped[float] = mapped_column(default=0.0)


class Elected(Base):
    """Who does what is done for all: ``beats`` grows as long as he lives, ``process`` is named as in `storage.processes`."""

    __tablename__ = "elected"

    role: Mapped[str] = mapped_column(Word, primary_key=True)
    holder: Mapped[str] = mapped_column(Word)
    process: Mapped[str | None]
    beats: Mapped[int] = mapped_column(BigInteger)


class Worker(Base):
    """A worker that lives as long as ``seen_at`` changes; ``token`` tells two holders of one name apart.

    ``process`` is the name of its process for those on the same machine, see `storage.processes`; ``warm_up`` is how long
    (s) it took to load what computes, None until that is done.
    """

    __tablename__ = "worker"

    id: Mapped[str] = mapped_column(Word, primary_key=True)
    token: Mapped[str] = mapped_column(Word)
    host: Mapped[str]
    pid: Mapped[int]
    process: Mapped[str | None]
    slots: Mapped[int]
    warm_up: Mapped[float | None]
    started_at: Mapped[datetime]
    seen_at: Mapped[datetime]  # no index: a heartbeat that changes none is written in place
