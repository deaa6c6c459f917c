"""An event that wakes those who wait for something else meanwhile, such as an answer of a person."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class WakingEvent(threading.Event):
    """An event that calls its listeners once it is set, from the thread that sets it."""

    def __init__(self) -> None:
        super().__init__()
        self._listeners: list[Callable[[], None]] = []

    def set(self) -> None:
        """Set it, then wake whoever listens; whoever begins to listen later looks at `is_set` first."""
        super().set()
        for listener in tuple(self._listeners):
            listener()

    @contextmanager
    def waking(self, listener: Callable[[], None]) -> Iterator[None]:
        """Let a listener be called while the block lasts."""
        self._listeners.append(listener)
        try:
            yield
        finally:
            self._listeners.remove(listener)
