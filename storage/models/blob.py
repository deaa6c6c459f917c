"""Bytes kept once, under their SHA-256, in compressed chunks."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import ForeignKey
from sqlalchemy.orm import Mapped, mapped_column

from storage.models.base import Base, ObjectName, Sha256, Word, partial_index, utc_now


class Blob(Base):
    """The head of a blob: ``sha256`` and ``size`` (bytes) are those of the content before compression."""

    __tablename__ = "blob"

    sha256: Mapped[str] = mapped_column(Sha256, primary_key=True)
    size: Mapped[int]
    created_at: Mapped[datetime] = mapped_column(default=utc_now)


class BlobChunk(Base):
    """One compressed piece of a blob; pieces count from 0. One in the object store has its name there as ``object``, and no data here."""

    __tablename__ = "blob_chunk"
    __table_args__ = (partial_index("object", where="object IS NOT NULL"),)

    sha256: Mapped[str] = mapped_column(ForeignKey("blob.sha256", ondelete="CASCADE"), primary_key=True)
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    encoding: Mapped[str] = mapped_column(Word)
    data: Mapped[bytes]
    object: Mapped[str | None] = mapped_column(ObjectName)


class UnnamedObject(Base):
    """An object of the store that no chunk named when it was looked for, and since when: a backup may name it for a while."""

    __tablename__ = "unnamed_object"

    object: Mapped[str] = mapped_column(ObjectName, primary_key=True)
    since: Mapped[datetime] = mapped_column(default=utc_now)
