"""How the service itself is."""

from __future__ import annotations

from typing import Literal

from api.schemas.replies.base import Reply


class Health(Reply):
    """The process is alive."""

    status: Literal["ok"]


class Readiness(Reply):
    """Whether the service can work, and what was checked."""

    status: Literal["ready", "not ready"]
    checks: dict[str, str]
