"""What was answered to a request that carried an ``Idempotency-Key``."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import CheckConstraint, Index
from sqlalchemy.orm import Mapped, mapped_column

from storage.models.base import Base, Id, Sha256, Word, utc_now


class Idempotency(Base):
    """One key of one principal: first ``running``, then ``done`` with the response to repeat.

    ``process`` is the name of the process at work, as of `storage.processes`; None where the system cannot tell.
    """

    __tablename__ = "idempotency"
    __table_args__ = (
        CheckConstraint("state IN ('running', 'done')", name="state"),
        Index(None, "created_at"),
    )

    principal: Mapped[str] = mapped_column(Id, primary_key=True)
    key: Mapped[str] = mapped_column(primary_key=True)
    endpoint: Mapped[str]
    body_sha256: Mapped[str] = mapped_column(Sha256)
    state: Mapped[str] = mapped_column(Word)
    claim: Mapped[str] = mapped_column(Id)
    process: Mapped[str | None]
    status_code: Mapped[int | None]
    headers: Mapped[dict[str, Any] | None]
    body: Mapped[bytes | None]
    created_at: Mapped[datetime] = mapped_column(default=utc_now)
