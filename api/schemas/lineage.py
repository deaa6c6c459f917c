"""What a lineage is replied as."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from pydantic import Field

from api.schemas.replies import Reply


class LineageNode(Reply):
    """Something that was made; `exists` is false for what was deleted since."""

    id: str = Field(description="of a model with its revision: sys_...@3")
    kind: str = Field(description="dataset, model, acquisition, or the kind of the job or kept study")
    name: str
    exists: bool
    created_at: datetime | None
    facts: dict[str, Any] = Field(description="checksums, formats, statuses, versions")


class LineageEdgeReply(Reply):
    """`to` was made from `from`."""

    source: str = Field(alias="from")
    target: str = Field(alias="to")
    role: str = Field(description="what `from` is to `to`: data, model, parameters, revision, source")


class LineageReply(Reply):
    """Everything that a thing was made from, and everything that was made from it."""

    id: str
    nodes: list[LineageNode]
    edges: list[LineageEdgeReply]
    truncated: bool = Field(description="there are more nodes than one reply shows")
