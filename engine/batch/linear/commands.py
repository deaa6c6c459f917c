"""A command as states of its own, w' = S w, which jump at its corners: polynomials are chains of integrators, sines are rotations.

u = K w;   between corners a polynomial is its value and derivatives, a sine its value and its quarter turn
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt
from numpy.polynomial import chebyshev

from engine.signals._copies import Copied

if TYPE_CHECKING:
    from engine.signals import Signal

Real = npt.NDArray[np.float64]

MOST_CORNERS: Final = 4000
MOST_STATES: Final = 24
_SMOOTH: Final = 9
"""Degree of the polynomials that stand for a command which is smooth and no polynomial, a chirp say."""
_FITS: Final = 1e-13
_WAVES: Final = 15
_TURN: Final = 3.2
"""Degree of the polynomials that stand for many sines, and by how many rad the fastest turns in one: they are off by 2 J_16(1.6) < 3e-15."""
_SHORTEST: Final = 1e-6


class NotCoveredError(Exception):
    """No states make this command, or too many."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Command:
    """All inputs of an experiment.

    Parameters
    ----------
    times : ndarray, shape (corners,)
        From 0 on, rising, s: where the states are set, ``states`` (corners, w).
    flow : ndarray, shape (w, w)
        S.
    drive : ndarray, shape (inputs, w)
        K.
    impulses : ndarray, shape (inputs,)
        Integrals of impulses at time 0.
    rate : float
        The fastest that S turns, or that the pieces which stand for a smooth command are made for, rad/s.
    endless : bool
        It never settles; ``turning`` if it is made of sines as well, so that its last states are no polynomial.
    last : float
        Its last corner, s.
    jumps : ndarray, shape (corners, w)
        By how much the states jump at each corner.
    """

    times: Real
    states: Real
    flow: Real
    drive: Real
    impulses: Real
    rate: float
    endless: bool
    turning: bool
    last: float
    jumps: Real


@dataclass(frozen=True, kw_only=True, eq=False)
class _One:
    """One input's command: ``states`` (corners, w), ``flow`` (w, w), ``drive`` (w,)."""

    times: Real
    states: Real
    flow: Real
    drive: Real
    rate: float = 0.0
    turning: bool = False
    waving: bool = False
    """Polynomials stand for sines, as far as anyone looks."""


def commanded(signals: Sequence[Signal], horizon: float, marks: Sequence[float]) -> Command:
    """Return the states that make ``signals`` up to ``horizon`` (s); corners are put at ``marks`` (s) as well.

    Raises
    ------
    NotCoveredError
        If there are no such states, or too many.
    """
    ones = [_made(signal, horizon) for signal in signals]
    times = np.unique(np.concatenate([[0.0], *(one.times for one in ones), np.asarray(marks, dtype=float)]))
    sizes = [len(one.drive) for one in ones]
    if len(times) > MOST_CORNERS or sum(sizes) > MOST_STATES:
        raise NotCoveredError
    flow, drive = np.zeros((sum(sizes), sum(sizes))), np.zeros((len(ones), sum(sizes)))
    states, jumps = np.zeros((len(times), sum(sizes))), np.zeros((len(times), sum(sizes)))
    first = 0
    for k, (one, size) in enumerate(zip(ones, sizes, strict=True)):
        own = slice(first, first + size)
        flow[own, own], drive[k, own] = one.flow, one.drive
        states[:, own], jumps[:, own] = _at(one, times)
        first += size
    return Command(
        times=times, states=states, flow=flow, drive=drive,
        impulses=np.array([signal.impulse() for signal in signals]), rate=max((one.rate for one in ones), default=0.0),
        endless=any(signal.final() is None for signal in signals), turning=any(one.turning or one.waving for one in ones),
        last=max((float(one.times[-1]) for one in ones), default=0.0), jumps=jumps,
    )  # fmt: skip


def _at(one: _One, times: Real) -> tuple[Real, Real]:
    """Return the states of a command at ``times``, which have all of its corners among them, and by how much they jump there."""
    place = np.searchsorted(one.times, times, side="right") - 1
    found, jumps = np.zeros((len(times), len(one.drive))), np.zeros((len(times), len(one.drive)))
    for k, (corner, time) in enumerate(zip(place, times, strict=True)):
        if corner < 0:
            continue
        since = float(time - one.times[corner])
        found[k] = _flown(one, one.states[corner], since)
        if since == 0.0:
            before = 0.0 * found[k]
            if corner > 0:
                before = _flown(one, one.states[corner - 1], float(time - one.times[corner - 1]))
            jumps[k] = found[k] - before
    return found, jumps


def _flown(one: _One, state: Real, span: float) -> Real:
    """Return e^{S span} w."""
    if span == 0.0:
        return state
    if not one.turning:  # nilpotent: the series ends
        found, term = state.copy(), state
        for k in range(1, len(state)):
            term = one.flow @ term * (span / k)
            found = found + term
        return found
    found = np.empty_like(state)
    for k in range(0, len(state), 2):
        angle = float(one.flow[k, k + 1]) * span
        c, s = math.cos(angle), math.sin(angle)
        found[k], found[k + 1] = c * state[k] + s * state[k + 1], c * state[k + 1] - s * state[k]
    return found


def _made(signal: Signal, horizon: float) -> _One:
    copies = _copies_of_sines(signal)
    if copies is not None:
        return _turning(*copies) if 2 * len(copies[1]) <= MOST_STATES else _waving(signal, copies[1], horizon)
    degree = signal.degree()
    if degree is None and not signal.impulse():
        return _smooth(signal)
    breaks = np.array(signal.breaks(horizon), dtype=float)
    if len(breaks) > MOST_CORNERS:
        raise NotCoveredError
    return _polynomials(signal, breaks, degree or 0)


