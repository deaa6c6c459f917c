"""A process stops when it is told to, whatever it does at that moment."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator

import pytest

from api.runtime.arguments import stopped_by_signals
from tests.support.patience import PATIENCE

SIGNALS = (signal.SIGTERM, signal.SIGINT)


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    before = [signal.getsignal(number) for number in SIGNALS]
    yield
    for number, handler in zip(SIGNALS, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_that_meets_the_wait_for_it_stops_the_process(number: signal.Signals) -> None:
    """A handler runs in the thread that waits: it waited for ever for the lock of what that waits for."""
    stop, handled = stopped_by_signals(), threading.Event()
    handler = signal.getsignal(number)
    assert callable(handler)

    def wait() -> None:
        with stop._cond:  # as `stop.wait` does at its beginning and its end
            handler(number, None)
            handled.set()

    threading.Thread(target=wait, daemon=True).start()
    assert handled.wait(PATIENCE)
    assert stop.wait(PATIENCE)
