"""Whoever sits at a rig's terminal is asked; where nobody can be, the answer is no at once."""

from __future__ import annotations

import subprocess
import sys

import pytest

PROGRAM = "from agent.terminal import Terminal; print(Terminal(600.0)('May I?'))"


@pytest.mark.parametrize(("typed", "answer"), [("yes\n", "True"), ("no\n", "False"), ("", "False")])
def test_an_agent_without_a_terminal_waits_for_nobody(typed, answer) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], input=typed, capture_output=True, text=True, check=True, timeout=300
    )
    assert done.stdout.endswith(f"{answer}\n")


WITHDRAWN = """
import threading
from agent.terminal import Terminal
from agent.waking import WakingEvent
end = WakingEvent()
def ended():
    input_is_awaited.wait()
    end.set()
input_is_awaited = threading.Event()
terminal = Terminal(600.0)
listen = terminal._listen
terminal._listen = lambda: (input_is_awaited.set(), listen())
threading.Thread(target=ended).start()
print(terminal("May I?", [end]), terminal("And now?", [end]))
"""


def test_a_question_that_nobody_needs_any_more_ends_at_once() -> None:
    """The terminal stays open and silent; the question would wait 600 s, the test 60."""
    with subprocess.Popen([sys.executable, "-c", WITHDRAWN], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as asking:
        assert asking.stdout is not None
        try:
            assert asking.wait(60.0) == 0
            told = asking.stdout.read().decode()
        finally:
            asking.kill()
    assert told.count("The question is withdrawn.") == 2
    assert told.endswith("False False\n")
