"""A reply for one or several sets of parameter values."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from servotune.replies.base import Reply

_TOLD = 3


class OfVariants(Reply):
    """What a study answers: one variant for each set of parameter values."""

    id: str | None
    variants: list[Any]

    def only(self) -> Any:
        """Return the only variant.

        Raises
        ------
        ValueError
            There are more.
        """
        if len(self.variants) != 1:
            raise ValueError(f"this is asked of a reply with one variant, got {len(self.variants)}: take .variants[k]")
        return self.variants[0]

    def summary(self) -> str:
        """Return what is told of it in a line."""
        told = "; ".join(variant.summary() for variant in self.variants[:_TOLD])
        return told if len(self.variants) <= _TOLD else f"{len(self.variants)} variants: {told} ..."

    def table(self) -> Iterator[tuple[str, str]]:
        """Yield names and texts of what a notebook shows."""
        for number, variant in enumerate(self.variants):
            for name, text in variant.table():
                yield (name if len(self.variants) == 1 else f"{number}: {name}"), text
