"""Delay margins of a loop with samplers: how much later what is written at a place may arrive where it is read.

Samplers that read a place read what it was τ ago; what holds write there arrives τ later. A delay of whole common periods P only
turns the phase: with z = e^{jθ} on the unit circle and τ = m P + ρ,

    |z(Φ_ρ(e^{-jψ}))| = 1,   ψ = m θ,   m = 0, 1, ...,   0 <= ρ < P

Each crossing of the phase is followed over ρ from 0 to P, where it has turned by θ: so each has a delay margin.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from engine.exact.sampled_data.crossings import Crossing, nearest
from engine.exact.sampled_data.period import Period
from engine.exact.sampled_data.system import Event, ordered, wrapped
from engine.model.errors import UnresolvedError
from engine.model.tangent import INFINITESIMAL, slopes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from engine.exact.sampled_data.system import SampledSystem
    from engine.model.linear_system import Array

_TOGETHER: Final = 1e-14
"""Instants closer than this part of the common period are one: no more than rounding tells."""
_STEPS: Final = 16
_TURN: Final = 0.25
"""How far the phase may turn in one step, rad, of at least so many in a period."""
_HALVINGS: Final = 8
_FAR: Final = 0.1
"""A crossing that turns by more than this in one step, rad, may be another one: the step is halved, so often at most."""
_TRIES: Final = 30
_STILL: Final = 1e-14
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


def delayed(part: SampledSystem, rho: Array) -> Period:
    """Return the common period of a loop with a delay ``rho`` (lanes,) of less than a period at its cut.

    Raises
    ------
    UnresolvedError
        Where what flows into the place flows on from it: such a delay holds endless many states.
    """
    events, lanes, n = part.events(), part.lanes, part.n
    flows = bool(np.any(part.read @ part.flow) or np.any(part.read @ part.driven))
    if np.any(part.direct) or (np.any(part.driven) and flows):
        raise UnresolvedError(
            "a delay margin must be that of a place that samplers read or that holds write, but this one carries a signal that "
            "flows on: open the loop in front of a sampler or behind it"
        )
    reads = not np.any(part.driven)
    at = [
        k
        for k, event in enumerate(events)
        if (np.any(event.entering) if reads else np.any(part.read @ (event.jump - np.eye(n))))
    ]
    size = n + len(at) + (not reads)
    kind = np.result_type(part.flow, *(event.jump for event in events), *(event.entering for event in events))

    def whole(matrix: Array) -> Array:
        found = np.zeros((lanes, size, size), dtype=kind) + np.eye(size)
        found[:, :n, :n] = matrix
        return found

    listed: list[tuple[float, tuple[float, ...], Event]] = []
    nothing = np.zeros((lanes, size, 1))
    for k, event in enumerate(events):
        jump = whole(event.jump)
        if not reads:
            jump[:, :n, -1:] = event.entering
        elif k in at:
            jump[:, :n, n + at.index(k)] = event.entering[:, :, 0]
        instant = float(event.time[0].real)
        listed.append((instant, (1.0,), Event(time=event.time, jump=jump, entering=nothing)))
        if k not in at:
            continue
        place = n + at.index(k)
        kept, entering = whole(np.eye(n)), nothing.copy()
        kept[:, place, place], entering[:, place] = 0.0, 1.0
        moved = wrapped(event.time - rho if reads else event.time + rho, part.period)
        then = float(moved[0].real)
        if reads:
            listed.append((then, (0.0,), Event(time=moved, jump=kept, entering=entering)))
        else:
            listed.append((instant, (1.0,), Event(time=event.time, jump=kept, entering=entering)))
            arrives = whole(np.eye(n))
            arrives[:, -1, -1], arrives[:, -1, place] = 0.0, 1.0
            listed.append((then, (2.0,), Event(time=moved, jump=arrives, entering=nothing)))
    flow = np.zeros((lanes, size, size), dtype=kind)
    flow[:, :n, :n] = part.flow
    if not reads:
        flow[:, :n, -1:] = part.driven
    read = np.concatenate([part.read, np.zeros((lanes, 1, size - n))], axis=2)
    grown = replace(part, flow=flow, driven=nothing, read=read)
    return Period(grown, events=ordered(listed, _TOGETHER * float(part.period[0].real)))


def delay_margins(part: SampledSystem, begun: Sequence[Begun]) -> list[tuple[Array, Array]]:
    """Return (frequency in rad/s, delay in s) of every crossing, each (lanes,) with its infinitesimals.

    Raises
    ------
    UnresolvedError
        Where the place is no such place, or a crossing is lost before the smallest of these delays. One that is lost later is
        not listed.
    """
    value = part.value
    length = float(value.period[0])
    found: list[tuple[Array, Array]] = []
    borne = np.inf
    for start in begun:
        first = _Followed(rho=0.0, phase=start.phase, angle=start.angle, crossing=start.crossing)
        trail = [_follow(value, first, 0.0, length)]
        try:
            found.append(_first(part, value, trail, length))
        except _LostError:  # the loop gain has left 1 between two samples: so far this crossing has borne the delay
            borne = min(borne, trail[-1].rho)
    found.sort(key=lambda one: float(one[1][0].real))
    if borne < (float(found[0][1][0].real) if found else np.inf):
        raise _LostError
    return found


def _first(part: SampledSystem, value: SampledSystem, trail: list[_Followed], length: float) -> tuple[Array, Array]:
    """Return the smallest delay at which a crossing has used up its phase; ``trail`` is where it has been followed."""
    from scipy.optimize import brentq  # noqa: PLC0415 - a quarter of a second

    count = max(_STEPS, int(np.ceil(abs(trail[0].angle) / _TURN)))
    turns = max(0, int(trail[0].phase // trail[0].angle) - 1)
    for m in range(turns, turns + 4):
        for k in range(count):
            if len(trail) == k + 1:
                trail.append(_follow(value, trail[-1], length * (k + 1) / count * (1 - 1e-12), length))
            one, other = trail[k], trail[k + 1]
            if one.phase - m * one.angle >= 0 > other.phase - m * other.angle:
                rho = brentq(_left, one.rho, other.rho, args=(value, one, m, length), xtol=1e-16 * length, rtol=1e-14)
                return _moving(part, value, _follow(value, one, float(rho), length), m)
    raise _LostError


def _left(rho: float, value: SampledSystem, near: _Followed, turns: int, length: float) -> float:
    at = _follow(value, near, rho, length)
    return at.phase - turns * at.angle


def _follow(value: SampledSystem, before: _Followed, rho: float, length: float, halvings: int = _HALVINGS) -> _Followed:
    """Return a crossing at ``rho`` from where it was before, in shorter steps where it cannot be told from others."""
    found = _step(value, before, rho, length)
    if found is not None:
        return found
    if not halvings:
        raise _LostError
    middle = _follow(value, before, 0.5 * (before.rho + rho), length, halvings - 1)
    return _follow(value, middle, rho, length, halvings - 1)


def _step(value: SampledSystem, before: _Followed, rho: float, length: float) -> _Followed | None:
    """Return the crossing at ``rho``, by Newton's method on ln|z| as a function of the phase; None where it is lost."""
    period = delayed(value, np.array([rho]))
    phase = begun = before.phase - before.angle * (rho - before.rho) / length
    expected = before.crossing.eigenvalue
    for turn in range(_TRIES):
        gain = complex(np.exp(-1j * phase))
        crossing = nearest(lambda q: period.maps(np.exp(-1j * q)), phase, expected)
        if crossing is None:
            break
        aside = -1j * gain * INFINITESIMAL
        re, im = np.array([complex(gain.real, aside.real)]), np.array([complex(gain.imag, aside.imag)])
        step = complex(crossing.rate(period.motion(re, im))[0])
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


