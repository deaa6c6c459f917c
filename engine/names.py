"""What blocks, parameters, outputs and ports may be called."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

from engine.errors import DiagramError, Path

MAX_NAME: Final = 64

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def check_name(name: str, *, at: Path) -> None:
    """Refuse anything but a letter followed by letters, digits or _; letters are those of ASCII.

    Raises
    ------
    DiagramError
        With the rule and the name, cut where it is too long.
    """
    if len(name) > MAX_NAME or _NAME.fullmatch(name) is None:
        raise DiagramError(
            f"name must be a letter (A-Z, a-z) followed by at most {MAX_NAME - 1} letters, digits or _, "
            f"got '{name[: MAX_NAME + 1]}'",
            at=at,
        )


def check_distinct(named: Iterable[tuple[str, Path]]) -> None:
    """Refuse two names that differ in case only: case counts, and whoever reads one would take it for the other.

    Parameters
    ----------
    named : iterable of (name, path)
        The names of one kind in one scope, each with its place.

    Raises
    ------
    DiagramError
        With both names.
    """
    seen: dict[str, str] = {}
    for name, at in named:
        other = seen.setdefault(name.lower(), name)
        if other != name:
            raise DiagramError(f"names must differ in more than case, got '{other}' and '{name}'", at=at)
