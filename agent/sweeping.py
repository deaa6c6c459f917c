"""Cuts what inputs deliver into sweeps of one length, each from its trigger on where one is waited for: what a scope shows.

A sweep is given again with each block that makes it longer, so that a slow one is seen while it grows.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from agent.settings import InputSettings
from agent.triggering import Waiting

Samples = npt.NDArray[np.float64]


def sweeps(
    blocks: Iterator[Samples], *, samples: int, waiting: Callable[[], Waiting | None]
) -> Iterator[tuple[int, Samples]]:
    """Give number and samples, shape (channels, n), of the present sweep whenever there is more of it; the first number is 1.

    Parameters
    ----------
    samples : int
        Of a whole sweep, what is before its trigger included.
    waiting : callable
        Makes what waits for the next trigger; None where every sweep begins behind the one before.

    Raises
    ------
    AttemptError
        `no_trigger`, when none comes in time.
    """
    number = 0
    left: deque[Samples] = deque()
    while True:
        number += 1
        trigger = waiting()
        parts: list[Samples] = []
        got = 0
        while got < samples:
            block: Samples | None = left.popleft() if left else next(blocks, None)
            if block is None:
                return
            if trigger is not None:
                if trigger.take(block):
                    left.extendleft(reversed(list(trigger.recorded())))
                    trigger = None
                continue
            parts.append(block[:, : samples - got])
            if block.shape[1] > samples - got:
                left.appendleft(block[:, samples - got :])
            got += parts[-1].shape[1]
            yield number, np.concatenate(parts, axis=1)


def preview(
    inputs: Sequence[InputSettings], block: Samples, *, start: float, rate: float, width: int, sweep: int | None = None
) -> dict[str, Any] | None:
    """Return the smallest and the largest value of stretches of a block (channels, n), in the units of the channels.

    Parameters
    ----------
    start : float
        s, of the first sample.
    width : int
        Samples of one stretch; None comes back where there is not one whole stretch.
    """
    count = block.shape[1] // width
    if not count:
        return None
    stretches = block[:, : count * width].reshape(len(inputs), count, width)
    low, high = stretches.min(axis=2), stretches.max(axis=2)
    channels = {}
    for entry, a, b in zip(inputs, low, high, strict=True):
        ends = np.sort(np.stack([a, b]) / entry.overall_sensitivity + entry.overall_offset, axis=0)
        channels[entry.name] = ends.T.tolist()
    told = {"start": start, "step": width / rate, "channels": channels}
    return told if sweep is None else {**told, "sweep": sweep}
