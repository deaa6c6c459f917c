"""Looks at every sample that is recorded: a channel that reaches its range, one that has dropped out, missing values, and how much of the range was used.

overload   |x| >= 0.9995 range
drop-out   the same value to the last bit for 0.2 s and 200 samples, in a channel that has noise otherwise: one of few digits may rest
noise      the eighth difference changes its sign at 200 samples at least and at a fifth of those that move, and the smallest one,
           a step of the converter, is at most range / 2^14. That of white noise is 113 times as large as the noise and does so at
           85 samples of 100; that of hum or vibration of f is smaller by (2 sin(pi f / rate))^8: 1e-4 at f = rate / 20. What
           rounding to steps alone can make of a smooth signal does not count
still      the same value from the first sample to the last: told as information, because nobody knows what it is

Only analog kinds with a range are judged: an encoder, a counter, a digital line or a thermocouple may stand still. The work for a block
is a few passes over it, whatever it holds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from agent.settings import InputSettings

Samples = npt.NDArray[np.float64]

_RANGED = frozenset({"voltage", "current", "acceleration", "force", "velocity", "bridge"})
_OVER = 0.9995
_STILL_SECONDS, _STILL_SAMPLES = 0.2, 200
_NOISE, _SHARE = 200, 0.2
"""Changes of the sign of the eighth difference, and their share of the samples that move, from which on a channel is known to have noise."""
_DIFFERENCE = 8
_ROUNDING = 2.0 ** (_DIFFERENCE - 1)
"""Steps that the eighth difference of a smooth signal can be by rounding: half a step times the sum of the binomials."""
_COMPUTED = 1e-9
"""Share of the range below which a difference is what computing in float64 leaves."""
_FINE = 2.0**-14
"""Share of the range that the smallest step of a channel with noise may be."""
_SPARE = 1.2
"""Times what was measured that a range must hold to be advised."""
_VOLTS = frozenset({"voltage", "acceleration", "force", "velocity"})
"""Kinds that are measured in V: the ranges that a driver tells are theirs."""
_UNITS = {"current": "A", "bridge": "V/V"}
"""Of what the hardware measures, where it is not V."""


class _Tally:
    """How often something was seen in each channel, and first at which sample."""

    def __init__(self, channels: int) -> None:
        self.count, self.first = np.zeros(channels, dtype=np.int64), np.zeros(channels, dtype=np.int64)

    def add(self, seen: npt.NDArray[np.bool_], start: int, *, weight: int = 1, before: int = 0) -> None:
        """Count what is true in a block (channels, n) whose first sample is ``start``; each began ``before`` samples earlier."""
        new = (self.count == 0) & seen.any(axis=1)
        self.first[new] = start - before + seen[new].argmax(axis=1)
        self.count += weight * np.count_nonzero(seen, axis=1)


class Watch:
    """Looks at a recording block by block.

    Parameters
    ----------
    inputs : sequence of InputSettings
        In the order of the rows of a block.
    rate : float
        samples/s.
    ranges : mapping
        Channel of the hardware -> the ranges that it can be set to, as far as the driver tells.
    """

    def __init__(
        self, inputs: Sequence[InputSettings], *, rate: float, ranges: Mapping[str, Sequence[float]] | None = None
    ) -> None:
        count = len(inputs)
        self._inputs, self._rate = inputs, rate
        self._ranges = [sorted((ranges or {}).get(entry.channel, ())) for entry in inputs]
        self._limit = np.array([entry.range if entry.kind in _RANGED else math.inf for entry in inputs])
        self._judged = np.isfinite(self._limit)[:, None]
        self._still = max(_STILL_SAMPLES, math.ceil(_STILL_SECONDS * rate))
        self._over, self._missing, self._stuck = _Tally(count), _Tally(count), _Tally(count)
        self._largest = np.zeros(count)
        self._noise = np.zeros(count, dtype=np.int64)
        self._moved = np.zeros(count, dtype=np.int64)
        self._step = np.full(count, math.inf)
        self._run = np.zeros(count, dtype=np.int64)
        """Samples up to now that were the same."""
        self._before = np.full((count, _DIFFERENCE + 1), math.nan)
        """The samples right before the next block."""
        self._start = 0

    def take(self, block: Samples) -> None:
        """Look at the next samples, shape (channels, n), as the driver delivers them."""
        if not block.shape[1]:
            return
        finite = np.isfinite(block)
        magnitude = np.abs(block)
        over = self._judged & (magnitude >= _OVER * self._limit[:, None])
        self._over.add(over, self._start)
        self._missing.add(~finite, self._start)
        np.maximum(self._largest, magnitude.max(axis=1, where=finite, initial=0.0), out=self._largest)
        known = np.concatenate([self._before, block], axis=1)
        with np.errstate(invalid="ignore"):
            self._count_noise(known)
        self._count_still(over | (block != known[:, _DIFFERENCE:-1]))
        self._before = known[:, -_DIFFERENCE - 1 :].copy()
        self._start += block.shape[1]

    def _count_noise(self, known: Samples) -> None:
        self._moved += np.count_nonzero(np.abs(np.diff(known[:, _DIFFERENCE:], axis=1)) > 0.0, axis=1)
        bends = np.diff(known, n=_DIFFERENCE, axis=1)
        sizes, computed = np.abs(bends), _COMPUTED * self._limit[:, None]
        # not of neighbours: those of hum are all far apart where the rate is a multiple of its frequency
        np.minimum(self._step, sizes.min(axis=1, where=sizes > computed, initial=math.inf), out=self._step)
        signs = np.where(sizes > np.fmax(_ROUNDING * self._step[:, None], computed), np.sign(bends), 0.0)
        self._noise += np.count_nonzero(signs[:, 1:] * signs[:, :-1] < 0.0, axis=1)

    def _count_still(self, moves: npt.NDArray[np.bool_]) -> None:
        """Count the samples of stretches that are long enough; one goes on from block to block. At the end of its range a channel is still anyhow."""
        index = np.arange(1, moves.shape[1] + 1)
        begun = np.maximum.accumulate(np.where(moves, index, 0), axis=1)
        run = np.where(begun > 0, index - begun + 1, index + self._run[:, None])
        self._run = run[:, -1]
        found, more = self._judged & (run == self._still), self._judged & (run > self._still)
        self._stuck.add(found, self._start, weight=self._still, before=self._still - 1)
        self._stuck.add(more, self._start)

    def told(self) -> str:
        """Say in short what is wrong up to now: "overload: position"; empty where nothing is."""
        found = []
        for word, tally in self._seen().items():
            names = [entry.name for entry, count in zip(self._inputs, tally.count, strict=True) if count]
            found += [f"{word}: {', '.join(names)}"] if names else []
        return "; ".join(found)

    def facts(self) -> dict[str, Any]:
        """Return what was seen of each channel, and sentences on it that a person should read; times in s of the recording."""
        channels: dict[str, dict[str, Any]] = {}
        warnings = []
        seen = self._seen()
        for i, entry in enumerate(self._inputs):
            counted = {
                word: {"count": int(tally.count[i]), "first": float(tally.first[i] / self._rate)}
                for word, tally in seen.items()
                if tally.count[i]
            }
            channels[entry.name] = {"largest": float(self._largest[i]), **counted}
            for word, what in counted.items():
                told = (
                    f"{entry.name} {self._sentence(word, i)}: {what['count']} samples, first at {what['first']:.4g} s"
                )
                warnings.append(
                    {"channel": entry.name, "level": "warning", "detail": f"{told}; {self._remedy(word, i)}"}
                )
            advice = "" if counted else self._told_still(i) or self._advice(i)
            if advice:
                warnings.append({"channel": entry.name, "level": "information", "detail": advice})
        return {"channels": channels, "warnings": warnings}

    def _seen(self) -> dict[str, _Tally]:
        stuck = _Tally(len(self._inputs))
        noisy = (self._noise >= np.fmax(_NOISE, _SHARE * self._moved)) & (self._step <= _FINE * self._limit)
        stuck.count, stuck.first = np.where(noisy, self._stuck.count, 0), self._stuck.first
        return {"overload": self._over, "drop-out": stuck, "missing": self._missing}

    def _sentence(self, word: str, i: int) -> str:
        entry = self._inputs[i]
        match word:
            case "overload":
                return f"reached its range of {entry.range:g} {_UNITS.get(entry.kind, 'V')}"
            case "drop-out":
                return "has dropped out, it did not change by a bit"
            case _:
                return "has missing values"

    def _remedy(self, word: str, i: int) -> str:
        if word != "overload":
            return "see to its sensor and cable"
        entry = self._inputs[i]
        if entry.kind not in _VOLTS or not self._ranges[i]:  # nobody knows what the hardware has
            return "set a larger range, or lower the signal"
        larger = next((limit for limit in self._ranges[i] if limit > entry.range * (1 + 1e-9)), None)
        return f"set range = {larger:g}" if larger else "the hardware has no larger one: lower the signal"

    def _told_still(self, i: int) -> str:
        """Say so where a channel had one value only: a cable that is off from the beginning looks so."""
        if not self._judged[i, 0] or self._run[i] < max(self._start, self._still):
            return ""
        entry = self._inputs[i]
        value = f"{float(self._before[i, -1]):.6g} {_UNITS.get(entry.kind, 'V')}"
        return f"{entry.name} was {value} from the beginning to the end; so are a sensor or a cable that are off"

    def _advice(self, i: int) -> str:
        """Say which range would be finer, where the hardware has one that holds what was measured with a fifth to spare."""
        entry, largest = self._inputs[i], float(self._largest[i])
        if entry.kind not in _VOLTS or not largest:
            return ""
        used = min((limit for limit in self._ranges[i] if limit >= entry.range * (1 - 1e-9)), default=entry.range)
        finer = next((limit for limit in self._ranges[i] if limit >= _SPARE * largest), used)
        if finer >= used:
            return ""
        return f"{entry.name}: {largest:.3g} V of {used:g} V used; range = {finer:g} would resolve it {used / finer:.3g} times finer"
