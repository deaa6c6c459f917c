"""Encoders, counters and digital lines: tasks of their own that take a sample with each one of the analog inputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from nidaqmx.constants import TaskMode
from nidaqmx.stream_readers import CounterReader, DigitalMultiChannelReader

from agent.drivers.interface import Samples
from agent.drivers.nidaqmx.inputs import add_input
from agent.settings import InputSettings

MOST = 8
"""Followers of one run: so many names of tasks are looked for when what an earlier agent left is cleared."""


class Follower:
    """One encoder or counter, or all digital lines: a device has one clock for them.

    Parameters
    ----------
    task : nidaqmx.Task
        New; its caller closes it.
    entries : sequence of InputSettings
    """

    def __init__(self, task: Any, entries: Sequence[InputSettings]) -> None:
        self._task, self.names = task, [entry.name for entry in entries]
        self._kind = entries[0].kind
        for entry in entries:
            add_input(task, entry)
        self._reader = (DigitalMultiChannelReader if self._kind == "digital" else CounterReader)(task.in_stream)

    def arm(self, clock: str, rate: float, timing: dict[str, Any]) -> None:
        """Wait for the sample clock of the analog inputs."""
        self.follow(clock, rate, timing)
        self._task.start()

    def follow(self, clock: str, rate: float, timing: dict[str, Any]) -> None:
        """Take the sample clock of the analog inputs, and let the driver judge it."""
        self._task.timing.cfg_samp_clk_timing(rate, source=clock, **timing)
        self._task.control(TaskMode.TASK_VERIFY)

    def read(self, count: int, timeout: float) -> Samples:
        """Return the next samples, shape (entries, n)."""
        if self._kind == "encoder":
            values = np.empty(count)
            got = self._reader.read_many_sample_double(values, count, timeout=timeout)
            return values[None, :got]
        if self._kind == "counter":  # edges are counted in whole numbers, which the driver does not scale
            counts = np.empty(count, dtype=np.uint32)
            got = self._reader.read_many_sample_uint32(counts, count, timeout=timeout)
            return counts[None, :got].astype(np.float64)
        lines = np.empty((len(self.names), count), dtype=np.uint32)
        got = self._reader.read_many_sample_port_uint32(lines, count, timeout=timeout)
        return np.asarray(lines[:, :got] != 0, dtype=np.float64)


def groups(entries: Sequence[InputSettings]) -> list[list[InputSettings]]:
    """Return what shares a task: each encoder and counter alone, all digital lines together."""
    lines = [entry for entry in entries if entry.kind == "digital"]
    return [[entry] for entry in entries if entry.kind != "digital"] + ([lines] if lines else [])
