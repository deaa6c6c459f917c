"""Whoever starts a long computation may end it between two of its steps.

The computation asks at its steps and knows nothing of who answers; the answer is given for everything inside, in this thread.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_ASKED: ContextVar[Callable[[], None] | None] = ContextVar("asked", default=None)


@contextmanager
def interruptible(asked: Callable[[], None]) -> Iterator[None]:
    """Let ``asked`` be called between the steps of what is computed inside; it ends that by an exception of its own."""
    token = _ASKED.set(asked)
    try:
        yield
    finally:
        _ASKED.reset(token)


def look() -> None:
    """Ask whether to go on; what ends the computation is raised here."""
    asked = _ASKED.get()
    if asked is not None:
        asked()


def inside() -> bool:
    """Return whether what is computed now can be ended by somebody."""
    return _ASKED.get() is not None
