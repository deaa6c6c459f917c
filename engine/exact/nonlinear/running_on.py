"""How a response goes on under constant commands, told from the state at its end.

    x(τ) = x + ∫ e^(A s) ds f(x),   A = ∂f/∂x in the present modes

is what the states will do as long as no law changes: exact where all laws are straight, and near to it wherever little moves. Looked at
far ahead, it tells what has stopped, or moves evenly, for ever from what does so for a while: an integrator that winds up behind a limit
will come back, a mass that sticks will break away, a drive at its limit will arrive.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm, matrix_balance

from engine.exact.nonlinear.operating_point import modes_at, outputs_at, rates_at, slope_at
from engine.model.errors import EngineError
from engine.model.failures import numerical

if TYPE_CHECKING:
    from collections.abc import Iterator

    from engine.elements._nonlinear import Mode
    from engine.exact.laws.system import NonlinearSystem
    from engine.exact.nonlinear.operating_point import OperatingPoint

Real = npt.NDArray[np.float64]

_FIRST: Final = 1e-3
"""The state is looked at this part of the time simulated ahead, and at each double of it,"""
_LOOKS: Final = 24
"""so many times: up to 8,000 times as long as was simulated."""
_ROUNDING: Final = 1e-9
_SAME: Final = 1e-5
"""Rates whose difference moves no state by more than this part of it, in the time simulated, are the same; far ahead, where what is
rounded here has grown, by so much more."""
_LARGEST: Final = 1e60
"""What has grown so far without a change of any law has nothing to do with what stands still."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecast:
    """What will be: times ahead (K,), s, and the outputs then (K, outputs), now included as the first."""

    ahead: Real
    outputs: Real


def forecast(
    system: NonlinearSystem, constants: Real, state: npt.NDArray[Any], modes: tuple[Mode, ...], elapsed: float
) -> Forecast | None:
    """Return how a response goes on for ever, None where some law will change.

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
    real, x = system.value, state[0].real
    ahead, outputs = [0.0], []
    with contextlib.suppress(EngineError), np.errstate(all="ignore"), numerical("the motion to come"):
        outputs.append(outputs_at(real, x, constants, modes))
        rate = _rates(system, x, constants, modes)
        rate[elapsed * np.abs(rate) <= _ROUNDING * np.abs(x)] = 0.0
        for part, way, later in _flow(_slope(system, x, constants, modes), rate, elapsed):
            further = x + way
            if not np.abs(further).max(initial=0.0) < _LARGEST:
                break
            found = modes_at(real, further, constants, modes)
            away = elapsed * np.abs(_rates(system, further, constants, found) - later)
            allowed = _SAME * np.maximum(elapsed * np.maximum(np.abs(rate), np.abs(later)), np.abs(further))
            if found != modes or not np.all(away <= allowed * max(1.0, part)):
                return None
            ahead.append(part * elapsed)
            outputs.append(outputs_at(real, further, constants, modes))
        return Forecast(ahead=np.array(ahead), outputs=np.array(outputs))
    return None


def reach(system: NonlinearSystem, point: OperatingPoint, state: npt.NDArray[Any], elapsed: float) -> Real | None:
    """Return how far each output (outputs,) gets from a state of rest on the way there, as a linear system; None where that is not known.

    What the state of a wound-up integrator is worth shows here, and whether the rest is one that is approached at all.
    """
    real, x = system.value, point.x[0].real
    with contextlib.suppress(EngineError), np.errstate(all="ignore"), numerical("the way to rest"):
        slope = _slope(system, x, point.inputs, point.modes)
        if _jumps(system) and np.any(np.linalg.eigvals(slope).real > 0):
            return None  # delays and samples may stabilise what would be unstable without them
        away = state[0].real - x
        found = np.zeros(len(real.outputs))
        # (e^(Aτ) - 1) d = ∫ e^(As) ds A d
        for part, way, _ in _flow(slope, slope @ away, elapsed):
            if part > 1.0 / _FIRST:
                break
            there = outputs_at(real, x + away + way, point.inputs, point.modes)
            found = np.maximum(found, np.abs(there - point.y[0].real))
        return found if np.isfinite(found).all() else None
    return None


def _flow(slope: Real, rate: Real, elapsed: float) -> Iterator[tuple[float, Real, Real]]:
    """Yield (part of ``elapsed``, way gone by then (n,), rates then (n,)) of x'' = A x', ever further ahead."""
    n = len(rate)
    scale = np.ones(n)
    if n:
        with np.errstate(invalid="ignore"):
            balanced, transform = matrix_balance(slope, permute=False)
        slope, scale = np.asarray(balanced), np.asarray(np.diag(transform))
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n] = slope, rate / scale
    step, part = expm(whole * (_FIRST * elapsed)), _FIRST
    with np.errstate(all="ignore"):
        for _ in range(_LOOKS):
            yield part, step[:n, n] * scale, (step[:n, :n] @ whole[:n, n]) * scale
            step, part = step @ step, 2 * part


def _jumps(system: NonlinearSystem) -> bool:
    """Return whether delays or samples make the states no solution of a differential equation."""
    return bool(system.delays.shape[-1]) or any(law.element.period(law.values) is not None for law in system.laws)


def _periods(system: NonlinearSystem) -> Real:
    """Return the time in which a state moves by its rate, (n,): a state that moves at samples does so once in a period."""
    found = np.ones(system.states)
    for law in system.value.laws:
        period = law.element.period(law.real)
        if period is not None:
            found[law.states] = float(np.ravel(np.asarray(period))[0].real)
    return found


def _rates(system: NonlinearSystem, x: Real, constants: Real, modes: tuple[Mode, ...]) -> Real:
    return np.asarray(rates_at(system.resting.value, x, constants, modes) / _periods(system))


def _slope(system: NonlinearSystem, x: Real, constants: Real, modes: tuple[Mode, ...]) -> Real:
    return np.asarray(slope_at(system.resting.value, x, constants, modes) / _periods(system)[:, None])
