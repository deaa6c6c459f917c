"""What blocks, parameters, outputs and ports may be called."""

from __future__ import annotations

import re
from typing import Final

from engine.errors import DiagramError, Path

MAX_NAME: Final = 64

_NAME = re.compile(r"[a-z][a-z0-9_]*")


def check_name(name: str, *, at: Path) -> None:
    """Refuse anything but a lower-case letter followed by lower-case letters, digits or _.

    Raises
    ------
    DiagramError
        With the rule and the name, cut where it is too long.
    """
    if len(name) > MAX_NAME or _NAME.fullmatch(name) is None:
        raise DiagramError(
            f"name must be a lower-case letter followed by at most {MAX_NAME - 1} lower-case letters, digits or _, "
            f"got '{name[: MAX_NAME + 1]}'",
            at=at,
        )
