"""Where a nonlinear system rests: the state at which nothing moves, found from the initial state.

f(x, u = 0; modes) = 0,   dx/dp = -(∂f/∂x)⁺ ∂f/∂p
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import matrix_balance

from engine.elements._nonlinear import Mode
from engine.exact.laws.magnitudes import magnitudes
from engine.exact.laws.system import Instants
from engine.exact.nonlinear.integrate import Integration
from engine.exact.nonlinear.switching import ROUNDING, StoppedError
from engine.model.errors import EngineError
from engine.model.failures import numerical

if TYPE_CHECKING:
    from engine.exact.laws.system import NonlinearSystem

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]

_ITERATIONS = 40
_STILL = 1e-9
"""A state rests when Newton's correction is this part of it."""
_SINGULAR = 1e-10


@dataclass(frozen=True, kw_only=True, eq=False)
class OperatingPoint:
    """A state ``x`` (lanes, n) with its delayed signals ``w``, modes, channels and outputs.

    ``rests`` is False where none was found, ``single`` where there are others beside it.
    """

    x: Array
    w: Array
    modes: tuple[Mode, ...]
    inputs: Array
    e: Array
    v: Array
    y: Array
    rests: bool
    single: bool = False


def operating_point(
    system: NonlinearSystem,
    constants: Mapping[str, float] | None = None,
    *,
    start: Array | None = None,
    modes: tuple[Mode, ...] | None = None,
) -> OperatingPoint:
    """Return the state of rest that Newton's method finds from the initial state.

    Parameters
    ----------
    system : NonlinearSystem
    constants : mapping of input name to float, optional
        Constant inputs; 0 where left out.
    start : ndarray, shape (lanes, n), optional
        Where to begin, in place of the initial state.
    modes : tuple of int, optional
        Modes to begin with, those of a response that has come to ``start``; else the laws choose.

    Notes
    -----
    Directions in which the state may lie anywhere (a position that nothing holds) stay where they are. Where no rest
    is found, the initial state itself is returned, ``rests`` being False.
    """
    system = system.resting
    real = system.value
    inputs = np.array([float((constants or {}).get(name, 0.0)) for name in system.inputs])
    origin = system.start if start is None else start
    begin = origin[0].real
    x = begin
    modes = first = modes_at(real, begin, inputs) if modes is None else modes
    rests = False
    with contextlib.suppress(EngineError), np.errstate(all="ignore"), numerical("the state of rest"):
        for _ in range(_ITERATIONS):
            step = _correction(real, x, inputs, modes)
            if step is None:
                break
            least = _STILL * np.maximum(np.abs(x), 1e-6)
            if np.all(np.abs(step) <= least) or np.all(
                np.abs(step) <= np.maximum(least, _noise(real, x, inputs, modes))
            ):
                x, rests = x + step, True
                break
            x = x + step
            modes = modes_at(real, x, inputs, modes)
    if not rests:
        x, modes = begin, first
    return _complete(system, origin, x, inputs, modes=modes, rests=rests)


def modes_at(real: NonlinearSystem, x: Real, inputs: Real, before: tuple[Mode, ...] | None = None) -> tuple[Mode, ...]:
    """Return the modes that fit a state (n,) that has been so for ever, coming from the modes ``before``."""
    modes = before
    for _ in range(_ITERATIONS if real.delays.shape[-1] else 1):
        past = None
        # else as if nothing had gone into the delays
        with contextlib.suppress(EngineError), np.errstate(all="ignore"), numerical("what lies in the delays"):
            past = None if modes is None else _still(real, x[None], inputs, modes).w[:, 0]
        run = Integration(real, {}, constants=inputs, state=x[None], modes=before, past=past)
        try:
            found = run.rest()
        except StoppedError:
            return before or tuple(0 for _ in real.laws)
        if found == modes:
            break
        modes = found
    return modes or ()


def _still(system: NonlinearSystem, x: Array, inputs: Real, modes: tuple[Mode, ...]) -> Instants:
    """Return the instant of a system at the states ``x`` (lanes, n) whose signals have not moved for ever: w = z."""
    lanes, m = len(x), system.delays.shape[-1]
    u = np.broadcast_to(inputs, (lanes, 1, len(inputs)))
    at = Instants(
        t=np.zeros((lanes, 1)), x=x[:, None], u=u, du=np.zeros_like(u), w=np.zeros((lanes, 1, m), dtype=x.dtype),
        modes=modes,
    )  # fmt: skip
    slope = np.eye(m) - system.value.matrices["d22"][0]
    for _ in range(_ITERATIONS if m else 0):
        _, z = system.read(at, system.flow(at).v)
        step = np.linalg.solve(slope[None], (z - at.w)[..., None])[..., 0]
        if np.abs(step).max() <= 1e-14 * max(float(np.abs(at.w).max()), 1e-300):
            break
        at = replace(at, w=at.w + step)
    return at


