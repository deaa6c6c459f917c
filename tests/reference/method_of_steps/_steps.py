"""Responses of nonlinear loops with delays, by the method of steps: an integration written for the tests alone.

Blocks are plain Python functions of numbers. Between two changes everything is smooth: there DOP853 integrates, and what
enters a delay is kept as polynomials. A change (a guard that becomes positive, a jump of the command) comes back through
every delay; the integration stops at each of these instants and starts anew.

References
----------
A. Bellen, M. Zennaro, "Numerical Methods for Delay Differential Equations", Oxford 2003, chapters 3 and 6.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.polynomial import chebyshev
from scipy.integrate import DOP853
from scipy.optimize import brentq

COUNT = 14
"""Points of a step at which its signals are kept; its polynomial is of degree 7."""
POINTS = (1 - np.cos(np.pi * np.arange(COUNT) / (COUNT - 1))) / 2
_SIGNS = np.array([(-1.0) ** k * (0.5 if k in {0, COUNT - 1} else 1.0) for k in range(COUNT)])
_TO_COEFFICIENTS = np.linalg.inv(chebyshev.chebvander(2 * POINTS - 1, COUNT - 1))
_SAME = 1e-12
_ECHOES = 9
"""After so many delays with an integration each, a jump is smoother than the method can see."""
_MOST_CHANGES = 50


class Block:
    """One block: ``inputs`` and ``outputs`` are names of signals, ``start`` the states at t = 0.

    ``direct`` says whether the outputs follow the inputs at once; ``z`` is None for one that is not, when it is asked.
    """

    direct = True
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    start: tuple[float, ...] = ()
    mode = 0

    def read(self, t: float, x: Sequence[float], z: Sequence[float]) -> Sequence[float]:
        """Return the outputs."""
        raise NotImplementedError

    def rates(self, t: float, x: Sequence[float], z: Sequence[float]) -> Sequence[float]:
        """Return the rates of the states."""
        return ()

    def guards(self, t: float, x: Sequence[float], z: Sequence[float]) -> Sequence[float]:
        """Return what ends the present mode as soon as it is positive."""
        return ()

    def change(self, guard: int, t: float, x: Sequence[float], z: Sequence[float]) -> Sequence[float] | None:
        """Go into the next mode; return new states where they jump."""
        raise NotImplementedError


@dataclass
class Delay:
    """``output``(t) = ``signal``(t - ``time``), 0 before t = ``time``."""

    signal: str
    output: str
    time: float


@dataclass
class Response:
    """What was found: pieces [``starts``, ``ends``] with the signals at `POINTS`, and the instants of changes of mode."""

    starts: list[float] = field(default_factory=list)
    ends: list[float] = field(default_factory=list)
    values: list[dict[str, np.ndarray]] = field(default_factory=list)
    events: list[float] = field(default_factory=list)

    def at(self, times: Sequence[float], name: str) -> np.ndarray:
        """Return a signal at some instants, its limit from the right."""
        return np.array([self.one(float(t), name, later=True) for t in times])

    def one(self, t: float, name: str, *, later: bool) -> float:
        """Return a signal at ``t``; at an edge that of the piece after it where ``later``, of the one before it else."""
        grain = _SAME * max(1.0, abs(self.ends[-1]))
        k = bisect.bisect_right(self.starts, t + (grain if later else -grain)) - 1
        if k < 0:
            return 0.0
        k = min(k, len(self.starts) - 1)
        theta = min(max((t - self.starts[k]) / (self.ends[k] - self.starts[k]), 0.0), 1.0)
        gap = theta - POINTS
        place = int(np.argmin(np.abs(gap)))
        if abs(gap[place]) < 1e-15:
            return float(self.values[k][name][place])
        weight = _SIGNS / gap
        return float(weight @ self.values[k][name] / weight.sum())

    def integral(self, of: Callable[[np.ndarray, np.ndarray], np.ndarray], name: str) -> float:
        """Return the integral of a smooth function of time and signal."""
        x, w = np.polynomial.legendre.leggauss(20)
        to_points = chebyshev.chebvander(x, COUNT - 1) @ _TO_COEFFICIENTS
        total = 0.0
        for start, end, values in zip(self.starts, self.ends, self.values, strict=True):
            t = start + (end - start) * (x + 1) / 2
            total += 0.5 * (end - start) * float(w @ of(t, to_points @ values[name]))
        return total

    def peak(self, name: str) -> float:
        """Return the largest size of a signal."""
        fine = chebyshev.chebvander(np.linspace(-1, 1, 57), COUNT - 1) @ _TO_COEFFICIENTS
        tops = np.array([np.abs(fine @ values[name]).max() for values in self.values])
        best = -math.inf
        for k in np.flatnonzero(tops >= tops.max() - 1e-3 * (np.ptp(tops) + 1e-300)):
            c = _TO_COEFFICIENTS @ self.values[k][name]
            roots = chebyshev.chebroots(np.trim_zeros(chebyshev.chebder(c), "b")) if np.any(c[1:]) else np.zeros(0)
            inside = [float(r.real) for r in np.atleast_1d(roots) if abs(r.imag) < 1e-8 and -1 <= r.real <= 1]
            best = max(best, *(abs(float(chebyshev.chebval(r, c))) for r in (*inside, -1.0, 1.0)))
        return best


class Loop:
    """Blocks and delays; ``commands`` are functions of time, ``stops`` the instants at which these jump or bend.

    ``echoes`` says how often a change may come back before it is too smooth to be seen.
    """

    def __init__(
        self,
        blocks: Sequence[Block],
        delays: Sequence[Delay] = (),
        *,
        commands: Mapping[str, Callable[[float], float]],
        stops: Sequence[float] = (),
        echoes: int = _ECHOES,
        tolerance: float = 1e-13,
    ) -> None:
        self.delays, self.commands, self.echoes, self.tolerance = list(delays), dict(commands), echoes, tolerance
        self.blocks = self._ordered(blocks)
        counts = np.cumsum([0, *(len(b.start) for b in self.blocks)])
        self.slices = [slice(int(a), int(b)) for a, b in pairwise(counts)]
        self.x = np.array([v for b in self.blocks for v in b.start], dtype=float)
        self.size = np.abs(self.x)
        self.found = Response()
        self._ahead: list[tuple[float, int]] = sorted((t, 0) for t in {0.0, *stops})
        self._middle = 0.0

    def _ordered(self, blocks: Sequence[Block]) -> list[Block]:
        """Return the blocks in an order in which the inputs of the direct ones are known."""
        done = [b for b in blocks if not b.direct]
        known = {*self.commands, *(d.output for d in self.delays), *(o for b in done for o in b.outputs)}
        rest = [b for b in blocks if b.direct]
        while rest:
            ready = [b for b in rest if known.issuperset(b.inputs)]
            if not ready:
                msg = f"an algebraic loop through {[b.outputs for b in rest]}"
                raise ValueError(msg)
            done += ready
            known.update(o for b in ready for o in b.outputs)
            rest = [b for b in rest if b not in ready]
        return done

    def signals(self, t: float, x: np.ndarray) -> dict[str, float]:
        """Return all signals; at an edge of the past what lies towards the middle of the present stretch counts."""
        s = {name: f(t) for name, f in self.commands.items()}
        for d in self.delays:
            s[d.output] = self.found.one(t - d.time, d.signal, later=t < self._middle) if self.found.starts else 0.0
        for b, part in zip(self.blocks, self.slices, strict=True):
            z = [s[name] for name in b.inputs] if b.direct else ()
            s.update(zip(b.outputs, b.read(t, x[part], z), strict=True))
        return s

    def _rates(self, t: float, x: np.ndarray) -> np.ndarray:
        s = self.signals(t, x)
        f = np.empty_like(x)
        for b, part in zip(self.blocks, self.slices, strict=True):
            if b.start:
                f[part] = b.rates(t, x[part], [s[name] for name in b.inputs])
        return f

    def _guards(self, t: float, x: np.ndarray) -> tuple[np.ndarray, dict[str, float]]:
        s = self.signals(t, x)
        values = [
            g
            for b, part in zip(self.blocks, self.slices, strict=True)
            for g in b.guards(t, x[part], [s[name] for name in b.inputs])
        ]
        return np.array(values), s

    def _owner(self, number: int, t: float, x: np.ndarray) -> tuple[Block, slice, int, list[float]]:
        s = self.signals(t, x)
        for b, part in zip(self.blocks, self.slices, strict=True):
            z = [s[name] for name in b.inputs]
            own = len(b.guards(t, x[part], z))
            if number < own:
                return b, part, number, z
            number -= own
        raise IndexError(number)

    def _change(self, number: int, t: float) -> None:
        block, part, guard, z = self._owner(number, t, self.x)
        states = block.change(guard, t, self.x[part], z)
        if states is not None:
            self.x[part] = states

    def _settle(self, t: float) -> bool:
        """Let the blocks change their modes until all agree; return whether any did."""
        for count in range(_MOST_CHANGES):
            values, s = self._guards(t, self.x)
            large = 1e-11 * max(1e-3, *(abs(v) for v in s.values()))
            positive = np.flatnonzero(values > large)
            if not len(positive):
                return count > 0
            self._change(int(positive[0]), t)
        msg = f"the blocks do not agree at t = {t}"
        raise ArithmeticError(msg)

    def _note(self, t: float, generation: int) -> None:
        if generation < self.echoes:
            for d in self.delays:
                bisect.insort(self._ahead, (t + d.time, generation + 1))

    def run(self, end: float) -> Response:
        """Return the response up to ``end``, s."""
        t = 0.0
        grain = _SAME * max(1.0, end)
        while True:
            due = [g for s, g in self._ahead if s <= t + grain]
            self._ahead = self._ahead[len(due) :]
            if t >= end - grain:
                return self.found
            self._middle = math.inf  # just after this instant
            if due:
                changed = self._settle(t)
                if changed:
                    self.found.events.append(t)
                self._note(t, 0 if changed else min(due))
            target = min(end, self._ahead[0][0]) if self._ahead else end
            self._middle = 0.5 * (t + target)
            t = self._stretch(t, target)

    def _stretch(self, t: float, target: float) -> float:
        """Integrate to ``target``, or to the first change before it, which is then made."""
        self.size = np.maximum(self.size, np.abs(self.x))
        shortest = min((d.time for d in self.delays), default=math.inf)
        if not len(self.x):
            self.x = np.zeros(0)
        solver = DOP853(
            self._rates, t, self.x, target, rtol=self.tolerance, atol=self.tolerance * np.maximum(self.size, 1e-9),
            max_step=min(shortest, target - t),
        )  # fmt: skip
        while solver.status == "running":
            message = solver.step()
            if message:
                raise ArithmeticError(message)
            now = self._step(solver.t_old, solver.t, solver.dense_output())
            if now < solver.t or (now == solver.t and self._fired):
                self.found.events.append(now)
                self._note(now, 0)
                return now
            self.x = np.array(solver.y)
            self.size = np.maximum(self.size, np.abs(self.x))
        return target

    _fired = False

    def _step(self, start: float, end: float, path: Callable[[float], np.ndarray]) -> float:
        """Keep a step up to its first change, and make that; return where it ends."""
        times = start + (end - start) * POINTS
        rows = [self._guards(float(t), path(t)) for t in times]
        values = np.array([row[0] for row in rows]).reshape(COUNT, -1)
        self._fired, first, number = False, end, -1
        for k in np.flatnonzero((values[1:] > 0).any(axis=0)):
            j = 1 + int(np.argmax(values[1:, k] > 0))
            if values[j - 1, k] >= 0:
                root = float(times[j - 1])
            else:
                root = float(
                    brentq(
                        lambda t, k=k: self._guards(t, path(t))[0][k], times[j - 1], times[j], xtol=1e-16, rtol=1e-15
                    )
                )
            if number < 0 or root < first:
                first, number = root, int(k)
        if number >= 0 and first > start:
            times = start + (first - start) * POINTS
            rows = [self._guards(float(t), path(t)) for t in times]
        if first > start:
            self.found.starts.append(start)
            self.found.ends.append(first)
            self.found.values.append({name: np.array([row[1][name] for row in rows]) for name in rows[0][1]})
        if number >= 0:
            self._fired = True
            self.x = np.array(path(first))
            self._change(number, first)
            self._middle = math.inf
            self._settle(first)
        return first
