"""Response of a system with samplers to a recorded input, from instant to instant by matrices.

    ζ = (ξ, q),   ζ -> e^{F h} ζ between two instants,   ξ -> J ξ + K q_0 at an event

q are the coefficients of the input's polynomial at the instant that has been reached, u = q_0: they move on by themselves, and
change where a recorded sample is passed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.exact.nonlinear.operating_point import operating_point
from engine.exact.sampled_data.build import sampled_system
from engine.exact.time.propagate import exponentials
from engine.model.between_samples import BetweenSamples, polynomials, told
from engine.model.errors import UnresolvedError
from engine.model.tangent import slopes

if TYPE_CHECKING:
    from engine.exact.laws.system import NonlinearSystem
    from engine.exact.sampled_data.system import Event, SampledSystem
    from engine.model.linear_system import Array

Samples = npt.NDArray[np.float64]

_TOGETHER: Final = 1e-9
"""Instants closer than this part of the sample time are one."""


def simulate_recorded(
    laws: NonlinearSystem,
    inputs: Samples,
    sample_time: float,
    *,
    outputs: Sequence[str],
    deviation: npt.NDArray[Any] | None = None,
    between: Mapping[str, BetweenSamples] | BetweenSamples,
) -> tuple[Samples, Samples] | None:
    """Return the outputs at the samples, with their derivatives along every lane, as the path of nonlinear systems does.

    None where values are under way in pure delays, where the rates have no common period, and where the system does not rest
    under the first values.
    """
    point = operating_point(laws, dict(zip(laws.inputs, inputs[:, 0].tolist(), strict=True)))
    try:
        system = sampled_system(laws)
        events = system.events()
    except UnresolvedError:
        return None
    if system.n != laws.states or not point.rests or system.uneven.any():
        return None
    if deviation is not None and any(float((s.offset + s.delay - s.period)[0].real) >= 0 for s in system.samplings):
        return None  # what is to come of a sample before the beginning
    coefficients = _coefficients(inputs, told(between, laws.inputs))
    march = _March(system, events, sample_time, coefficients.shape[1])
    start = point.x if deviation is None else point.x + deviation
    with np.errstate(all="ignore"):
        states, seen = march.run(np.broadcast_to(start, (laws.lanes, laws.states)), coefficients)
    rows = [laws.outputs.index(name) for name in outputs]
    found = np.einsum("lon,tln->lot", system.read[:, rows], states) + np.einsum(
        "loi,ti->lot", system.direct[:, rows], seen
    )
    values = found[0].real.copy()
    values[~np.isfinite(values)] = np.inf
    tangents = np.zeros((laws.lanes, *values.shape)) + (slopes(found) if np.iscomplexobj(found) else 0.0)
    return values, np.where(np.isfinite(tangents), tangents, 0.0)


def _coefficients(inputs: Samples, ways: Sequence[BetweenSamples]) -> Samples:
    """Return the polynomial of each input behind each sample, (samples, degree + 1, inputs); the last goes on as a constant."""
    found = [polynomials(row, way) for row, way in zip(inputs, ways, strict=True)]
    degree = max(len(one) for one in found)
    whole = np.zeros((inputs.shape[1], degree, len(inputs)))
    for k, one in enumerate(found):
        whole[:-1, : len(one), k] = one.T
    whole[-1, 0] = inputs[:, -1]
    return whole


class _March:
    """Matrices from instant to instant: as many as there are different distances."""

    def __init__(self, system: SampledSystem, events: Sequence[Event], sample_time: float, degree: int) -> None:
        self._system, self._events, self._h = system, events, sample_time
        n, count = system.n, len(system.inputs)
        self._flow = np.zeros(
            (system.lanes, n + degree * count, n + degree * count), dtype=np.result_type(system.flow, float)
        )
        self._flow[:, :n, :n] = system.flow
        self._flow[:, :n, n : n + count] = system.driven
        for power in range(1, degree):
            rows = n + (power - 1) * count + np.arange(count)
            self._flow[:, rows, rows + count] = power / sample_time
        self._passed: dict[tuple[int, bytes], Array] = {}

    def run(self, start: Array, coefficients: Samples) -> tuple[Array, Samples]:
        """Return the states (samples, lanes, n) and inputs (samples, inputs) behind each sample."""
        system, h, n = self._system, self._h, self._system.n
        joint = np.zeros(
            (system.lanes, len(self._flow[0]), 1), dtype=np.result_type(self._flow, start, system.period, float)
        )
        joint[:, :n, 0] = start
        period = system.period
        events = [(event.time, self._jump(event.jump, event.entering)) for event in self._events]
        before: Array = np.zeros(system.lanes)
        turn, number = 0, 0
        found = np.empty((len(coefficients), system.lanes, n), dtype=joint.dtype)
        for k, own in enumerate(coefficients):
            joint = self._over(k * h - before) @ joint
            before = np.full(system.lanes, k * h)
            joint[:, n:, 0] = own.ravel()
            shown = False
            while events:
                time = events[number][0] + turn * period
                late = float(time[0].real) - k * h
                if not shown and late > _TOGETHER * h:
                    found[k], shown = self._shown(joint, k * h - before), True
                if late >= h * (1 - _TOGETHER):
                    break
                joint = events[number][1] @ (self._over(time - before) @ joint)
                before = time
                number += 1
                if number == len(events):
                    turn, number = turn + 1, 0
            if not shown:
                found[k] = self._shown(joint, k * h - before)
        return found, coefficients[:, 0]

    def _shown(self, joint: Array, after: Array) -> Array:
        """Return the states at a sample, which an event that moves with a parameter may have been reached beside."""
        own = self._over(after) @ joint if np.iscomplexobj(after) and np.any(after.imag) else joint
        return np.asarray(own[:, : self._system.n, 0])

    def _over(self, width: Array) -> Array:
        """Return e^{F width}, the same for widths that are equal but for rounding."""
        moved = np.imag(width) if np.iscomplexobj(width) else np.zeros(0)
        key = (round(float(width[0].real) / (1e-3 * _TOGETHER * self._h)), moved.tobytes())
        if key not in self._passed:
            self._passed[key] = exponentials(np.asarray(width)[:, None, None] * self._flow)
        return self._passed[key]

    def _jump(self, jump: Array, entering: Array) -> Array:
        n = self._system.n
        found = np.zeros(self._flow.shape, dtype=np.result_type(jump, entering, float)) + np.eye(self._flow.shape[-1])
        found[:, :n, :n] = jump
        found[:, :n, n : n + entering.shape[-1]] = entering
        return found
