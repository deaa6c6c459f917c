"""Response of a nonlinear system to a recorded input that is held, linear or a spline between its samples.

The input is taken to have had its first value for ever: the response starts where the system then rests, or at its
initial state where it does not.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.exact.nonlinear.integrate import Integration
from engine.exact.nonlinear.operating_point import operating_point
from engine.exact.time.chebyshev import weights
from engine.model.between_samples import BetweenSamples, told
from engine.model.errors import UnresolvedError
from engine.model.tangent import slopes
from engine.model.verdicts import Verdict
from engine.signals import make

if TYPE_CHECKING:
    from engine.exact.laws.system import NonlinearSystem

Samples = npt.NDArray[np.float64]

TOLERANCE: Final = 1e-9
"""A recording is never as exact as this."""
WALL_LIMIT: Final = 120.0


def simulate_recorded(
    system: NonlinearSystem,
    inputs: Samples,
    sample_time: float,
    *,
    outputs: Sequence[str] | None = None,
    deviation: npt.NDArray[Any] | None = None,
    between: Mapping[str, BetweenSamples] | BetweenSamples = BetweenSamples.LINEAR,
    clock: Callable[[], float] = time.monotonic,
    wall_limit: float = WALL_LIMIT,
) -> tuple[Samples, Samples]:
    """Return the outputs at the samples of a recorded input, with their derivatives along every lane.

    Parameters
    ----------
    system : NonlinearSystem
    inputs : ndarray, shape (inputs, samples)
        Values at t = 0, h, 2h, ...; each had its first value before t = 0.
    sample_time : float
        h in s.
    outputs : sequence of str, optional
        By default all of the system's.
    deviation : ndarray, shape (lanes, states), optional
        Added to the state from which the response starts; imaginary parts are its lanes.
    between : BetweenSamples, or mapping of input to BetweenSamples
        What the inputs do between their samples; linear where nothing is said. Where a held input jumps, the outputs are
        those just behind the jump.
    clock, wall_limit : callable, float
        The computation is given up when ``clock`` has gone on by ``wall_limit`` seconds.

    Returns
    -------
    values : ndarray, shape (outputs, samples)
        Infinite where the response grows beyond what can be followed.
    tangents : ndarray, shape (lanes, outputs, samples)

    Raises
    ------
    UnresolvedError
        Where the response cannot be followed to its end.
    """
    names = system.outputs if outputs is None else tuple(outputs)
    instants: Samples = sample_time * np.arange(inputs.shape[1], dtype=np.float64)
    point = operating_point(system, dict(zip(system.inputs, inputs[:, 0].tolist(), strict=True)))
    ways = told(between, system.inputs)
    given = {
        name: make("sampled", {"time": instants.tolist(), "values": row.tolist(), "between_samples": way})
        for name, row, way in zip(system.inputs, inputs, ways, strict=True)
        if np.any(row)
    }
    state, modes, past = (point.x, point.modes, point.w) if point.rests else (None, None, None)
    if deviation is not None:
        state, modes = (system.start if state is None else state) + deviation, None
    run = Integration(
        system, given, tolerance=TOLERANCE, clock=clock, limit=wall_limit, state=state, modes=modes, past=past
    )
    # the last sample of what a held input or a sampler moves at once lies behind its last jump
    jumps = BetweenSamples.HOLD in ways or any(law.element.period(law.values) is not None for law in system.laws)
    outcome = run.advance(float(instants[-1]) + (sample_time / 2 if jumps else 0.0))
    values = np.full((len(names), len(instants)), np.inf)
    tangents = np.zeros((system.lanes, *values.shape))
    if outcome.verdict is Verdict.UNSTABLE:
        return values, tangents
    if outcome.verdict is not Verdict.OK:
        raise UnresolvedError(outcome.advice)
    edges = np.array(outcome.record.times)
    piece = np.clip(np.searchsorted(edges, instants, side="right") - 1, 0, len(edges) - 2)
    for row, name in enumerate(names):
        curve = outcome.output(system.outputs.index(name))
        values[row] = curve.sample(instants)
        if system.complex:
            local = (instants[:, None] - curve.edges[piece]) / (curve.edges[piece + 1] - curve.edges[piece])
            inside = np.clip(local.real, 0.0, 1.0) + 1j * local.imag
            tangents[:, row] = slopes(np.einsum("tlj,tjl->lt", weights(inside), curve.values[piece]))
    return values, tangents
