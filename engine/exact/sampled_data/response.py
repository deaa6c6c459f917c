"""Frequency responses of sampled systems: what comes back at the frequency that goes in, of all that the samplers make of it.

A place that samplers read, or that holds write, carries a sequence: its response is that of the sequence, at one rate the
usual L(e^{jωT}). Any other signal is followed between the samples, and its fundamental is the mean over the period.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Final, Self

import numpy as np
import numpy.typing as npt

from engine.exact.frequency.poles import Poles
from engine.exact.frequency.response import FrequencyResponse
from engine.exact.sampled_data.fundamental import cut, fundamental
from engine.exact.sampled_data.poles import autonomous
from engine.model.tangent import INFINITESIMAL

if TYPE_CHECKING:
    from engine.exact.frequency.shapes import Shape
    from engine.exact.sampled_data.loop import Margin, SampledLoop
    from engine.exact.sampled_data.system import SampledSystem
    from engine.model.linear_system import Array

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

_CHUNK: Final = 1_000_000
"""Numbers in one block of matrices of an evaluation."""
_MOST: Final = 256
"""Frequencies in one block."""
_ROUNDING: Final = 1e-12
"""What rounding may make of a response, as a part of 1 and of its largest value."""


class SampledResponse(FrequencyResponse):
    """The response of a sampled system with one input and one output, below the Nyquist frequency.

    Parameters
    ----------
    system : SampledSystem
        One input, one output, at least one sampler.
    found : Poles
        Where the scan looks closely.
    sign : float
        -1 for an open loop, so that 1 + L = 0 is the characteristic equation.
    loop : SampledLoop, optional
        What knows the margins of an open loop.
    sequence : bool
        Whether the input may be taken as a sequence: at the two ends of a cut it is the same signal.
    """

    def __init__(
        self,
        system: SampledSystem,
        found: Poles,
        *,
        sign: float = 1.0,
        loop: SampledLoop | None = None,
        sequence: bool = False,
    ) -> None:
        corners = found.values[~found.at_zero]
        super().__init__(autonomous(np.zeros((system.lanes, 0, 0))), corners=corners)
        self._sign = sign
        self.loop = loop
        self._cut = cut(system, sequence=sequence)
        self._top = 0.0

    @property
    def nyquist(self) -> float:
        """The Nyquist frequency of the place, rad/s: of a path that of the fastest sampler."""
        own = self._cut
        if own.read_at:
            return float(np.pi * len(own.read_at) / own.length[0].real)
        return float(np.pi / min(float(s.period[0].real) for s in own.system.samplings))

    def with_rounding(self, frequencies: Real) -> tuple[Complex, Real]:
        """Return the response at ``frequencies``, rad/s, and what rounding may have made of it, shapes (k,).

        Of a sequence it is NaN beyond the Nyquist frequency.
        """
        step = int(np.clip(_CHUNK // max(self._cut.system.n, 1) ** 2, 1, _MOST))
        parts = [self._at(frequencies[k : k + step]) for k in range(0, len(frequencies), step)]
        found = np.concatenate([re + 1j * im for re, im in parts]) if parts else np.zeros(0, complex)
        beyond = bool(self._cut.read_at) & (frequencies > self.nyquist * (1 + 1e-9))
        # where holds let nothing through, between multiples of the rate, only rounding is left
        self._top = max(self._top, float(np.abs(found[np.isfinite(found)]).max(initial=0.0)))
        rounding = np.full(len(frequencies), _ROUNDING * min(1.0, self._top))
        return np.where(beyond, complex(np.nan, np.nan), found), rounding

    def _at(self, frequencies: Array) -> tuple[Array, Array]:
        re, im = self._sign * fundamental(self._cut.value, np.asarray(frequencies))
        return re, im

    def pair(self, frequency: Array) -> tuple[Array, Array]:
        """Return (Re G, Im G) at one frequency, each of shape (lanes,) with its infinitesimals."""
        lanes = self._cut.system.lanes
        re, im = self._sign * fundamental(self._cut, np.broadcast_to(np.asarray(frequency), (lanes,)))
        return re, im

    def slope(self, shape: Shape, frequencies: Real) -> Real:
        """Return the derivative of ``shape`` of the real response with respect to ω, shape (k,)."""
        re, im = self._at(frequencies + 1j * INFINITESIMAL)
        return np.asarray(np.imag(shape(re, im)) / INFINITESIMAL)

    @cached_property
    def direct(self) -> Array:
        """The response at the Nyquist frequency, where the axis ends, shape (lanes,)."""
        return self.pair(np.asarray(self.nyquist))[0]

    @property
    def corner_frequencies(self) -> Complex:
        """The poles below the Nyquist frequency."""
        return self._corners[np.abs(self._corners.imag) < self.nyquist]

    @cached_property
    def _scan(self) -> tuple[Real, Complex, float]:
        corners, top = self.corner_frequencies, self.nyquist
        low = 1e-3 * min([*np.abs(corners), top])
        for _ in range(6):
            ends = np.abs(self(np.array([low, 10 * low])))
            if ends[0] > 10 or not ends[0] > 3 * ends[1]:
                break
            low /= 10
        omega = np.geomspace(low, top, int(np.clip(30 * np.log10(top / low), 60, 600)))
        for corner in corners:
            width = max(abs(corner.real), 1e-9 * abs(corner))
            around = abs(corner.imag) + width * np.array([-8, -4, -2, -1, -0.5, 0, 0.5, 1, 2, 4, 8])
            omega = np.concatenate([omega, around[(around > low) & (around < top)]])
        omega = np.append(np.unique(omega[omega < top * (1 - 1e-9)]), top)
        omega = omega[np.diff(omega, prepend=0.0) > 1e-12 * omega]
        return *self._refined(omega), np.inf

    @property
    def gain_margins(self) -> tuple[list[Margin], float]:
        """Every gain margin; see :class:`SampledLoop`."""
        assert self.loop is not None
        return self.loop.gain_margins if self.loop.closes else ([], 1e-9)

    @property
    def phase_margins(self) -> list[Margin]:
        """Every phase margin."""
        assert self.loop is not None
        return self.loop.phase_margins if self.loop.closes else []

    @property
    def delay_margins(self) -> list[Margin]:
        """Every delay margin; :func:`engine.exact.sampled_data.delayed.delay_margins` tells what is raised."""
        assert self.loop is not None
        return self.loop.delay_margins if self.loop.closes else []

    @classmethod
    def of_loop(cls, loop: SampledLoop, found: Poles) -> Self:
        """Return L of a loop that has been cut."""
        ends = [len(loop.whole.inputs) - 1], [len(loop.whole.outputs) - 1]
        return cls(loop.whole.between(*ends), found, sign=-1.0, loop=loop, sequence=True)
