"""A progress bar that appears only when there is something to wait for."""

from __future__ import annotations

import sys
import threading
from types import TracebackType
from typing import Any, Protocol, Self, TextIO

APPEARS_AFTER = 1.0
"""Seconds of work after which the bar appears: shorter work needs none."""
_FORM = "  {desc} {bar:32} {percentage:3.0f} % {elapsed}{postfix}"


class Observer(Protocol):
    """Told how far a piece of work is."""

    def __call__(self, fraction: float, message: str) -> None:
        """Take the done part (0 to 1) and a few words on what is being done."""


class ProgressBar:
    """One line of a terminal or notebook that shows how far a piece of work is, and is gone when the work is done."""

    def __init__(self, title: str, *, file: TextIO | None = None) -> None:
        self._title, self._file = title, file or sys.stderr
        self._fraction, self._message = 0.0, ""
        self._bar: Any = None
        self._timer = threading.Timer(APPEARS_AFTER, self._appear)
        self._timer.daemon = True

    def __enter__(self) -> Self:
        if self._file.isatty() or "ipykernel" in sys.modules:  # a notebook's output says that it is no terminal
            self._timer.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._timer.cancel()
        if self._timer.is_alive():
            self._timer.join()  # it may be appearing
        if self._bar is not None:
            self._bar.close()

    def __call__(self, fraction: float, message: str) -> None:
        """Show how far the work is."""
        self._fraction, self._message = min(max(fraction, 0.0), 1.0), message
        if self._bar is not None:
            self._show(self._bar)

    def _appear(self) -> None:
        from tqdm import tqdm  # noqa: PLC0415 - most scripts never wait that long

        bar = tqdm(desc=self._title, total=1.0, file=self._file, leave=False, bar_format=_FORM, dynamic_ncols=True)
        bar.start_t -= APPEARS_AFTER
        self._show(bar)
        self._bar = bar

    def _show(self, bar: Any) -> None:
        bar.n = self._fraction
        bar.set_postfix_str(self._message)  # and draws it
