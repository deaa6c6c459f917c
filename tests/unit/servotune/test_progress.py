"""A progress bar is gone when the work is done."""

from __future__ import annotations

import io
import threading

import pytest

from servotune import progress


class Terminal(io.StringIO):
    """What is written to a terminal."""

    def isatty(self) -> bool:
        return True


def test_how_far_the_work_is_stands_in_the_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "APPEARS_AFTER", 0.0)
    written = Terminal()
    with progress.ProgressBar("searching", file=written) as bar:
        bar._timer.join()
        bar(0.42, "seeking")
    assert "searching" in written.getvalue()
    assert "42 %" in written.getvalue()
    assert "seeking" in written.getvalue()


def test_nothing_is_written_where_nobody_watches() -> None:
    written = io.StringIO()
    with progress.ProgressBar("searching", file=written) as bar:
        assert not bar._timer.is_alive()
        bar(0.5, "seeking")
    assert written.getvalue() == ""


def test_a_bar_that_appears_just_as_the_work_ends_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was left on the terminal, its cursor hidden, when its time came between the two steps of the end."""
    monkeypatch.setattr(progress, "APPEARS_AFTER", 0.0)
    written = Terminal()
    bar = progress.ProgressBar("computing", file=written)
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
    assert "computing" in written.getvalue()
    assert written.getvalue().endswith("\r")  # the line was wiped out, and nothing was drawn after it
