"""Delay margins of a loop with samplers: how much later what is written at a place may arrive where it is read.

A delay of whole common periods P only turns the phase: with z = e^{jθ} on the unit circle and τ = m P + ρ,

    |z(Φ_ρ(e^{-jψ}))| = 1,   ψ = m θ,   m = 0, 1, ...,   0 <= ρ < P

Each crossing of the phase is followed over ρ from 0 to P, where it has turned by θ: so each has a delay margin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from engine.exact.sampled_data.crossings import Crossing, nearest
from engine.model.errors import UnresolvedError
from engine.model.tangent import INFINITESIMAL, slopes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from engine.exact.sampled_data.period import Period
    from engine.exact.sampled_data.system import SampledSystem
    from engine.model.linear_system import Array

_STEPS: Final = 16
_TURN: Final = 0.25
"""How far the phase may turn in one step, rad, of at least so many in a period."""
_HALVINGS: Final = 8
_FAR: Final = 0.1
"""A crossing that turns by more than this in one step, rad, may be another one: the step is halved, so often at most."""
_TRIES: Final = 30
_STILL: Final = 1e-14
_STEP: Final = 1e-9
"""What a delay moves ln z by in a period at least; else it counts only where it brings a value behind another sample, and has no slope."""
_ROUNDED: Final = 1e-11
"""Newton's method stands still where a correction of the phase, rad, is the first of these, or the second after many."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Begun:
    """A crossing of the phase without a delay, at a positive frequency: the phase in [0, 2 π) and θ, turns counted."""

    phase: float
    angle: float
    crossing: Crossing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Followed:
    """The same crossing at some ρ."""

    rho: float
    phase: float
    angle: float
    crossing: Crossing


class _LostError(UnresolvedError):
    """A crossing ends while it is followed."""

    def __init__(self) -> None:
        super().__init__(
            "a crossing of the loop must be followed while its delay grows, but it ends: its delay margin is not known"
        )


class Later(Protocol):
    """A loop whose signal arrives ``rho`` later at its cut, (lanes,) or (1,): as it is, and by its real part alone, as one lane."""

    def moving(self, rho: Array) -> Period:
        """Return its common period with all lanes."""
        ...

    def value(self, rho: Array) -> Period:
        """Return its common period; only ``rho`` carries an infinitesimal."""
        ...


def delay_margins(part: SampledSystem, later: Later, begun: Sequence[Begun]) -> list[tuple[Array, Array]]:
    """Return (frequency in rad/s, delay in s) of every crossing, each (lanes,) with its infinitesimals.

    Raises
    ------
    UnresolvedError
        Where a crossing is lost before the smallest of these delays. One that is lost later is not listed.
    """
    length = float(part.period[0].real)
    found: list[tuple[Array, Array]] = []
    borne = np.inf
    for start in begun:
        first = _Followed(rho=0.0, phase=start.phase, angle=start.angle, crossing=start.crossing)
        trail = [_follow(later, first, 0.0, length)]
        try:
            found.append(_first(part, later, trail, length))
        except _LostError:  # the loop gain has left 1 between two samples: so far this crossing has borne the delay
            borne = min(borne, trail[-1].rho)
    found.sort(key=lambda one: float(one[1][0].real))
    if borne < (float(found[0][1][0].real) if found else np.inf):
        raise _LostError
    return found


def _first(part: SampledSystem, later: Later, trail: list[_Followed], length: float) -> tuple[Array, Array]:
    """Return the smallest delay at which a crossing has used up its phase; ``trail`` is where it has been followed."""
    from scipy.optimize import brentq  # noqa: PLC0415 - a quarter of a second

    count = max(_STEPS, int(np.ceil(abs(trail[0].angle) / _TURN)))
    turns = max(0, int(trail[0].phase // trail[0].angle) - 1)
    for m in range(turns, turns + 4):
        for k in range(count):
            if len(trail) == k + 1:
                trail.append(_follow(later, trail[-1], length * (k + 1) / count * (1 - 1e-12), length))
            one, other = trail[k], trail[k + 1]
            if one.phase - m * one.angle >= 0 > other.phase - m * other.angle:
                rho = brentq(_left, one.rho, other.rho, args=(later, one, m, length), xtol=1e-16 * length, rtol=1e-14)
                return _moving(part, later, _follow(later, one, float(rho), length), m)
    raise _LostError


def _left(rho: float, later: Later, near: _Followed, turns: int, length: float) -> float:
    at = _follow(later, near, rho, length)
    return at.phase - turns * at.angle


def _follow(later: Later, before: _Followed, rho: float, length: float, halvings: int = _HALVINGS) -> _Followed:
    """Return a crossing at ``rho`` from where it was before, in shorter steps where it cannot be told from others."""
    found = _step(later, before, rho, length)
    if found is not None:
        return found
    if not halvings:
        raise _LostError
    middle = _follow(later, before, 0.5 * (before.rho + rho), length, halvings - 1)
    return _follow(later, middle, rho, length, halvings - 1)


def _step(later: Later, before: _Followed, rho: float, length: float) -> _Followed | None:
    """Return the crossing at ``rho``, by Newton's method on ln|z| as a function of the phase; None where it is lost."""
    period = later.value(np.array([rho]))
    phase = begun = before.phase - before.angle * (rho - before.rho) / length
    expected = before.crossing.eigenvalue
    for turn in range(_TRIES):
        gain = complex(np.exp(-1j * phase))
        crossing = nearest(lambda q: period.maps(np.exp(-1j * q)), phase, expected)
        if crossing is None:
            break
        step = -1j * gain * period.pull(crossing, gain)
        height = float(np.log(abs(crossing.eigenvalue)))
        change = height / step.real if step.real else np.inf
        if not abs(change) < 1.0:
            break
        if abs(change) < (_STILL if turn < _TRIES // 2 else _ROUNDED):
            moved = float(np.angle(crossing.eigenvalue / expected))
            if abs(moved) > _FAR or abs(phase - begun) > _FAR:  # another one
                return None
            return _Followed(rho=rho, phase=phase, angle=before.angle + moved, crossing=crossing)
        phase -= change
    return None


def _moving(part: SampledSystem, later: Later, at: _Followed, turns: int) -> tuple[Array, Array]:
    """Let a delay margin carry its infinitesimals: a dρ - j (1 + m c) dθ = -e, with a, c and e the motions of ln z."""
    lanes, period = part.lanes, part.period
    frequency, delay = at.angle / period, turns * period + at.rho
    if not part.moves:
        return np.asarray(frequency), np.asarray(delay)
    gain = complex(np.exp(-1j * at.phase))
    re, im = np.array([gain.real]), np.array([gain.imag])
    rho = np.array([at.rho])
    here = later.value(rho)
    crossing = here.lifted(at.crossing, gain)
    a = complex(later.value(rho + 1j * INFINITESIMAL).rate(crossing, re, im)[0])
    c = gain * here.pull(at.crossing, gain)
    e = later.moving(rho).rate(crossing, re, im)
    if abs(a) * float(period[0].real) < _STEP:
        a = complex(np.nan, np.nan)
    other = 1 + turns * c
    matrix = np.array([[a.real, other.imag], [a.imag, -other.real]])
    moved = np.linalg.solve(matrix, -np.stack([np.broadcast_to(e.real, (lanes,)), np.broadcast_to(e.imag, (lanes,))]))
    delay = delay.real + 1j * INFINITESIMAL * (turns * slopes(period) + moved[0])
    frequency = (at.angle + 1j * INFINITESIMAL * moved[1]) / period
    return np.asarray(frequency), np.asarray(delay)
