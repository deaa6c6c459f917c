"""Poles of a sampled system: s = ln z / P of the eigenvalues z of the map over the common period P.

Every part whose states act on each other in a circle has a period of its own: what takes no part in a loop with samplers
keeps its continuous poles, and two loops that do not meet need no common period.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from engine.exact.frequency import poles as continuous
from engine.exact.frequency.poles import Poles
from engine.exact.sampled_data.aliases import marked, turns
from engine.exact.sampled_data.crossings import Spectrum, spectra
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
_TOGETHER: Final = 64
"""Modes that are followed over the period at once."""
_LOOKS: Final = 4
"""How often between two events of a period the shape of a mode is looked at."""


def sampled_poles(system: SampledSystem) -> Poles:
    """Return the poles of a system with samplers, as angular frequencies, with their motion along its lanes.

    Raises
    ------
    UnresolvedError
        If the rates of one loop are in no rational ratio, or a lane changes it.
    """
    parts = [_of_loop(part) if part.samplings else continuous.poles(autonomous(part.flow)) for part in parts_of(system)]
    values = np.concatenate([np.zeros(0, complex), *(part.values for part in parts)])
    order = np.lexsort((values.imag, -values.real))
    return Poles(
        values=values[order],
        uncertainty=np.concatenate([np.zeros(0), *(part.uncertainty for part in parts)])[order],
        motion=np.concatenate([np.zeros((0, system.lanes), complex), *(part.motion for part in parts)])[order],
        delay=np.zeros(len(values)),
    )


def parts_of(system: SampledSystem) -> list[SampledSystem]:
    """Return the parts whose states follow each other, each with the samplers that have a share in its poles."""
    pattern, flowing = system.pattern, _continuous_states(system)
    found = []
    for circle in circles([np.flatnonzero(row).tolist() for row in pattern]):
        if circle[0] >= flowing and not _driven(system, circle):
            continue  # a register that nothing enters stays empty
        part = system.part(np.array(circle))
        # a sum over samples too, which no event changes by itself, is an integrator
        alone = len(circle) == 1 and not pattern[circle[0], circle[0]]
        found.append(replace(part, samplings=()) if alone else part)
    return found


def _continuous_states(system: SampledSystem) -> int:
    """Return how many states flow; those of the samplers follow them."""
    jumping = np.zeros(system.n, dtype=bool)
    for sampling in system.samplings:
        jumping |= sampling.moved
    return int(np.argmax(jumping)) if jumping.any() else system.n


def _driven(system: SampledSystem, circle: list[int]) -> bool:
    """Return whether anything enters the states of a circle, or they are several that drive each other."""
    others = np.setdiff1d(np.arange(system.n), circle)
    entered = any(np.any(s.entering[:, circle] != 0) for s in system.samplings)
    return len(circle) > 1 or entered or bool(system.pattern[circle][:, others].any())


def _of_loop(part: SampledSystem) -> Poles:
    period = Period(part)
    length = float(period.length[0].real)
    whole = period.whole()
    if not whole.size:  # all that is in it is overwritten before it counts
        return continuous.poles(autonomous(whole))
    found = continuous.poles(autonomous(whole))
    kept = np.abs(found.values) > np.maximum(found.uncertainty, _EMPTY)
    (own,) = spectra(whole[:1].real)
    if np.isfinite(part.pace):
        kept &= _of_itself(found.values, own) & (np.abs(found.values) >= np.exp(-_PACES * part.pace * length))
    z, moved = found.values[kept], found.motion[kept]
    s: Complex = np.log(z.astype(complex)) / length
    if len(part.samplings) > 1:
        s = s + np.asarray(2j * np.pi / length * _aliases(part, own, z))
        s[z.imag == 0] = s[z.imag == 0].real + 1j * np.abs(s[z.imag == 0].imag)  # a real one stands for both signs
    motion = (moved / z[:, None] - s[:, None] * slopes(period.length)) / length
    uncertainty = found.uncertainty[kept] / np.abs(z) / length
    return Poles(values=s, uncertainty=uncertainty, motion=motion, delay=np.zeros(len(s)))


def _of_itself(eigenvalues: Complex, own: Spectrum) -> npt.NDArray[np.bool_]:
    """Return which eigenvalues are no rounding of 0: what is under way in a delay makes chains of states that end empty."""
    with np.errstate(invalid="ignore"):
        clear = np.abs(own.values) > _CLEAR * own.uncertainty
    nearest = np.abs(eigenvalues[:, None] - own.values).argmin(axis=1)
    return np.asarray(clear[nearest])


def _aliases(part: SampledSystem, own: Spectrum, eigenvalues: Complex) -> npt.NDArray[np.int64]:
    """Return how many turns per common period the strongest part of each mode makes more than ln z says."""
    period, shown = marked(part.value, _LOOKS), _shown(part)
    found = np.zeros(len(eigenvalues), dtype=np.int64)
    turning = np.flatnonzero((eigenvalues.imag != 0) | (eigenvalues.real < 0))
    for few in np.array_split(turning, len(turning) // _TOGETHER + 1):
        z = eigenvalues[few]
        nearest = np.abs(z - own.values[:, None]).argmin(axis=0)
        found[few] = turns(z, period.passage(period.of_all(own.vectors[:, nearest]), 0.0, shown))
    return found


def _shown(system: SampledSystem) -> npt.NDArray[np.int64]:
    """Return the states that a mode is seen by: those that flow and those of samplers, not what is under way."""
    shown = np.any(system.flow != 0, axis=(0, 2))
    for sampling in system.samplings:
        if sampling.sampler:
            shown |= sampling.moved
    return np.flatnonzero(shown)


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
