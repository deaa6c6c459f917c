"""What many replies are made of."""

from __future__ import annotations

from typing import NotRequired, TypedDict


class Metric(TypedDict):
    """One measured quantity; `value` is None where the verdict says that there is none."""

    value: float | None
    unit: str
    verdict: str
    advice: NotRequired[str | None]
    at: NotRequired[float | None]
    doubt: NotRequired[float | None]
    settled_from: NotRequired[str | None]
    reference: NotRequired[str | None]


class Warned(TypedDict):
    """One warning and the place of the document that it is about."""

    pointer: str
    detail: str


class Root(TypedDict):
    """A complex number (rad/s)."""

    real: float
    imag: float
