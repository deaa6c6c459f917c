"""What many replies are made of."""

from __future__ import annotations

from servotune.replies.base import Reply


class Metric(Reply):
    """One measured quantity; `value` is None where the verdict says that there is none.

    A number where one is wanted: ``float(metric)``, ``f"{metric:.3f}"``.
    """

    value: float | None
    unit: str
    verdict: str
    advice: str | None
    at: float | None
    doubt: float | None
    settled_from: str | None
    reference: str | None

    def __float__(self) -> float:
        if self.value is None:
            raise ValueError(f"the metric has no value: {self.verdict}")
        return float(self.value)

    def __format__(self, spec: str) -> str:
        return self.summary() if self.value is None or not spec else format(float(self), spec)

    def summary(self) -> str:
        """Return what is told of it in a line."""
        told = f" ({self.verdict})" if self.verdict != "ok" else ""
        unit = f" {self.unit}" if self.unit not in {"", "1"} else ""
        return f"{self.value:.6g}{unit}{told}" if self.value is not None else f"no value{told}"


class Warned(Reply):
    """One warning and the place of the document that it is about."""

    pointer: str
    detail: str


class Root(Reply):
    """A complex number (rad/s)."""

    real: float
    imag: float
