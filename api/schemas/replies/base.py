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
    """A metric; without a value the verdict says why, and `advice` what to do.

    What a window says of an output that has not settled in it is relative to its last value, with the verdict `not_settled`.
    """

    value: Number
    unit: str
    verdict: VerdictWord
    advice: str | None = None
    doubt: Number | None = Field(
        default=None,
        description="of `not_settled`: how far the rest may change the value; null where that is not known",
    )
    settled_from: Literal["last_sample"] | None = Field(
        default=None, description="of `not_settled`: what was taken for where the output settles"
    )
    reference: str | None = Field(
        default=None,
        description="of a metric of the error: the input that the output is compared with, `0` where none is a reference, "
        "`itself` for an output that is the error",
    )


class Pole(Reply):
    """A pole in rad/s."""

    real: Number
    imag: Number


class StudyReply(Reply):
    """What every study says beside its numbers."""

    id: str | None = Field(default=None, description="under /v1/results, when it was asked to be kept")
    system: SystemReference | None
    warnings: list[WarningReply]