def rates_at(real: NonlinearSystem, x: Real, inputs: Real, modes: tuple[Mode, ...]) -> Real:
    """Return the rates (n,) at a state (n,) under constant inputs."""
    found: Real = _rates(real, x[None], inputs, modes)[0]
    return found


def outputs_at(real: NonlinearSystem, x: Real, inputs: Real, modes: tuple[Mode, ...]) -> Real:
    """Return the outputs (outputs,) at a state (n,) under constant inputs."""
    at = _still(real, x[None], inputs, modes)
    found: Real = real.read(at, real.flow(at).v)[0][0, 0]
    return found


def _rates(system: NonlinearSystem, x: Array, inputs: Real, modes: tuple[Mode, ...]) -> Array:
    return system.flow(_still(system, x, inputs, modes)).f[:, 0]


def _correction(real: NonlinearSystem, x: Real, inputs: Real, modes: tuple[Mode, ...]) -> Real | None:
    f = rates_at(real, x, inputs, modes)
    if not np.isfinite(f).all():
        return None
    slope, scale = _slope(real, x, inputs, modes)
    if not np.isfinite(slope).all():
        return None
    if not np.any(f):
        return np.zeros_like(f)
    step = np.linalg.lstsq(slope, -f / scale, rcond=1e-12)[0]
    drift = float(np.linalg.norm(slope @ step + f / scale))  # what no correction reaches goes on for ever
    if drift > 1e-8 * float(np.linalg.norm(f / scale)):
        return None
    correction: Real = step * scale
    return correction


def _noise(real: NonlinearSystem, x: Real, inputs: Real, modes: tuple[Mode, ...]) -> Real:
    """Return what the rounding of the rates makes of a correction: a state that is the difference of others comes to rest no better."""
    at = _still(real, x[None], inputs, modes)
    size, _ = magnitudes(real, at, real.flow(at))
    slope, scale = _slope(real, x, inputs, modes)
    return np.asarray(np.abs(np.linalg.pinv(slope, rcond=1e-12)) @ (ROUNDING * size[0] / scale) * scale)


def _single(real: NonlinearSystem, x: Real, inputs: Real, modes: tuple[Mode, ...]) -> bool:
    """Return whether nothing can rest elsewhere nearby; what nothing follows and nothing moves does not count."""
    slope, _ = _slope(real, x, inputs, modes)
    if not np.isfinite(slope).all():
        return False
    counts = slope.any(axis=0) | slope.any(axis=1)
    sizes = np.linalg.svd(slope[np.ix_(counts, counts)], compute_uv=False)
    return bool(sizes.min(initial=1.0) > _SINGULAR * sizes.max(initial=0.0))


def slope_at(real: NonlinearSystem, x: Real, inputs: Real, modes: tuple[Mode, ...]) -> Real:
    """Return the slope of the rates by the states (n, n), delayed signals following the states."""
    slope = real.tangent(_still(real, x[None], inputs, modes)).total[0].copy()
    if real.delays.shape[-1]:
        h = 1e-6
        for k in range(len(x)):
            width = h * max(abs(x[k]), 1.0)
            moved = x.copy()
            moved[k] += width
            up = _rates(real, moved[None], inputs, modes)[0]
            moved[k] -= 2 * width
            slope[:, k] = (up - _rates(real, moved[None], inputs, modes)[0]) / (2 * width)
    return np.asarray(slope)


def _slope(real: NonlinearSystem, x: Real, inputs: Real, modes: tuple[Mode, ...]) -> tuple[Real, Real]:
    """Return the balanced slope of the rates and the scale of the states."""
    slope = slope_at(real, x, inputs, modes)
    if not len(x) or not np.isfinite(slope).all():
        return slope, np.ones(len(x))
    with np.errstate(invalid="ignore"):  # scales beyond 2^63 are no whole numbers, for an order that is not asked for
        balanced, transform = matrix_balance(slope, permute=False)
    return np.asarray(balanced), np.asarray(np.diag(transform))


def _complete(
    system: NonlinearSystem, origin: Array, x: Real, inputs: Real, *, modes: tuple[Mode, ...], rests: bool
) -> OperatingPoint:
    """Return the point with its channels, the lanes following from those of where it began."""
    lanes: Array = np.repeat(x[None], system.lanes, axis=0)
    if system.complex:
        lanes = lanes + 1j * origin.imag
        if rests and len(x):
            moved = _rates(system, lanes, inputs, modes).imag
            slope, scale = _slope(system.value, x, inputs, modes)
            lanes = lanes + 1j * (np.linalg.lstsq(slope, -(moved / scale).T, rcond=1e-12)[0].T * scale)
    at = _still(system, lanes, inputs, modes)
    flow = system.flow(at)
    y, _ = system.read(at, flow.v)
    return OperatingPoint(
        x=lanes, w=at.w[:, 0], modes=modes, inputs=inputs, e=flow.e[:, 0], v=flow.v[:, 0], y=y[:, 0], rests=rests,
        single=rests and _single(system.value, x, inputs, modes),
    )  # fmt: skip