def _moving(part: SampledSystem, value: SampledSystem, at: _Followed, turns: int) -> tuple[Array, Array]:
    """Let a delay margin carry its infinitesimals: a dρ - j (1 + m c) dθ = -e, with a, c and e the motions of ln z."""
    lanes, period = part.lanes, part.period
    frequency, delay = at.angle / period, turns * period + at.rho
    if not part.moves:
        return np.asarray(frequency), np.asarray(delay)
    gain = complex(np.exp(-1j * at.phase))
    re, im = np.array([gain.real]), np.array([gain.imag])
    later = delayed(value, np.array([at.rho + 1j * INFINITESIMAL]))
    a = complex(at.crossing.rate(later.motion(re, im))[0])
    c = complex(
        at.crossing.rate(
            delayed(value, np.array([at.rho])).motion(re * (1 + 1j * INFINITESIMAL), im * (1 + 1j * INFINITESIMAL))
        )[0]
    )
    e = at.crossing.rate(delayed(part, np.full(lanes, at.rho)).motion(re, im))
    other = 1 + turns * c
    matrix = np.array([[a.real, other.imag], [a.imag, -other.real]])
    moved = np.linalg.solve(matrix, -np.stack([np.broadcast_to(e.real, (lanes,)), np.broadcast_to(e.imag, (lanes,))]))
    delay = delay.real + 1j * INFINITESIMAL * (turns * slopes(period) + moved[0])
    frequency = (at.angle + 1j * INFINITESIMAL * moved[1]) / period
    return np.asarray(frequency), np.asarray(delay)
