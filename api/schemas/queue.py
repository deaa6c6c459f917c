"""How a job waits and how long it may take."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AwareDatetime, Field

from api.schemas.values import Document


class QueueDocument(Document):
    """When a job gets its turn among those of its workspace, and when it has to end."""

    priority: Literal["high", "normal", "low"] = Field(
        default="normal", description="among the jobs of the workspace; workspaces take turns"
    )
    time_limit: float | None = Field(
        default=None,
        gt=0,
        le=31_536_000,
        description="longest time of the computation, s; a search returns its best point until then, anything else fails",
    )
    deadline: Annotated[AwareDatetime, Field(strict=False)] | None = Field(
        default=None, description="when it must have ended; as with `time_limit`"
    )
