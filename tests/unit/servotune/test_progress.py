"""A progress bar is gone when the work is done."""

from __future__ import annotations

import io
import threading

import pytest
from rich.console import Console

from servotune import progress


def test_a_bar_that_appears_just_as_the_work_ends_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was left on the terminal, its cursor hidden, when its time came between the two steps of the end."""
    monkeypatch.setattr(progress, "APPEARS_AFTER", 0.0)
    bar = progress.ProgressBar("computing", console=Console(file=io.StringIO(), force_terminal=True))
    appearing, ending = threading.Event(), threading.Event()
    begin, cancel, timer = bar._timer.function, bar._timer.cancel, bar._timer

    def appear() -> None:
        appearing.set()
        ending.wait()
        begin()

    def end() -> None:
        cancel()
        ending.set()

    monkeypatch.setattr(timer, "function", appear)
    monkeypatch.setattr(timer, "cancel", end)
    with bar:
        appearing.wait()
    timer.join()
    assert not bar._progress.live.is_started
