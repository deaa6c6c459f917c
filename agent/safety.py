"""What keeps a rig from harm: every sample of a drive is judged against the limits of its output before the first is played.

u(t) = safe + s(t) (d(t) - safe),   s: 0 -> 1 over soft_start, 1 -> 0 over soft_stop, half cosines

A digital output is 1 where u > 0.5, else 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from agent.drives import Signal
from agent.errors import AttemptError
from agent.settings import OutputSettings

Samples = npt.NDArray[np.float64]
_BLOCK = 65_536
_ROUNDING = 1e-9
_HIGH = 0.5
"""Above which a digital output is 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """The samples of an output, from the start of a recording to its end.

    The output stands at its safe value for ``wait`` samples, plays the signal for ``length`` samples ``repeats`` times,
    and is back at its safe value with the last one.
    """

    signal: Signal
    output: OutputSettings
    rate: float
    wait: int
    length: int
    repeats: int

    @property
    def samples(self) -> int:
        """How many there are."""
        return self.wait + self.length * self.repeats

    def block(self, first: int, count: int) -> Samples:
        """Return the samples from ``first`` on, V or A, of a digital output 0 or 1."""
        asked = self._asked(first, count)
        return np.where(asked > _HIGH, 1.0, 0.0) if self.output.kind == "digital" else asked

    def _asked(self, first: int, count: int) -> Samples:
        k = np.arange(first, min(first + count, self.samples)) - self.wait
        driven = self.length * self.repeats
        plain = self.signal(np.where(k >= 0, k % self.length, 0) / self.rate)
        rise, fall = self.output.soft_start * self.rate, self.output.soft_stop * self.rate
        soft = _half_cosine(k / rise) if rise > 0 else np.ones(k.size)
        # The last sample is the safe value, whatever the signal says.
        soft = soft * (_half_cosine((driven - 1 - k) / fall) if fall > 0 else np.where(k < driven - 1, 1.0, 0.0))
        played = np.where(k >= 0, self.output.safe + soft * (plain - self.output.safe), self.output.safe)
        # What rounding puts beyond a limit that the signal just reaches: the driver would refuse the whole run.
        limit = self.output.amplitude
        return np.where(np.abs(played) <= limit * (1 + _ROUNDING), np.clip(played, -limit, limit), played)

    def blocks(self, size: int = _BLOCK) -> Iterator[Samples]:
        """Give all samples, block by block."""
        for first in range(0, self.samples, size):
            yield self.block(first, size)

    def check(self) -> None:
        """Judge every sample.

        Raises
        ------
        AttemptError
            `drive_limit`, with the limit and what the drive would do.
        """
        output = self.output
        seconds = self.length * self.repeats / self.rate
        if seconds > output.duration * (1 + _ROUNDING):
            raise _limit(output, "last at most", output.duration, "s", seconds)
        peak, steepest, before = 0.0, 0.0, output.safe
        for first in range(0, self.samples, _BLOCK):
            block = self._asked(first, _BLOCK)
            if not np.all(np.isfinite(block)):
                raise AttemptError("drive_limit", f"drive of {output.name} must be finite, it is not")
            peak = max(peak, float(np.abs(block).max()))
            steepest = max(steepest, float(np.abs(np.diff(block, prepend=before)).max()))
            before = float(block[-1])
        if peak > output.amplitude * (1 + _ROUNDING):
            raise _limit(output, "stay within", output.amplitude, output.unit, peak)
        if steepest * self.rate > output.slew * (1 + _ROUNDING):
            raise _limit(output, "change by at most", output.slew, f"{output.unit}/s", steepest * self.rate)


def _half_cosine(x: Samples) -> Samples:
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.clip(x, 0.0, 1.0)))


def _limit(output: OutputSettings, rule: str, limit: float, unit: str, got: float) -> AttemptError:
    return AttemptError(
        "drive_limit", f"drive of {output.name} must {rule} {f'{limit:g} {unit}'.strip()}, got {got:.4g}"
    )


def way_home(output: OutputSettings, level: float, rate: float) -> Samples:
    """Return the samples from a level to the safe value, no faster than the soft stop and the slew limit."""
    seconds = max(output.soft_stop, abs(level - output.safe) / output.slew * np.pi / 2)
    count = max(int(np.ceil(seconds * rate)), 1)
    ramp = level + (output.safe - level) * _half_cosine(np.arange(1, count + 1) / count)
    return np.concatenate([ramp, np.full(3, output.safe)])
