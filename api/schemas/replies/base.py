"""What replies are made of."""

from __future__ import annotations

from typing import Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field

Item = TypeVar("Item")
Number = float | None
Curve = list[Number]


class Reply(BaseModel):
    """Base of every reply; replies may grow fields."""

    model_config = ConfigDict(extra="allow")


class Page(Reply, Generic[Item]):
    """One page of a list; `next_cursor` is null on the last one."""

    items: list[Item]
    next_cursor: str | None


class FaultReply(Reply):
    """One thing that is wrong in the request body."""

    pointer: str = Field(examples=["/system/blocks/motor/area"])
    detail: str


class ProblemReply(Reply):
    """RFC 9457 problem document."""

    type: str
    title: str
    status: int
    detail: str
    errors: list[FaultReply] = Field(default_factory=list)


class WarningReply(Reply):
    """Something in the document that is allowed and probably not meant."""

    pointer: str
    detail: str


class SystemReference(Reply):
    """The stored revision that was used."""

    id: str
    revision: int


VerdictWord = Literal[
    "ok", "unstable", "marginal", "integrating", "not_settled", "never_crosses", "zero_static_gain",
    "not_oscillatory", "diverges", "ill_posed", "discontinuous", "zero_base", "not_applicable", "too_short", "doubtful",
]  # fmt: skip


class MetricReply(Reply):
    """A metric; without a value the verdict says why, and `advice` what to do."""

    value: Number
    unit: str
    verdict: VerdictWord
    advice: str | None = None


class StudyReply(Reply):
    """What every study says beside its numbers."""

    id: str | None = Field(default=None, description="under /v1/results, when it was asked to be kept")
    system: SystemReference | None
    warnings: list[WarningReply]
