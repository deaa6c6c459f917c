"""Poles of a sampled system: s = ln z / P of the eigenvalues z of the map over the common period P.

Every part whose states act on each other in a circle has a period of its own: what takes no part in a loop with samplers
keeps its continuous poles, and two loops that do not meet need no common period.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from engine.exact.frequency import poles as continuous
from engine.exact.frequency.poles import Poles
from engine.exact.sampled_data.crossings import spectra
from engine.exact.sampled_data.period import Period
from engine.model.linear_system import LaneSystem
from engine.model.strongly_connected_components import circles
from engine.model.tangent import slopes

if TYPE_CHECKING:
    from engine.exact.sampled_data.system import SampledSystem
    from engine.model.linear_system import Array

Complex = npt.NDArray[np.complex128]

_EMPTY: Final = 1e-12
"""A smaller eigenvalue than this is a memory that is empty after one period, and no pole."""
_CLEAR: Final = 1e6
"""An eigenvalue counts where its size is so many times what rounding may have moved it by."""
_PACES: Final = 1.5
"""A mode that decays so many times faster than the pace at which what is under way in delays is followed is not known."""
_LOOKS: Final = 4
"""How often between two events of a period the shape of a mode is looked at."""


def sampled_poles(system: SampledSystem) -> Poles:
    """Return the poles of a system with samplers, as angular frequencies, with their motion along its lanes.

    Raises
    ------
    UnresolvedError
        If the rates of one loop are in no rational ratio, or a lane changes it.
    """
    pattern = system.pattern
    parts: list[Poles] = []
    for circle in circles([np.flatnonzero(row).tolist() for row in pattern]):
        if circle[0] >= _continuous_states(system) and not _driven(system, circle):
            continue  # a register that nothing enters stays empty
        if len(circle) > 1 or pattern[circle[0], circle[0]] or not system.samplings:
            part = system.part(np.array(circle))
            parts.append(_of_loop(part) if part.samplings else continuous.poles(autonomous(part.flow)))
        else:  # also a sum over samples, which no event changes by itself: an integrator
            parts.append(continuous.poles(autonomous(system.flow[:, circle][:, :, circle])))
    values = np.concatenate([np.zeros(0, complex), *(part.values for part in parts)])
    order = np.lexsort((values.imag, -values.real))
    return Poles(
        values=values[order],
        uncertainty=np.concatenate([np.zeros(0), *(part.uncertainty for part in parts)])[order],
        motion=np.concatenate([np.zeros((0, system.lanes), complex), *(part.motion for part in parts)])[order],
        endless=np.zeros(len(values), dtype=bool),
    )


def _continuous_states(system: SampledSystem) -> int:
    """Return how many states flow; those of the samplers follow them."""
    jumping = np.zeros(system.n, dtype=bool)
    for sampling in system.samplings:
        jumping |= np.any(sampling.taken != np.eye(system.n), axis=(0, 2))
        if sampling.updated is not None:
            jumping |= np.any(sampling.updated != np.eye(system.n), axis=(0, 2))
    return int(np.argmax(jumping)) if jumping.any() else system.n


def _driven(system: SampledSystem, circle: list[int]) -> bool:
    """Return whether anything enters the states of a circle, or they are several that drive each other."""
    others = np.setdiff1d(np.arange(system.n), circle)
    entered = any(np.any(s.entering[:, circle] != 0) for s in system.samplings)
    return len(circle) > 1 or entered or bool(system.pattern[circle][:, others].any())


def _of_loop(part: SampledSystem) -> Poles:
    period = Period(part)
    length = float(period.length[0].real)
    turns = continuous.poles(autonomous(period.whole()))
    kept = np.abs(turns.values) > np.maximum(turns.uncertainty, _EMPTY)
    if np.isfinite(part.pace):
        kept &= _of_itself(turns.values, period) & (np.abs(turns.values) >= np.exp(-_PACES * part.pace * length))
    z, moved = turns.values[kept], turns.motion[kept]
    s: Complex = np.log(z.astype(complex)) / length
    if len(part.samplings) > 1:
        s = s + np.asarray(2j * np.pi / length * _aliases(period, z))
    motion = (moved / z[:, None] - s[:, None] * slopes(period.length)) / length
    uncertainty = turns.uncertainty[kept] / np.abs(z) / length
    return Poles(values=s, uncertainty=uncertainty, motion=motion, endless=np.zeros(len(s), dtype=bool))


def _of_itself(eigenvalues: Complex, period: Period) -> npt.NDArray[np.bool_]:
    """Return which eigenvalues are no rounding of 0: what is under way in a delay makes chains of states that end empty."""
    (own,) = spectra(period.maps())
    with np.errstate(invalid="ignore"):
        clear = np.abs(own.values) > _CLEAR * own.uncertainty
    nearest = np.abs(eigenvalues[:, None] - own.values).argmin(axis=1)
    return np.asarray(clear[nearest])


def _aliases(period: Period, eigenvalues: Complex) -> npt.NDArray[np.int64]:
    """Return how many turns per common period the strongest part of each mode makes more than ln z says.

    Several rates see more than the slowest: a mode that turns several times within the common period is told at the
    frequency at which it mostly swings.
    """
    length = float(period.length[0].real)
    count = _LOOKS * (len(period.events) + 1)
    marked = Period(period.system, np.arange(count) * (length / count))
    turns = np.arange(-count // 4, count // 4 + 1)
    found = np.zeros(len(eigenvalues), dtype=np.int64)
    whole = period.maps()[0]
    for k, z in enumerate(eigenvalues):
        if z.imag == 0 and z.real > 0:
            continue
        shape = np.linalg.svd(whole - z * np.eye(len(whole)))[2][-1].conj()
        times, states = marked.passage(shape, 0.0)
        upright = states * np.exp(-np.log(z) * times / length)[:, None]
        upright /= np.maximum(np.abs(upright).max(axis=0), 1e-300)
        weights = np.diff(np.append(times, length))
        parts = (weights[:, None] * np.exp(-2j * np.pi * np.outer(times, turns) / length)).T @ upright
        strength = (np.abs(parts) ** 2).sum(axis=1)
        best = np.flatnonzero(strength >= strength.max() * (1 - 1e-9))
        found[k] = turns[best[np.argmin(np.abs(np.angle(z) + 2 * np.pi * turns[best]))]]
    return found


def autonomous(a: Array) -> LaneSystem:
    """Return x' = a x, ``a`` of shape (lanes, n, n), without inputs and outputs."""
    lanes, n, _ = a.shape
    empty = {
        "b1": (n, 0),
        "b2": (n, 0),
        "c1": (0, n),
        "c2": (0, n),
        "d11": (0, 0),
        "d12": (0, 0),
        "d21": (0, 0),
        "d22": (0, 0),
    }
    return LaneSystem(
        a=a, **{name: np.zeros((lanes, *shape)) for name, shape in empty.items()},
        delays=np.zeros((lanes, 0)), x0=np.zeros((lanes, n)), inputs=(), outputs=(),
    )  # fmt: skip
