"""Recordings: the bytes as received, and the channels read from them."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum
from typing import Any

from sqlalchemy import BigInteger, CheckConstraint, ForeignKey, Index
from sqlalchemy.orm import Mapped, mapped_column

from storage.models.base import Base, Id, Sha256, Word, utc_now


class DatasetStatus(StrEnum):
    """From the first segment to readable channels."""

    OPEN = "open"
    PARSING = "parsing"
    READY = "ready"
    FAILED = "failed"


class Dataset(Base):
    """A recording.

    ``channels`` describes the columns as the contract has them (name, unit, scale, offset, sensor); values are kept
    as recorded. ``description`` says how a file is read (the ``import`` of the contract). ``manifest`` is the ordered
    list of segments, ``sha256`` that of the whole. ``sample_rate`` in samples per second. ``report`` tells what was
    noticed while the samples were read; ``job_id`` is the job that reads the file, ``writer`` the import that may write.
    ``commits`` is how often it was committed; ``sample_bytes`` what the samples read from a file add to what was received.
    """

    __tablename__ = "dataset"
    __table_args__ = (
        Index(None, "workspace_id", "created_at", "id"),
        Index(None, "workspace_id", "name", "status", "created_at", "id"),
        CheckConstraint("status IN ('open', 'parsing', 'ready', 'failed')", name="status"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"))
    name: Mapped[str]
    format: Mapped[str] = mapped_column(Word)
    status: Mapped[str] = mapped_column(Word, default=DatasetStatus.OPEN)
    channels: Mapped[list[Any]]
    sample_rate: Mapped[float | None]
    start_time: Mapped[datetime | None]
    sample_count: Mapped[int | None] = mapped_column(BigInteger)
    description: Mapped[dict[str, Any] | None]
    origin: Mapped[dict[str, Any] | None]
    manifest: Mapped[list[Any] | None]
    sha256: Mapped[str | None] = mapped_column(Sha256)
    size: Mapped[int | None] = mapped_column(BigInteger)
    error: Mapped[dict[str, Any] | None]
    report: Mapped[dict[str, Any] | None]
    job_id: Mapped[str | None] = mapped_column(Id, index=True)
    writer: Mapped[str | None] = mapped_column(Id)
    commits: Mapped[int] = mapped_column(default=0, server_default="0")
    sample_bytes: Mapped[int] = mapped_column(BigInteger, default=0, server_default="0")
    created_at: Mapped[datetime] = mapped_column(default=utc_now)


class DatasetSegment(Base):
    """A verified piece of the original bytes; its place is in the manifest, where it may stand more than once."""

    __tablename__ = "dataset_segment"

    dataset_id: Mapped[str] = mapped_column(ForeignKey("dataset.id", ondelete="CASCADE"), primary_key=True)
    sha256: Mapped[str] = mapped_column(ForeignKey("blob.sha256"), primary_key=True, index=True)
    size: Mapped[int]
    created_at: Mapped[datetime] = mapped_column(default=utc_now)


class ChannelBlock(Base):
    """A stretch of one channel: samples at level 0, (minimum, maximum) of 16**level samples above."""

    __tablename__ = "channel_block"

    dataset_id: Mapped[str] = mapped_column(ForeignKey("dataset.id", ondelete="CASCADE"), primary_key=True)
    channel: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    level: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    sha256: Mapped[str] = mapped_column(ForeignKey("blob.sha256"), index=True)
