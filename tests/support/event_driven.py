"""An event-driven integration for tests, independent of the engine: smooth equations in each mode, modes switched by hand.

    x' = f(t, x; mode)  until the first event h(t, x; mode) becomes positive;   then mode, x := switch(event, t, x; mode)

Steps are those of scipy's DOP853 (order 8). An event is located by repeating the step that passes it with a shorter width, so that the
state there is as accurate as any other; the dense output of order 7 only brackets it and is read between the steps.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.integrate import DOP853
from scipy.optimize import brentq

Vector = npt.NDArray[np.float64]

_PROBE = 1e-11
SCAN = np.linspace(0.0, 1.0, 9)


class Automaton:
    """What is integrated: subclasses say how the state moves, what ends a mode, and what follows.

    Attributes
    ----------
    mode : any
        Replaced by ``switch``.
    breaks : sequence of float
        Instants (s) at which the inputs jump or bend; ``switch`` is called there with the event -1.
    """

    mode: Any = 0
    breaks: Sequence[float] = ()

    def rates(self, t: float, x: Vector) -> Sequence[float]:
        """Return x' in the present mode."""
        raise NotImplementedError

    def events(self, t: float, x: Vector) -> Sequence[float]:
        """Return what ends the present mode when it becomes positive."""
        return ()

    def switch(self, event: int, t: float, x: Vector) -> Vector:
        """Set the mode that follows, and return the state."""
        return x

    def outputs(self, t: float, x: Vector) -> Sequence[float]:
        """Return what is compared, by default the state."""
        return x


@dataclass
class Course:
    """What came of it: pieces of dense output with the mode in each, and the events (time, number)."""

    automaton: Automaton
    edges: list[float] = field(default_factory=lambda: [0.0])
    dense: list[Callable[[float], Vector]] = field(default_factory=list)
    modes: list[Any] = field(default_factory=list)
    happened: list[tuple[float, int]] = field(default_factory=list)

    def at(self, t: float) -> Vector:
        """Return the state at ``t``; at an edge that before it."""
        k = min(max(bisect_right(self.edges, t) - 1, 0), len(self.dense) - 1)
        if k and t == self.edges[k]:
            k -= 1
        return self.dense[k](t)

    def outputs(self, times: Sequence[float]) -> Vector:
        """Return the outputs at some instants, (len(times), outputs), each in the mode of its time."""
        found = []
        for t in times:
            k = min(max(bisect_right(self.edges, t) - 1, 0), len(self.dense) - 1)
            self.automaton.mode = self.modes[k]
            found.append(self.automaton.outputs(t, self.dense[k](t)))
        return np.array(found)


def follow(
    automaton: Automaton,
    start: Sequence[float],
    end: float,
    *,
    tolerance: float = 1e-13,
    scale: Sequence[float] | None = None,
    longest: float = np.inf,
    most: int = 4000,
) -> Course:
    """Return the course from ``start`` at t = 0 to ``end`` (s).

    Parameters
    ----------
    automaton : Automaton
        In its first mode.
    start : sequence of float
    end : float
    tolerance : float
        Error of a step relative to the state, and to its ``scale`` where it is smaller.
    scale : sequence of float, optional
        Sizes of the states; 1 by default.
    longest : float
        No step is longer, s.
    most : int
        More events than this are an error.
    """
    course, t, x = Course(automaton=automaton), 0.0, np.array(start, dtype=float)
    floor = tolerance * np.ones_like(x) * (1.0 if scale is None else np.asarray(scale))
    stops = [*sorted(b for b in automaton.breaks if 0 < b < end), end]
    x = automaton.switch(-1, t, x)
    for stop in stops:
        solver = None
        while t < stop:
            x = _settled(automaton, t, x, course, most, probe=_PROBE * end)
            if solver is None:
                solver = DOP853(automaton.rates, t, x, stop, rtol=max(tolerance, 3e-14), atol=floor, max_step=longest)
            known = solver.t, solver.y.copy(), solver.f.copy()
            message = solver.step()
            assert solver.status != "failed", message
            dense = solver.dense_output()
            found = _first(automaton, known, solver, dense)
            mode = automaton.mode
            if found is None:
                t, x = solver.t, solver.y.copy()
                _note(course, t, dense, mode)
                continue
            t, event, x = found
            if t > course.edges[-1]:
                _note(course, t, dense, mode)
            course.happened.append((t, event))
            x, solver = automaton.switch(event, t, x), None
        if stop < end:
            x = automaton.switch(-1, t, x)
    return course


def _note(course: Course, t: float, dense: Callable[[float], Vector], mode: Any) -> None:
    course.edges.append(t)
    course.dense.append(dense)
    course.modes.append(mode)


def _settled(automaton: Automaton, t: float, x: Vector, course: Course, most: int, *, probe: float) -> Vector:
    """Let modes that end at once end; what is positive by rounding alone is not so any more after a ``probe`` (s)."""
    for _ in range(50):
        positive = [k for k, h in enumerate(automaton.events(t, x)) if h > 0]
        if positive:
            later = automaton.events(t + probe, _step(automaton, (t, x, np.asarray(automaton.rates(t, x))), probe))
            positive = [k for k in positive if later[k] > 0]
        if not positive:
            return x
        course.happened.append((t, positive[0]))
        assert len(course.happened) < most, f"more than {most} events"
        x = automaton.switch(positive[0], t, x)
    msg = f"modes do not settle at {t}: {automaton.mode}"
    raise AssertionError(msg)


def _first(
    automaton: Automaton, known: tuple[float, Vector, Vector], solver: DOP853, dense: Callable[[float], Vector]
) -> tuple[float, int, Vector] | None:
    """Return the time and number of the first event of a step, and the state there."""
    t0, width = known[0], solver.t - known[0]
    rows = np.array(
        [
            automaton.events(t0 + s * width, dense(t0 + s * width) if 0 < s < 1 else (known[1] if s == 0 else solver.y))
            for s in SCAN
        ]
    )
    if not rows.size or not (rows[1:] > 0).any():
        return None
    place = 1 + int(np.argmax((rows[1:] > 0).any(axis=1)))

    def exact(s: float) -> Vector:
        return _step(automaton, known, s * width)

    best: tuple[float, int] | None = None
    for event in np.flatnonzero(rows[place] > 0):
        low, high = float(SCAN[place - 1]), float(SCAN[place])

        def value(s: float, event: int = int(event)) -> float:
            return float(automaton.events(t0 + s * width, exact(s) if s > 0 else known[1])[event])

        if value(low) >= 0:
            s = low
        elif value(high) <= 0:
            s = high
        else:
            s = float(brentq(value, low, high, xtol=1e-15, rtol=8.9e-16))
        if best is None or s < best[0]:
            best = s, int(event)
    assert best is not None
    return t0 + best[0] * width, best[1], exact(best[0]) if best[0] > 0 else known[1]


def _step(automaton: Automaton, known: tuple[float, Vector, Vector], width: float) -> Vector:
    """Return one step of DOP853 of a given width."""
    t, x, f = known
    stages = np.empty((DOP853.n_stages, len(x)))
    stages[0] = f
    for k, (row, c) in enumerate(zip(DOP853.A[1:], DOP853.C[1:], strict=True), start=1):
        stages[k] = automaton.rates(t + c * width, x + width * (row[:k] @ stages[:k]))
    return np.asarray(x + width * (DOP853.B @ stages))
