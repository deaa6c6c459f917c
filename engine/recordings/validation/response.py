"""The answer of a system to a recording, with its derivatives by any parameters.

The model follows the recorded inputs from the recording's first sample: a simulation, never a one-step prediction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from engine.exact.frequency.path import connected
from engine.exact.nonlinear.recorded import WALL_LIMIT, simulate_recorded
from engine.exact.sampled_data import recorded as sampled_data
from engine.exact.time.sampled import Drive, simulate_sampled
from engine.model.between_samples import BetweenSamples, told
from engine.model.errors import UnresolvedError
from engine.model.failures import numerical
from engine.model.tangent import INFINITESIMAL

if TYPE_CHECKING:
    from engine.diagram.diagram import Diagram
    from engine.exact.laws.system import NonlinearSystem

Samples = npt.NDArray[np.float64]
Between: TypeAlias = Mapping[str, BetweenSamples] | BetweenSamples


@numerical()
def respond(
    diagram: Diagram,
    inputs: Mapping[str, Samples],
    sample_time: float,
    *,
    outputs: Sequence[str],
    overrides: Mapping[str, float],
    between: Between = BetweenSamples.LINEAR,
    wall_limit: float = WALL_LIMIT,
) -> dict[str, Samples]:
    """Return the outputs at the samples of recorded inputs; inputs that were not recorded are 0.

    Parameters
    ----------
    diagram : Diagram
    inputs : mapping of str to ndarray, shape (samples,)
        By the names of the diagram's inputs; at least one.
    sample_time : float
        s.
    outputs : sequence of str
    overrides : mapping of str to float
        Parameter values, SI.
    between : BetweenSamples, or mapping of input to BetweenSamples
        What the inputs do between their samples.
    wall_limit : float
        s, after which a nonlinear response is given up.

    Returns
    -------
    dict of str to ndarray, shape (samples,)
        Infinite where the response grows beyond any number.

    Raises
    ------
    EngineError
        At values for which there is no system, or where a nonlinear response cannot be followed.
    """
    driven = _driven(diagram, inputs)
    if diagram.nonlinear:
        laws, asked = diagram.laws(overrides), {"sample_time": sample_time, "outputs": outputs, "between": between}
        values, _ = _simulated(diagram, laws, driven, asked, wall_limit)
    else:
        values = simulate_sampled(diagram.realize(overrides), driven, sample_time, outputs=outputs, between=between)
    return dict(zip(outputs, values, strict=True))


@numerical()
def tangents(
    diagram: Diagram,
    inputs: Mapping[str, Samples],
    sample_time: float,
    *,
    outputs: Sequence[str],
    overrides: Mapping[str, float],
    parameters: Sequence[str],
    between: Between = BetweenSamples.LINEAR,
    wall_limit: float = WALL_LIMIT,
) -> dict[str, dict[str, Samples]]:
    """Return the exact derivative of each output by each parameter, output -> parameter -> samples.

    ``wall_limit`` (s) is when a nonlinear response is given up; the rest is as in :func:`respond`.

    Raises
    ------
    UnresolvedError
        Where a nonlinear response, or its derivative, cannot be followed.
    """
    if not parameters:
        return {name: {} for name in outputs}
    steps = dict.fromkeys(parameters, INFINITESIMAL)
    if diagram.nonlinear:
        laws = diagram.laws(overrides, steps)
        with np.errstate(all="ignore"):  # a parameter at the edge of its range may have no derivative: told below
            asked = {"sample_time": sample_time, "outputs": outputs, "between": between}
            values, found = _simulated(diagram, laws, _driven(diagram, inputs), asked, wall_limit)
        if not np.isfinite(values).all():
            raise UnresolvedError("the response has no derivative by every one of these parameters")
    else:
        sources = [diagram.inputs.index(name) for name in inputs]
        targets = [diagram.outputs.index(name) for name in outputs]
        part = connected(diagram.realize_lanes(steps, overrides), sources, targets)
        _, found = Drive(np.array(list(inputs.values())), sample_time, between=told(between, list(inputs))).respond(
            part
        )
    return {
        output: {parameter: found[lane, row] for lane, parameter in enumerate(parameters)}
        for row, output in enumerate(outputs)
    }


def _simulated(
    diagram: Diagram, laws: NonlinearSystem, driven: Samples, asked: Mapping[str, Any], wall_limit: float
) -> tuple[Samples, Samples]:
    """Return the response with its derivatives: by matrices where samplers are all that is not linear."""
    found = sampled_data.simulate_recorded(laws, driven, **asked) if diagram.sampled_alone else None
    return found or simulate_recorded(laws, driven, wall_limit=wall_limit, **asked)


def _driven(diagram: Diagram, inputs: Mapping[str, Samples]) -> Samples:
    rest = np.zeros(next(iter(inputs.values())).size)
    return np.array([inputs.get(name, rest) for name in diagram.inputs])
