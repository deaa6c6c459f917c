"""Which channels of a run share a sample clock, as data and in words: what a recording says of the instants of its samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Synchronisation:
    """The clock of a run; every channel of it is on that clock, because what cannot be is refused.

    ``following`` have no clock of their own and take that of the others; ``in_turn`` are inputs of devices with one converter
    for several of them, which takes one after the other within a sample.
    """

    clock: str
    """Device whose clock it is; several where the driver keeps their clocks together."""
    channels: tuple[str, ...]
    following: tuple[str, ...] = ()
    in_turn: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """The same as a sentence."""
        own = [name for name in self.channels if name not in self.following]
        told = [f"{listed(own)} on the sample clock of {self.clock}"]
        if self.following:
            told.append(f"{listed(self.following)} on the same clock, led there")
        if self.in_turn:
            told.append(f"{listed(self.in_turn)} one after the other within a sample")
        return "; ".join([*told, "delays of converters and filters are not taken out"])

    def document(self) -> dict[str, Any]:
        """Return it as the facts of a recording have it."""
        return {**{name: value for name, value in asdict(self).items() if value}, "words": self.words}


def listed(names: Sequence[str]) -> str:
    """Return names as a list in words: "a, b and c"."""
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last
