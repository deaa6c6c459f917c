"""What blocks, parameters, outputs and ports may be called, and what was probably meant by a name that is none."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Final

from engine.model.errors import DiagramError, Path

MAX_NAME: Final = 64
_LISTED: Final = 12
_NEAR: Final = 5

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


def no_parameter(path: str, known: Iterable[str]) -> str:
    """Return what to say of a path that is no parameter of the system: those that are near, else some that there are.

    >>> no_parameter("kp", ["ctrl.kp", "ctrl.ki", "motor.mass"])
    "parameter must be one of the system's (near: ctrl.kp, ctrl.ki), got 'kp'"
    """
    paths = list(known)
    found = near(path, paths)
    others = ", ".join(paths[:_LISTED]) or "none"
    told = f"near: {', '.join(found)}" if found else others + (", ..." if len(paths) > _LISTED else "")
    return f"parameter must be one of the system's ({told}), got '{path[:80]}'"


def near(path: str, known: Sequence[str]) -> list[str]:
    """Return the paths that resemble one, whole or in their last name, whatever the case: the likeliest first."""
    last = _last(path)
    whole = {other.lower(): other for other in known}
    ends: dict[str, list[str]] = {}
    for other in known:
        ends.setdefault(_last(other), []).append(other)
    similar = [last, *get_close_matches(last, ends, _NEAR)]
    found = [other for end in similar for other in ends.get(end, ())]
    found += [whole[other] for other in get_close_matches(path.lower(), whole, _NEAR)]
    return list(dict.fromkeys(found))[:_NEAR]


def _last(path: str) -> str:
    return path.rpartition(".")[2].lower()
