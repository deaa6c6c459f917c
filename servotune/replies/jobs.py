"""Long work."""

from __future__ import annotations

from typing import Any, NotRequired, TypedDict

from servotune.replies.values import Warned


class JobState(TypedDict):
    """What the service knows about a job."""

    id: str
    kind: str
    status: str
    progress: float
    message: NotRequired[str | None]
    created_at: NotRequired[str | None]
    started_at: NotRequired[str | None]
    seconds: NotRequired[float | None]
    finished_at: NotRequired[str | None]
    result: NotRequired[str | None]
    error: NotRequired[dict[str, Any] | None]
    paused: NotRequired[bool]
    priority: NotRequired[str]
    time_limit: NotRequired[float | None]
    deadline: NotRequired[str | None]
    attempts: NotRequired[int]


class ExpectedCost(TypedDict):
    """What a search will take on one core, right within a factor of three (s, bytes)."""

    evaluations: int
    seconds: float
    bytes: float


class Expected(TypedDict):
    """What a job that was not started would take, and what it would warn of."""

    expected: ExpectedCost
    warnings: list[Warned]
