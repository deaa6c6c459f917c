"""A process that is kept running is started again, also where that did not work at first."""

from __future__ import annotations

import logging
import os
import signal
import sys
from pathlib import Path

import pytest

from api.runtime.child_process import Kept
from tests.support.desk import wait_for


def test_a_process_that_could_not_be_started_again_is_started_when_it_can_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    interpreter = tmp_path / "python"
    interpreter.symlink_to(sys.executable)
    monkeypatch.setattr(sys, "executable", str(interpreter))
    kept = Kept("the clerk", "import sys; sys.stdin.read()")
    try:
        first = kept.pid
        interpreter.unlink()
        with caplog.at_level(logging.ERROR):
            os.kill(first, signal.SIGKILL)
            wait_for(lambda: "the clerk cannot be started" in caplog.text, "an attempt that fails")
        assert not kept.alive()
        interpreter.symlink_to(os.path.realpath("/proc/self/exe"))
        wait_for(kept.alive, "the next process")
        assert kept.pid != first
    finally:
        kept.stop()
