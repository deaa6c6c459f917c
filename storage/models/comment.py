"""What people write about things."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import CheckConstraint, ForeignKey, Index
from sqlalchemy.orm import Mapped, mapped_column

from storage.models.base import Base, Id, utc_now

_ONE_SUBJECT = " + ".join(
    f"CASE WHEN {column} IS NULL THEN 0 ELSE 1 END" for column in ("system_id", "dataset_id", "job_id", "result_id")
)


class Comment(Base):
    """A comment on one thing, with which it goes.

    ``author_id`` is the key with which it was written, or the sign-in of a browser that came without one; ``author_name`` its name at
    that time, which stays readable when neither is there any more.
    """

    __tablename__ = "comment"
    __table_args__ = (
        Index(None, "workspace_id", "created_at", "id"),
        Index(None, "system_id", "created_at", "id"),
        Index(None, "dataset_id", "created_at", "id"),
        Index(None, "job_id", "created_at", "id"),
        Index(None, "result_id", "created_at", "id"),
        CheckConstraint(f"{_ONE_SUBJECT} = 1", name="subject"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"))
    system_id: Mapped[str | None] = mapped_column(ForeignKey("system.id", ondelete="CASCADE"))
    dataset_id: Mapped[str | None] = mapped_column(ForeignKey("dataset.id", ondelete="CASCADE"))
    job_id: Mapped[str | None] = mapped_column(ForeignKey("job.id", ondelete="CASCADE"))
    result_id: Mapped[str | None] = mapped_column(ForeignKey("result.id", ondelete="CASCADE"))
    author_id: Mapped[str] = mapped_column(Id)
    author_name: Mapped[str]
    text: Mapped[str]
    created_at: Mapped[datetime] = mapped_column(default=utc_now)
