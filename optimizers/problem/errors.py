"""What is wrong with an optimisation, and the words that say it."""

from __future__ import annotations

from collections.abc import Iterable

from engine.model.errors import EngineError


class ProblemError(EngineError):
    """An optimisation that cannot be run; ``at`` counts from the root of the optimisation document."""


def listed(names: Iterable[str]) -> str:
    """Return names as part of a sentence."""
    return ", ".join(names) or "(none)"


def refuse_repeats(names: Iterable[str], *at: str) -> None:
    """Refuse a name that is there twice; ``at`` is the list and the key in it."""
    seen: set[str] = set()
    for index, name in enumerate(names):
        if name in seen:
            raise ProblemError(
                f"{at[-1]} must be different for each of {at[0]}, got {name!r} twice", at=(at[0], index, at[-1])
            )
        seen.add(name)


def amount(number: float, unit: str) -> str:
    """Return a number with its unit, for a sentence; what has none stands alone."""
    return f"{number:g} {unit}".rstrip()
