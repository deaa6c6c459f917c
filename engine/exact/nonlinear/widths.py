"""How long the steps of a nonlinear response are: as accuracy allows, and short enough to tell the times of events."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.exact.nonlinear.guards import Crossing
from engine.exact.time.chebyshev import tail
from engine.model.errors import EngineError
from engine.model.failures import numerical

if TYPE_CHECKING:
    from engine.exact.laws.straight import Straight
    from engine.exact.laws.system import NonlinearSystem
    from engine.exact.nonlinear.bounds import Bounds
    from engine.exact.nonlinear.driving import Driving
    from engine.exact.nonlinear.steps import Step, Stepper
    from engine.exact.nonlinear.switching import Switchboard

Array = npt.NDArray[Any]

EARLY: Final = 1e-3
"""An event within this part of its step comes early in it."""

_PATIENCE: Final = 8
"""How many steps follow a refusal before a doubled one is tried, and how often a step is cut short for the time of one event."""
_ALMOST_NOTHING: Final = 1e-3
"""What a step must miss of the tolerance to be doubled."""
_LITTLE, _LONG = 0.1, 12  # what rounding may be all of: then a doubled step is tried after so many of one width
_RESOLVED: Final = 2e-14
"""The shortest step that is looked for, in parts of the time simulated."""
_PUNCTUAL, _ROUNDED = 1e-12, 1e-14
"""By how much the polynomial of a guard may move an event, in parts of the time simulated; what it misses by rounding alone."""


class Widths:
    """Solve the steps of one response, each as wide as it can be.

    Attributes
    ----------
    next : float
        About how long the next step may be, s; infinite before the first.
    horizon : float
        How long the response is followed, s.
    """

    def __init__(
        self, system: NonlinearSystem, board: Switchboard, stepper: Stepper, driving: Driving, bounds: Bounds
    ) -> None:
        self._system, self._board, self._stepper, self._driving, self._bounds = system, board, stepper, driving, bounds
        self.next, self.horizon = math.inf, 0.0
        self._first_scale = np.zeros(system.states)
        self._refused = self._vague = 0
        self._sought: tuple[float, Step, Crossing] | None = (
            None  # an early event, the step that has it, and the instant when that began
        )

    @property
    def _now(self) -> float:
        return float(self._board.t[0].real)

    def within(self, gap: float) -> float:
        """Return how long the next step shall be, ``gap`` (s) at most: none of it is left over for a short one."""
        width = min(self.next, gap)
        if not math.isfinite(self.next):
            width = min(width, self._first())
        if 0.5 * gap < width < gap:
            return 0.5 * gap if width < 0.99 * gap else gap
        return width

    def solved(self, width: float, gap: float) -> tuple[Step, float, Crossing | None]:
        """Return an accurate step, its width (about ``width``, beyond ``gap`` where that is as good), and None; or an event that happens at once.

        That is an early event of which no step that is short enough can be accurate: what it begins with is below rounding.
        """
        straight, cause = self._straight(), ""
        longest = self.next
        if not self._first_scale.any():
            self._first_scale = self._stepper.scale
        while True:
            now = self._now
            if width < 1e-14 * max(self.horizon, now):
                if self._sought is not None and self._sought[0] == now:
                    _, whole, event = self._sought
                    self._sought, self._vague, self.next = None, 0, whole.width
                    self._stepper.forget()
                    return whole, whole.width, Crossing(index=event.index, theta=0.0)
                self._bounds.stuck(now, self._board.x[0].real, self._first_scale, cause or self._without_value())
            self._bounds.step(now)
            step: Step | None = None
            if straight is not None:
                width = _binary(width, longest)
            try:
                with numerical("a step"):
                    step = self._attempt(width, gap, straight)
                cause = f"{step.singular} leaps or goes to infinity" if step is not None and step.singular else ""
            except EngineError as error:  # where a shorter one may stay away from
                cause = error.message
            if step is not None and step.miss <= 1.0:
                self._grow(step, width, gap)
                return step, width, None
            width *= 0.25 if step is None else min(0.7, max(0.2, 0.8 * step.miss ** (-1 / self._stepper.order)))
            longest = width
            self._refused = _PATIENCE
            self._stepper.forget()

    def placed(self, step: Step, event: Crossing) -> Crossing | None:
        """Return an event of a step; None where a shorter one has to follow.

        That is where the step went so far beyond that its rounding is seen there, and where its polynomials do not tell the time of the
        event. An event that comes sooner than steps can be short happens at once.
        """
        if self._vague < _PATIENCE and not self._punctual(step, event):
            self._vague += 1
            self.next = step.width * min(0.5, 1.5 * max(event.theta, EARLY))
            self._stepper.forget()
            return None
        if event.theta > EARLY or not self._stepper.blown(step, event.theta):
            self._vague = 0
            return event
        width = 1.5 * event.theta * step.width
        if width <= _RESOLVED * max(self.horizon, self._now):
            self._vague = 0
            return Crossing(index=event.index, theta=0.0)
        self.next, self._sought = width, (self._now, step, event)
        self._stepper.forget()
        return None

    def _punctual(self, step: Step, event: Crossing) -> bool:
        """Return whether what the polynomial of a guard misses moves the event by no more than its time may be wrong."""
        values = step.guards[event.index][2]
        missed = float(tail(values))
        if missed <= _ROUNDED * float(np.abs(values).max()):
            return True
        return missed <= _PUNCTUAL * max(self.horizon, self._now) * abs(step.slope_of(event.index, event.theta))

    def _grow(self, step: Step, width: float, gap: float) -> None:
        """Say how long the next step may be."""
        grown = width * self._growth(step)
        # a step cut short by a stop says nothing about those after it, unless it was hard all the same
        keeps = width >= gap and grown > width and self.next < math.inf
        self.next = max(self.next, grown) if keeps else grown

    def _growth(self, step: Step) -> float:
        """Return by how much the next step may be longer."""
        if step.straight is None:
            return min(4.0, max(0.3, float(0.85 * max(step.miss, 1e-12) ** (-1 / self._stepper.order))))
        # widths are powers of two, and what is missed may be no more than rounding: try, but not after each refusal
        self._refused -= 1
        if (step.miss <= _ALMOST_NOTHING and self._refused < 0) or (step.miss <= _LITTLE and self._refused < -_LONG):
            self._refused = 0
            return 2.0
        return 1.0

    def _without_value(self) -> str:
        """Name the law that gives no number here, though it is given some."""
        flow = self._system.value.flow(self._board.instant().real)
        for law in self._system.value.laws:
            given, found = flow.e[..., law.inputs], (flow.v[..., law.outputs], flow.f[..., law.states])
            if np.isfinite(given).all() and not all(np.isfinite(part).all() for part in found):
                return f"{law.label} has no value (a root or logarithm of a negative number, or a division by 0)"
        return ""

    def _attempt(self, width: float, gap: float, straight: Straight | None) -> Step | None:
        start, modes, now = self._board.x[0].real, self._board.modes, self._now
        if straight is None:
            return self._stepper.attempt(start, self._driving.command(now, width), modes)
        return self._stepper.leap(start, self._driving.command(now, gap).extended(width), modes, straight)

    def _straight(self) -> Straight | None:
        """Return the system as linear maps where it is one now, and nothing but straight lines drives it."""
        if not self._driving.straight or self._system.delays.shape[-1] or not self._system.states:
            return None
        found = self._system.value.straight(self._board.modes)
        return found if found is not None and found.map.solved else None

    def _first(self) -> float:
        """Return a first step from the fastest mode at this instant."""
        if not self._system.states:
            return math.inf
        slope = self._system.tangent(self._board.instant().real).fx[0]
        fastest = float(np.abs(np.linalg.eigvals(slope)).max()) if np.isfinite(slope).all() else 0.0
        return 4.0 / fastest if fastest > 0 else math.inf


def _binary(width: float, limit: float) -> float:
    """Return the next larger power of two, or the one below where that is beyond ``limit``: few widths, met again."""
    above = 2.0 ** math.ceil(math.log2(width))
    return above if above <= limit else 0.5 * above
