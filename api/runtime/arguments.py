"""What every command of this software does alike: reads its arguments, and hears when it is to stop."""

from __future__ import annotations

import _thread
import argparse
import os
import signal
import threading
from collections.abc import Callable
from typing import Any


def parser_of(command: str, description: str, **more: Any) -> argparse.ArgumentParser:
    """Return what reads the arguments of ``servotune <command>``.

    Parameters
    ----------
    command : str
        The name under which its entry point is registered.
    description : str
        What it does, in a sentence.
    **more
        Further arguments of `argparse.ArgumentParser`.
    """
    return argparse.ArgumentParser(prog=f"servotune {command}", description=description, **more)


def whole(low: int, high: int) -> Callable[[str], int]:
    """Return what reads a whole number from ``low`` to ``high``."""

    def read(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"must be a whole number from {low} to {high}, got {text!r}")
        return int(text)

    return read


def stopped_by_signals() -> threading.Event:
    """Return what is set when somebody wants this process to stop: SIGTERM, or Ctrl-C."""
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        # From a thread: a handler runs within whatever this one does, and waits for ever for a lock that this one holds.
        signal.signal(number, lambda *_: _thread.start_new_thread(stop.set, ()))
    return stop


def at_end_of_input(act: Callable[[], object]) -> None:
    """Do something when whoever started this process closes its standard input, or ends."""

    def wait() -> None:
        # not through sys.stdin, whose lock this thread would hold when the interpreter ends, which is fatal
        while os.read(0, 1 << 16):
            pass
        act()

    threading.Thread(target=wait, daemon=True).start()
