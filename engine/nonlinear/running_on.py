"""How long what moves evenly under constant commands will go on so.

    f(x + τ f(x)) = f(x)   until which τ?

A motor whose angle nothing looks at turns for ever. A drive at its limit, on its way to a target, moves just as evenly; but further on its rates
are others, because its controller sees the target, or a law has changed its mode.
"""

from __future__ import annotations

import contextlib
from enum import Enum
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.errors import EngineError
from engine.failures import numerical
from engine.nonlinear.operating_point import modes_at, rates_at

if TYPE_CHECKING:
    from engine.elements._nonlinear import Mode
    from engine.nonlinear.system import NonlinearSystem

Real = npt.NDArray[np.float64]

_AHEAD: Final = tuple(10.0**k for k in range(-3, 5))
"""The state is looked at so many times the time simulated ahead."""
_ROUNDING: Final = 1e-9
_SAME: Final = 1e-5
"""Rates whose difference moves no state by more than this part of it, in the time simulated, are the same; far ahead, where what is
rounded here has grown, by so much more."""


class Motion(Enum):
    """How a state moves."""

    FOR_EVER = "at the same rates for ever"
    FOR_A_WHILE = "at the same rates until something changes"
    UNEVENLY = "at rates that change"


def motion(
    system: NonlinearSystem, constants: Real, state: npt.NDArray[Any], modes: tuple[Mode, ...], elapsed: float
) -> Motion:
    """Return how a response will go on.

    Parameters
    ----------
    system : NonlinearSystem
    constants : ndarray, shape (inputs,)
        The final commands.
    state : ndarray, shape (lanes, n)
        Where the response has come to,
    modes : tuple of int
        with these modes of the laws.
    elapsed : float
        How long it took, s.
    """
    real, resting = (
        system.value,
        system.resting.value,
    )  # the rates of the second tell also what the next samples will do
    x = state[0].real
    with contextlib.suppress(EngineError), np.errstate(all="ignore"), numerical("the motion"):
        direction = elapsed * rates_at(real, x, constants, modes)
        direction[np.abs(direction) <= _ROUNDING * np.abs(x)] = 0.0
        now = elapsed * rates_at(resting, x, constants, modes)
        allowed = _SAME * np.maximum(np.abs(now), np.abs(x))
        for part in _AHEAD:
            further = x + part * direction
            found = modes_at(real, further, constants, modes)
            later = elapsed * rates_at(resting, further, constants, found)
            if not np.all(np.abs(later - now) <= allowed * max(1.0, part)):
                # what has no law to change decays, or grows, where a straight line does not follow it
                sampled = any(law.element.period(law.values) is not None for law in real.laws)
                return Motion.FOR_A_WHILE if sampled or found != modes else Motion.UNEVENLY
        return Motion.FOR_EVER
    return Motion.UNEVENLY
