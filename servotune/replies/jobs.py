"""Long work."""

from __future__ import annotations

from typing import Any

from servotune.replies.base import Reply
from servotune.replies.values import Warned


class JobState(Reply):
    """What the service knows about a job."""

    id: str
    kind: str
    status: str
    progress: float
    message: str | None
    created_at: str | None
    started_at: str | None
    seconds: float | None
    finished_at: str | None
    result: str | None
    error: dict[str, Any] | None
    paused: bool | None
    priority: str | None
    time_limit: float | None
    deadline: str | None
    attempts: int | None


class ExpectedCost(Reply):
    """What a search will take on one core, right within a factor of three (s, bytes)."""

    evaluations: int
    seconds: float
    bytes: float


class Expected(Reply):
    """What a job that was not started would take, and what it would warn of."""

    expected: ExpectedCost
    warnings: list[Warned]
