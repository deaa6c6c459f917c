"""Frequency response from the samples of an input to those of an output, exact: what a measurement of samples shows.

    held, linear    G(z) = (1 - z⁻¹) Σ_m D_m z⁻ᵐ,    z = e^{jωh},    D_m: what each interval contributes to a step response
    band-limited    G(jω)

Where no delay is in a loop the sum is a closed form: each chain is read between the samples, as late as its delays are.
With delays in loops it is summed until D, or its first, second or third difference (of a path that integrates so often),
stands still.

References
----------
K. J. Åström, B. Wittenmark, "Computer-Controlled Systems", 3rd ed., Prentice Hall 1997, sections 2.3 (delays of parts of a sample) and 7.7.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from engine.exact.frequency.delayed_chains import chains
from engine.exact.frequency.path import connected, path
from engine.exact.frequency.poles import poles
from engine.exact.time.sampled import AFTER, AFTER_LIFTED, Way, balanced, interval
from engine.exact.time.short_delay import lifted
from engine.model.between_samples import BetweenSamples
from engine.model.errors import UnresolvedError
from engine.model.linear_system import ARRAYS
from engine.model.tangent import slopes

if TYPE_CHECKING:
    from engine.model.linear_system import LaneSystem

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

_FEWEST, _MOST = 256, 1 << 17
_STILL: Final = 1e-10
_INTEGRATIONS: Final = 3
_AT_ONCE: Final = 1 << 20
_LOWEST: Final = 1e-8
_GROWS: Final = 1e-6
"""Nepers per sample from which on a pole is none at 0 that rounding has moved."""
_BOUNDLESS = "the path with delays must settle, or grow as a power of time, to have a response from sample to sample"


def sampled_frequency_response(
    system: LaneSystem, ends: tuple[int, int], frequencies: Real, *, sample_time: float, way: BetweenSamples
) -> Complex:
    """Return G at angular frequencies, shape (frequencies,).

    Parameters
    ----------
    system : LaneSystem
        Its first lane counts.
    ends : (int, int)
        Numbers of an input and an output.
    frequencies : ndarray, shape (frequencies,)
        rad/s, >= 0; at 0 the limit of a path that settles.
    sample_time : float
        h in s.
    way : BetweenSamples
        HOLD or LINEAR; a band-limited input sees the continuous response.

    Raises
    ------
    UnresolvedError
        For a path with delays in loops whose step response neither settles nor grows as a power of time.
    """
    h, (source, target) = sample_time, ends
    frequencies = np.maximum(frequencies, _LOWEST / h)
    back = np.exp(-1j * frequencies * h)
    held = way is BetweenSamples.HOLD
    now = replace(system, **{name: getattr(system, name)[:1].real for name in ARRAYS})
    ways = chains(connected(now, [source], [target]))
    if ways is not None:
        found = np.zeros(frequencies.size, dtype=np.complex128)
        for one in ways:
            found += _late(balanced(path(one.part, [0], [0])), one.delay / h, back, h, held=held)
        return found
    raised, moves = lifted(system, h)
    part = balanced(path(connected(raised, [source], [target]), [0], [0]))
    steps = Way(way=way, rows=1, h=h, after=(AFTER_LIFTED if moves.size else AFTER) * h)
    if np.any(poles(part.value).values.real * h > _GROWS):
        raise UnresolvedError(_BOUNDLESS)
    count = _FEWEST
    while count <= _MOST:
        rows = steps.step(part, count)[1][:, 0]
        sequence = rows[0].real + moves @ slopes(rows)[system.lanes :]
        for differences in range(_INTEGRATIONS + 1):
            tail = sequence[-count // 8 :]
            if np.ptp(tail) <= _STILL * np.abs(sequence).max():
                rest = float(tail.mean())
                whole = _sum(sequence - rest, back) + rest / (1 - back)
                return np.asarray((1 - back) ** (1 - differences) * whole)
            sequence = np.diff(sequence, prepend=0.0)
        count *= 2
    raise UnresolvedError(_BOUNDLESS)


def _late(part: LaneSystem, delay: float, back: Complex, h: float, *, held: bool) -> Complex:
    """Return G of a path without delays, heard so many samples later."""
    whole = math.floor(delay + AFTER)
    rest = max(delay - whole, 0.0)
    advance, read = (array[0].real for array in interval(part, h, 0 if held else 1))
    begin = np.eye(part.n + 1)[:, -1:]
    states = np.linalg.solve(np.eye(part.n + 1) - back[:, None, None] * advance, begin)[..., 0] * (1 - back)[:, None]
    if rest <= AFTER:
        return np.asarray(back**whole * (states @ read[0 if held else 1]))
    # what is heard at a sample left the path between the two samples before, at 1 - rest of the interval
    until, seen = (array[0].real for array in interval(part, (1 - rest) * h, 0 if held else 1))
    if held:
        return np.asarray(back ** (whole + 1) * (states @ (seen[0] @ until)))
    early = (1 - rest) * seen[1]
    return np.asarray(back**whole * (states @ early + back * (states @ (read[1] - early))))


def _sum(sequence: Real, back: Complex) -> Complex:
    """Return Σ_m sequence_m back^m."""
    powers = np.arange(sequence.size)
    found = np.zeros(back.size, dtype=np.complex128)
    width = max(1, _AT_ONCE // sequence.size)
    for first in range(0, back.size, width):
        part = slice(first, first + width)
        found[part] = np.exp(1j * np.outer(np.angle(back[part]), powers)) @ sequence
    return found
