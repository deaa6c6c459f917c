"""Long work, and results that are kept."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal

from pydantic import Field

from api.schemas.replies.base import Reply, SystemReference, WarningReply


class JobReply(Reply):
    """Long work and how far it is."""

    id: str
    kind: str
    status: Literal["queued", "running", "succeeded", "failed", "cancelled"]
    progress: float
    message: str
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None
    seconds: float | None = Field(
        default=None,
        description="from its start to its end, s; what a search spent on what, by processor time too, is `effort` of its result",
    )
    result: str | None
    error: dict[str, Any] | None
    paused: bool = Field(description="it waits until it is resumed, and then goes on from where it was")
    priority: Literal["high", "normal", "low"]
    time_limit: float | None = Field(description="longest time of the computation, s")
    deadline: datetime | None = Field(description="when it must have ended")
    attempts: int = Field(description="how often a worker began it: more than once when one died")
    schedule: str | None = Field(default=None, description="id of the schedule that asked for it")
    system: SystemReference | None
    warnings: list[WarningReply]


class ExpectedCost(Reply):
    """What a search will take, right within a factor of three."""

    evaluations: int = Field(description="simulations of everything with its slopes; further starts are not counted")
    seconds: float = Field(description="on one core, s")
    bytes: float


class ExpectedReply(Reply):
    """What a job that was not started would take, and what it would warn of."""

    expected: ExpectedCost | None = Field(description="null where it takes no search")
    warnings: list[WarningReply]


class ResultHead(Reply):
    """A kept result as it is listed."""

    id: str
    kind: str
    created_at: datetime
    system: SystemReference | None
    versions: dict[str, str]


class KeptResult(ResultHead):
    """A kept result: the reply as it was given, and the request."""

    request: dict[str, Any] | None
    result: dict[str, Any]
