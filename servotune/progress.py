"""A progress bar that appears only when there is something to wait for."""

from __future__ import annotations

import threading
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

APPEARS_AFTER = 1.0
"""Seconds of work after which the bar appears: shorter work needs none."""


class Observer(Protocol):
    """Told how far a piece of work is."""

    def __call__(self, fraction: float, message: str) -> None:
        """Take the done part (0 to 1) and a few words on what is being done."""


class ProgressBar:
    """One line on the terminal that shows how far a piece of work is, and is gone when the work is done."""

    def __init__(self, title: str, *, console: Console | None = None) -> None:
        self._progress = Progress(
            TextColumn("  {task.description}"),
            BarColumn(bar_width=32),
            TextColumn("{task.percentage:3.0f} %"),
            TimeElapsedColumn(),
            TextColumn("[dim]{task.fields[message]}"),
            console=console or Console(stderr=True),
            transient=True,
        )
        self._task = self._progress.add_task(title, total=1.0, message="")
        self._timer = threading.Timer(APPEARS_AFTER, self._progress.start)
        self._timer.daemon = True

    def __enter__(self) -> Self:
        if self._progress.console.is_terminal:
            self._timer.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._timer.cancel()
        if self._timer.is_alive():
            self._timer.join()  # it may be appearing
        if self._progress.live.is_started:
            self._progress.stop()

    def __call__(self, fraction: float, message: str) -> None:
        """Show how far the work is."""
        self._progress.update(self._task, completed=fraction, message=message)