def _chain(size: int) -> tuple[Real, Real]:
    return np.eye(size, k=1), np.eye(1, size)[0]


def _fit(degree: int) -> tuple[Real, Real]:
    """Return Chebyshev's points inside [-1, 1], and the matrix from values there to the coefficients of the series."""
    points = -np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
    return points, np.linalg.inv(chebyshev.chebvander(points, degree)).astype(np.float64)


def _polynomials(signal: Signal, breaks: Real, degree: int) -> _One:
    """Return a command that is a polynomial between its breaks: its value and derivatives behind each of them."""
    widths = np.append(np.diff(breaks), max(1.0, breaks[-1]))
    points, fit = _fit(degree)
    instants = breaks[:, None] + widths[:, None] * (points + 1.0) / 2.0
    values = np.asarray(signal.value(instants), dtype=float)
    final = signal.final()
    if final is not None:
        values[-1] = final
    first = values[:, :1]
    series = (values - first) @ fit.T
    series[:, 0] += first[:, 0]
    states = np.empty_like(series)
    for k in range(degree + 1):
        states[:, k] = chebyshev.chebval(-1.0, chebyshev.chebder(series.T, k)) * (2.0 / widths) ** k
    flow, drive = _chain(degree + 1)
    return _One(times=breaks, states=states, flow=flow, drive=drive)


def _smooth(signal: Signal) -> _One:
    """Return polynomials that stand for a command which ends, as near as rounding."""
    if signal.final() is None:
        raise NotCoveredError
    breaks = list(signal.breakpoints())
    edges: list[float] = []
    waiting = list(pairwise(breaks))[::-1]
    checks = np.linspace(-1.0, 1.0, 4 * _SMOOTH)[1:-1]
    points, fit = _fit(_SMOOTH)
    between = chebyshev.chebvander(checks, _SMOOTH) @ fit
    whole = breaks[-1] - breaks[0]
    narrowest = whole
    scale = max(float(np.abs(signal.value(np.linspace(breaks[0], breaks[-1], 1000))).max()), 1e-300)
    while waiting:
        a, b = waiting.pop()
        values, wanted = (signal.value(a + (b - a) * (at + 1.0) / 2.0) for at in (points, checks))
        if np.abs(between @ values - wanted).max() > _FITS * scale:
            if b - a < _SHORTEST * whole or len(edges) > MOST_CORNERS:
                raise NotCoveredError
            waiting += [((a + b) / 2, b), (a, (a + b) / 2)]
            continue
        edges.append(a)
        narrowest = min(narrowest, b - a)
    made = _polynomials(signal, np.array([*edges, breaks[-1]]), _SMOOTH)
    return _One(times=made.times, states=made.states, flow=made.flow, drive=made.drive, rate=2.0 / narrowest)


def _waving(signal: Signal, sines: Real, horizon: float) -> _One:
    """Return polynomials that stand for more sines than there may be states, up to ``horizon``; where they begin does not depend on it."""
    fastest = float(sines[:, 1].max())
    width = _TURN / fastest
    known = signal.breakpoints()
    starts = [t for t in known if t <= horizon] or [known[0]]
    beyond = max(horizon, starts[0]) + 2 * width  # nobody looks at the last one, which has no end
    if (beyond - starts[0]) / width > MOST_CORNERS:
        raise NotCoveredError
    breaks = np.concatenate([np.arange(a, b, width) for a, b in pairwise([*starts, beyond])])
    made = _polynomials(signal, breaks, _WAVES)
    return _One(times=breaks[:-1], states=made.states[:-1], flow=made.flow, drive=made.drive, rate=fastest, waving=True)


def _copies_of_sines(signal: Signal) -> tuple[list[tuple[float, float]], Real] | None:
    """Return the copies (time, amplitude) of a sum of sines, and the sines (n, 3): amplitude, frequency, phase; None for others."""
    if isinstance(signal, Copied):
        inner = _copies_of_sines(signal.command)
        if inner is None:
            return None
        times, amplitudes = signal.copies.times.tolist(), signal.copies.amplitudes.tolist()
        own = [
            (t + time, a * amplitude) for t, a in inner[0] for time, amplitude in zip(times, amplitudes, strict=True)
        ]
        return own, inner[1]
    sines = signal.sines()
    return None if sines is None else ([(0.0, 1.0)], sines)


def _turning(copies: list[tuple[float, float]], sines: Real) -> _One:
    """Return sums of sines that begin at the times of copies."""
    amplitude, omega, phase = sines.T
    times = np.unique([time for time, _ in copies])
    states = np.zeros((len(times), 2 * len(sines)))
    for k, now in enumerate(times):
        for time, share in copies:
            if time <= now:
                angle = omega * (now - time) + phase
                states[k, 0::2] += share * amplitude * np.sin(angle)
                states[k, 1::2] += share * amplitude * np.cos(angle)
    flow = np.zeros((2 * len(sines), 2 * len(sines)))
    for k, w in enumerate(omega):
        flow[2 * k, 2 * k + 1], flow[2 * k + 1, 2 * k] = w, -w
    drive = np.tile([1.0, 0.0], len(sines))
    return _One(times=times, states=states, flow=flow, drive=drive, rate=float(omega.max()), turning=True)


__all__ = ["Command", "NotCoveredError", "commanded"]
