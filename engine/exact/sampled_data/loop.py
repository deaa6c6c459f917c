"""Margins of a loop with samplers: what gain or phase brings an eigenvalue of the map over the common period to the unit circle.

gain:  |z(Φ(k))| = 1, k > 0;   phase:  |z(Φ(e^{-jφ}))| = 1, -π < φ <= π
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from engine.exact.sampled_data.aliases import marked, turns
from engine.exact.sampled_data.build import sampled_system
from engine.exact.sampled_data.crossings import Crossing, crossings
from engine.exact.sampled_data.delayed import Begun, delay_margins
from engine.exact.sampled_data.period import Period
from engine.model.strongly_connected_components import circles
from engine.model.tangent import INFINITESIMAL

if TYPE_CHECKING:
    from engine.exact.laws.system import NonlinearSystem
    from engine.exact.sampled_data.system import SampledSystem
    from engine.model.linear_system import Array

Margin = tuple["Array", "Array"]
"""(frequency in rad/s, margin), each of shape (lanes,)."""

_GAINS: Final = (-6.0, 3.0, 9.0)
"""Powers of ten: where the scan of the gain begins, where it ends, and where it ends if nothing has bounded the gain by then."""
_PER_DECADE: Final = 24
_ANGLES: Final = 96
_AT_ONE: Final = 0.00137
"""The grid of the gain does not hold 1 itself, where a loop on the stability limit has its crossing."""
_AT_NONE: Final = 1e-7
"""Nor does that of the phase hold 0."""
_LOOKS: Final = 8
_NO_DELAY: Final = 1e-9
"""A delay shorter than this part of the common period cannot be told from none."""
_STILL: Final = 1e-10
"""A crossing whose eigenvalue hardly moves with the gain is that of a mode that the loop does not reach."""


class SampledLoop:
    """A system cut open at one place.

    Parameters
    ----------
    laws : NonlinearSystem
        Whose only laws are samplers; the last input feeds what reads the place, the last output is what is written there.
        Closed by u = y.
    """

    def __init__(self, laws: NonlinearSystem) -> None:
        self._laws = laws
        self.whole = _cut_open(laws)
        self.part = _in_circle(self.whole)
        self.lanes = laws.lanes

    def moving(self, rho: Array) -> Period:
        """Return the common period of the loop with its signal ``rho`` later, (1,)."""
        return self._later(self._laws, rho)

    def value(self, rho: Array) -> Period:
        """Return the same of the common real part alone; ``rho`` may carry an infinitesimal."""
        return self._later(self._laws.value, rho)

    def _later(self, laws: NonlinearSystem, rho: Array) -> Period:
        none = float(rho[0].real) < _NO_DELAY * float(self.period.length[0].real)
        later = None if none else rho
        if self._brings and laws is not self._laws:
            moving = sampled_system(self._laws, opened=True, later=None if none else rho.real)
            states = _circle(moving)
            alive = Period(_alone(moving, states)).alive
            return Period(_alone(sampled_system(laws, opened=True, later=later), states), alive=alive)
        if self._brings:
            return Period(_in_circle(sampled_system(laws, opened=True, later=later)))
        return Period(self.part if none and laws is self._laws else _in_circle(_cut_open(laws, later)))

    @cached_property
    def _brings(self) -> bool:
        """Whether a lane follows something that its real part does not: what a gain of 0 would take on."""
        s = self.whole
        jumps = [part for one in s.samplings for part in (one.taken, one.entering, one.updated) if part is not None]
        return any(np.any((part.real == 0) & (part.imag != 0)) for part in (s.flow, s.driven, s.read, *jumps))

    @property
    def closes(self) -> bool:
        """Whether what leaves the cut comes back to it through a sampler."""
        return bool(self.part.samplings)

    @cached_property
    def period(self) -> Period:
        """The common period of the rates in the loop."""
        return Period(self.part)

    @cached_property
    def gain_margins(self) -> tuple[list[Margin], float]:
        """Every gain margin, and the loop gain that those beyond the scan fall below."""
        first, last, further = _GAINS
        found = self._gains(first, last)
        if any(float(margin[0].real) >= 1 - 1e-9 for _, margin in found):
            return found, 10**-last
        return [*found, *self._gains(last, further)], 10**-further

    def _gains(self, low: float, high: float) -> list[Margin]:
        count = round((high - low) * _PER_DECADE) + 1
        grid = np.log(10.0) * np.linspace(low, high, count) + _AT_ONE
        found = []
        for crossing in crossings(lambda q: self._value.maps(np.exp(q)), grid):
            gain = float(np.exp(crossing.at))
            step = self._value.pull(crossing, complex(gain))
            if abs(step.real) * gain > _STILL:
                found.append(self._margin(crossing, gain, complex(gain), step))
        return _single(found)

    @cached_property
    def _phases(self) -> list[tuple[Crossing, Margin]]:
        """Every crossing of the phase with its margin, at positive frequencies."""
        found = []
        grid = np.linspace(0.0, np.pi, _ANGLES + 1) + _AT_NONE
        for crossing in crossings(lambda q: self._value.maps(np.exp(-1j * q)), grid):
            gain = complex(np.exp(-1j * crossing.at))
            step = -1j * gain * self._value.pull(crossing, gain)
            if abs(step.real) > _STILL:
                frequency, margin = self._margin(crossing, crossing.at, gain, step)
                if float(frequency[0].real) >= 0:
                    found.append((crossing, (frequency, margin)))
                else:
                    found.append((crossing.mirrored(), (-frequency, -margin)))
        return sorted(found, key=lambda one: float(one[1][0][0].real))

    @property
    def phase_margins(self) -> list[Margin]:
        """Every phase margin in (-π, π], of the crossings at positive frequencies."""
        return [margin for _, margin in self._phases]

    @cached_property
    def delay_margins(self) -> list[Margin]:
        """The delay margin of every crossing at a positive frequency; :func:`delay_margins` tells what is raised."""
        length = float(self.period.length[0].real)
        begun = [
            Begun(phase=float(margin[0].real) % (2 * np.pi), angle=float(frequency[0].real) * length, crossing=crossing)
            for crossing, (frequency, margin) in self._phases
        ]
        return delay_margins(self.part, self, begun)

    @cached_property
    def _value(self) -> Period:
        return Period(self.part.value, alive=self.period.alive)

    @cached_property
    def _marked(self) -> Period:
        return marked(self.part.value, _LOOKS)

    def _margin(self, crossing: Crossing, value: float, gain: complex, step: complex) -> Margin:
        """Return frequency and margin with their infinitesimals; ``step`` is d ln z for a step of the margin."""
        length = self.period.length
        angle = np.angle(crossing.eigenvalue) + 2 * np.pi * self._alias(crossing, gain)
        if not self.part.moves:
            return np.full(self.lanes, angle / length.real), np.full(self.lanes, value)
        moved = self.period.rate(self._value.lifted(crossing, gain), np.array([gain.real]), np.array([gain.imag]))
        slope = -moved.real / step.real
        turned = moved.imag + step.imag * slope
        frequency = (angle + 1j * INFINITESIMAL * turned) / length
        return np.asarray(frequency), np.asarray(value + 1j * INFINITESIMAL * slope)

    def _alias(self, crossing: Crossing, gain: complex) -> int:
        """Return how many turns per common period the signal at the cut mostly makes more than ln z says."""
        if len(self.part.samplings) == 1:
            return 0
        signal = self._marked.passage(self._value.lifted(crossing, gain).right, gain) @ self._marked.system.read[0, -1]
        return int(turns(np.array([crossing.eigenvalue]), signal[:, None, None])[0])


def _cut_open(laws: NonlinearSystem, later: Array | None = None) -> SampledSystem:
    """Return what lies between the two ends of the cut."""
    opened = sampled_system(laws, opened=True, later=later)
    return opened.path(len(opened.inputs) - 1, len(opened.outputs) - 1)


def _in_circle(system: SampledSystem) -> SampledSystem:
    """Return the states that what leaves the cut passes on its way back to it."""
    return _alone(system, _circle(system))


def _alone(system: SampledSystem, states: npt.NDArray[np.int64]) -> SampledSystem:
    """Return these states with the two ends of the cut."""
    return system.part(states).between([len(system.inputs) - 1], [len(system.outputs) - 1])


def _circle(system: SampledSystem) -> npt.NDArray[np.int64]:
    """Return which states what leaves the cut passes on its way back to it."""
    n = system.n
    acts = np.zeros((n + 1, n + 1), dtype=bool)
    acts[:n, :n] = system.pattern
    acts[:n, n] = np.any(system.driven[:, :, -1] != 0, axis=0)
    for sampling in system.samplings:
        acts[:n, n] |= np.any(sampling.entering[:, :, -1] != 0, axis=0)
    acts[n, :n] = np.any(system.read[:, -1] != 0, axis=0)
    for circle in circles([np.flatnonzero(row).tolist() for row in acts]):
        if n in circle:
            return np.array([state for state in circle if state != n], dtype=np.int64)
    raise AssertionError("every node is in a group")


def _single(found: list[Margin]) -> list[Margin]:
    """Return each margin once, at its positive frequency: a complex pair passes the circle together."""
    kept: list[Margin] = []
    for frequency, margin in found:
        sign = 1.0 if float(frequency[0].real) >= 0 else -1.0
        value = float(margin[0].real)
        if not any(
            abs(float(m[0].real) - value) <= 1e-9 * value
            and abs(float(w[0].real) - sign * float(frequency[0].real)) <= 1e-6 * max(abs(float(w[0].real)), 1e-9)
            for w, m in kept
        ):
            kept.append((sign * frequency, margin))
    return sorted(kept, key=lambda one: float(one[0][0].real))
