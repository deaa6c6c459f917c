"""Whoever sits at a rig's terminal is asked; where nobody can be, the answer is no at once."""

from __future__ import annotations

import subprocess
import sys

import pytest

PROGRAM = "from agent.process import Terminal; print(Terminal(600.0)('May I?'))"


@pytest.mark.parametrize(("typed", "answer"), [("yes\n", "True"), ("no\n", "False"), ("", "False")])
def test_an_agent_without_a_terminal_waits_for_nobody(typed, answer) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], input=typed, capture_output=True, text=True, check=True, timeout=300
    )
    assert done.stdout.endswith(f"{answer}\n")
