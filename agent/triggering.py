"""Waits for a trigger in the samples: a channel that crosses a level, or enters or leaves a window.

A sample is the trigger when it fires and, of those before it that arm or fire, the last one has armed (h is the hysteresis):

    enters   arms: x < low - h or x > high + h     fires: low <= x <= high
    leaves   arms: low + h <= x <= high - h        fires: x < low or x > high

A level that is reached from below is a window without an upper end, one that is reached from above has no lower end. A missing
value does neither. Samples are taken from the driver, so that all hardware has these triggers, exact to a sample.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from agent.errors import AttemptError
from agent.settings import InputSettings

Samples = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Trigger:
    """What is waited for; levels and hysteresis are in the unit of the channel, ``timeout`` in s."""

    channel: str
    when: str
    """`enters` or `leaves`."""
    low: float = -math.inf
    high: float = math.inf
    hysteresis: float = 0.0
    timeout: float = 60.0

    @classmethod
    def of(cls, told: Mapping[str, Any], inputs: Sequence[InputSettings]) -> Self:
        """Read what a claim says; an end of the window that there is not is null.

        Raises
        ------
        AttemptError
            `unsupported_setting`, where the channel's unit is not the one any more that the levels are in.
        """
        (entry,) = (entry for entry in inputs if entry.name == told["channel"])
        if entry.unit != told["unit"]:
            detail = (
                f"unit of {entry.name} must be {told['unit']}, as when it was asked for, got {entry.unit}: ask again"
            )
            raise AttemptError("unsupported_setting", detail)
        ends = {name: float(told[name]) for name in ("low", "high") if told[name] is not None}
        return cls(
            channel=entry.name,
            when=told["when"],
            hysteresis=float(told["hysteresis"]),
            timeout=float(told["timeout"]),
            **ends,
        )

    def words(self, unit: str) -> str:
        """Say what the channel must do: "rise to 2 mm"."""
        if math.isinf(self.high):
            text = f"rise to {self.low:g} {unit}"
        elif math.isinf(self.low):
            text = f"fall to {self.high:g} {unit}"
        else:
            text = f"{self.when.removesuffix('s')} {self.low:g} ... {self.high:g} {unit}"
        return text + (f" with a hysteresis of {self.hysteresis:g} {unit}" if self.hysteresis else "")


class Search:
    """Looks for the trigger in one block of a channel after the other.

    Parameters
    ----------
    trigger : Trigger
    first : int
        Sample from which on a trigger counts; one before it passes, and the next one is waited for.
    """

    def __init__(self, trigger: Trigger, *, first: int = 0) -> None:
        low, high, h = trigger.low, trigger.high, trigger.hysteresis
        self._enters = trigger.when == "enters"
        self._arming = (low - h, high + h) if self._enters else (low + h, high - h)
        self._firing = (low, high)
        self._first, self._start, self._armed = first, 0, False

    def find(self, values: Samples) -> int | None:
        """Look through the next values, shape (n,), in the unit of the channel; return the trigger's sample in the run."""
        arms = _beyond(values, *self._arming) if self._enters else _within(values, *self._arming)
        fires = _within(values, *self._firing) if self._enters else _beyond(values, *self._firing)
        marks = np.flatnonzero(arms | fires)
        fired = fires[marks]
        armed = np.concatenate([[self._armed], ~fired])
        found = marks[fired & armed[:-1]] + self._start
        found = found[found >= self._first]
        self._armed, self._start = bool(armed[-1]), self._start + values.size
        return int(found[0]) if found.size else None


def _within(values: Samples, low: float, high: float) -> npt.NDArray[np.bool_]:
    return (values >= low) & (values <= high)


def _beyond(values: Samples, low: float, high: float) -> npt.NDArray[np.bool_]:
    return (values < low) | (values > high)


class Waiting:
    """Inputs that run until their trigger; of what has passed, only what may have to be recorded is kept.

    Parameters
    ----------
    trigger : Trigger
    inputs : sequence of InputSettings
        In the order of the rows of a block.
    rate : float
        samples/s.
    before : int
        Samples that are recorded before the trigger's; none counts before they are there.
    """

    def __init__(self, trigger: Trigger, inputs: Sequence[InputSettings], *, rate: float, before: int) -> None:
        self._trigger, self._before = trigger, before
        self._row, self._entry = next((i, entry) for i, entry in enumerate(inputs) if entry.name == trigger.channel)
        self._search = Search(trigger, first=before)
        self.most = before + max(round(trigger.timeout * rate), 1)
        """Samples among which the trigger must be."""
        self._blocks: deque[Samples] = deque()
        self._kept = self._taken = 0
        self._low, self._high = math.inf, -math.inf
        self.at = 0
        """Sample of the run at which the trigger is."""

    def take(self, block: Samples) -> bool:
        """Take a block of shape (channels, n); return whether the trigger is in it.

        Raises
        ------
        AttemptError
            `no_trigger`, when the time is over.
        """
        values = block[self._row] / self._entry.overall_sensitivity + self._entry.overall_offset
        self._blocks.append(block)
        self._kept += block.shape[1]
        self._taken += block.shape[1]
        found = self._search.find(values)
        if found is not None and found < self.most:
            self.at = found
            return True
        finite = values[np.isfinite(values)]
        self._low, self._high = finite.min(initial=self._low), finite.max(initial=self._high)
        if self._taken >= self.most:
            raise self._missed()
        while self._blocks and self._kept - self._blocks[0].shape[1] >= self._before:
            self._kept -= self._blocks.popleft().shape[1]
        return False

    def recorded(self) -> Iterator[Samples]:
        """Give what is there of the recording, from the first sample that belongs to it."""
        skip = self.at - self._before - (self._taken - self._kept)
        for block in self._blocks:
            if skip < block.shape[1]:
                yield block[:, max(skip, 0) :]
            skip -= block.shape[1]

    def _missed(self) -> AttemptError:
        unit = self._entry.unit
        seen = (
            f"it was between {self._low:.6g} and {self._high:.6g} {unit}"
            if self._low <= self._high
            else "no value came"
        )
        what = f"{self._entry.name} must {self._trigger.words(unit)} within {self._trigger.timeout:g} s, {seen}"
        return AttemptError("no_trigger", what, remedy="take a level that is reached, or a longer timeout")
