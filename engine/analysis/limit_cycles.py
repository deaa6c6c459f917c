"""Limit cycles: what a simulated response swings in for ever, and what describing functions predict of it.

Every nonlinear block that has a describing function is looked at in turn, all others being linearised at rest. The
prediction assumes that what comes back to the block is a sine about 0: the better the loop filters, the better it is.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from engine.analysis.describing_function import Cycle, cycles, fourier_gain
from engine.exact.frequency.harmonics import harmonics_of_curve
from engine.exact.frequency.path import merged, path
from engine.exact.frequency.poles import poles
from engine.exact.frequency.response import FrequencyResponse
from engine.model.errors import EngineError
from engine.model.linear_system import LaneSystem
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.analysis.describing_function import Gain
    from engine.diagram.diagram import Diagram
    from engine.exact.laws.laws import Law
    from engine.exact.nonlinear.response import Response
    from engine.exact.time.curve import Curve

_AMPLITUDES: Final = np.logspace(-5, 3, 41)
"""Where a law without a closed form is looked at, unit of its input."""
_FEWEST: Final = 4
_FLOOR: Final = 1e-9
_MOST_POINTS: Final = 1500
_PERIODS: Final = 3
"""So many periods must be seen at the end of a response to call it a limit cycle."""
_SAME: Final = 1e-2
"""Two periods that differ by less than this part of their range are the same."""
_STEADY: Final = 2e-3
_MULTIPLES: Final = 8
_MOVES: Final = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictedCycle:
    """A limit cycle by the describing function of one block.

    ``amplitude`` is that of the fundamental at the block's input, ``frequency`` in rad/s; ``outputs`` are the amplitudes of
    the fundamental of the diagram's outputs. One that is not ``stable`` parts what dies away from what grows.
    """

    block: str
    amplitude: float
    frequency: float
    stable: bool
    outputs: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitCycle:
    """What a response ends in: its frequency (rad/s), the fundamental's amplitude of each output, and the predictions."""

    frequency: float
    outputs: Mapping[str, float]
    predictions: tuple[PredictedCycle, ...]


def predicted(diagram: Diagram, overrides: Mapping[str, float] | None = None) -> tuple[PredictedCycle, ...]:
    """Return the limit cycles that the describing function of each block predicts.

    Parameters
    ----------
    diagram : Diagram
    overrides : mapping, optional
        Parameter values, SI.
    """
    found: list[PredictedCycle] = []
    for law in diagram.laws(overrides).laws:
        gain = _gain(law)
        if gain is None:
            continue
        try:
            seen = _Seen(diagram, law.label, overrides)
            solutions = cycles(gain, seen.frequencies, seen.loop, 1.0)
        except EngineError:  # nothing is known of a loop that does not exist
            continue
        found.extend(
            PredictedCycle(
                block=law.label, amplitude=cycle.amplitude, frequency=cycle.frequency, stable=cycle.stable,
                outputs=seen.outputs(cycle),
            )
            for cycle in solutions
        )  # fmt: skip
    return tuple(found)


def _gain(law: Law) -> Gain | None:
    """Return N(A): the closed form of a law or, for one without memory, its Fourier integrals at amplitudes between which ln N is smooth."""
    element, values = law.element, law.real
    if element.describing_function(np.ones(1), values) is not None:

        def closed(amplitude: npt.NDArray[np.float64]) -> npt.NDArray[np.complex128]:
            return np.asarray(element.describing_function(amplitude, values), dtype=complex)

        return closed
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 - a quarter of a second

    ports = element.ports(values)
    if (
        (len(ports.inputs), len(ports.outputs)) != (1, 1)
        or element.initial(values)
        or element.period(values) is not None
    ):
        return None
    table: dict[float, complex] = {}
    for amplitude in _AMPLITUDES:
        with contextlib.suppress(ValueError, EngineError):  # too sharp a bend to be followed at this amplitude
            table[float(amplitude)] = fourier_gain(element, values, float(amplitude))
    known = {amplitude: gain for amplitude, gain in table.items() if np.isfinite(gain) and gain != 0}
    if len(known) < _FEWEST:
        return None
    gains = np.array(list(known.values()))
    logarithm = np.log(np.abs(gains)) + 1j * np.unwrap(np.angle(gains))
    spline = CubicSpline(np.log(list(known)), logarithm, extrapolate=False)

    def tabulated(amplitude: npt.NDArray[np.float64]) -> npt.NDArray[np.complex128]:
        return np.asarray(np.exp(spline(np.log(amplitude))))

    return tabulated


class _Seen:
    """What a block sees of the rest of its diagram."""

    def __init__(self, diagram: Diagram, label: str, overrides: Mapping[str, float] | None) -> None:
        whole = merged(LaneSystem.of([diagram.around(label, overrides)]).balanced())
        self._whole, self._names = whole, diagram.outputs
        reads = diagram.wiring(label).reads
        self._own = [read == reads[-1] for read in reads[:-1]]
        part = path(whole, [len(whole.inputs) - 1], [len(whole.outputs) - 1])
        self.loop = FrequencyResponse.near(part, poles(part.value), floor=_FLOOR)
        scan = self.loop.scan[0]
        self.frequencies = scan[:: max(1, len(scan) // _MOST_POINTS)]

    def outputs(self, cycle: Cycle) -> dict[str, float]:
        """Return the amplitude of every output's fundamental."""
        at, size = np.array([cycle.frequency]), abs(cycle.gain) * cycle.amplitude
        found = {}
        for k, name in enumerate(self._names):
            through = 1.0
            if not self._own[k]:
                part = path(self._whole, [len(self._whole.inputs) - 1], [k])
                through = abs(complex(FrequencyResponse(part)(at)[0]))
            found[name] = through * size
        return found


def observed(response: Response, names: Sequence[str], last: float) -> tuple[float, dict[str, float]] | None:
    """Return the frequency (rad/s) in which a response ends and the amplitudes of its outputs; None where it does not.

    Parameters
    ----------
    response : Response
    names : sequence of str
        Outputs that are looked at.
    last : float
        When the commands change for the last time, s.
    """
    if response.outcome.verdict is not Verdict.OK or response.outcome.end <= last:
        return None
    late = 0.5 * (response.outcome.end - last)
    curves = {name: response.output(name).since(response.outcome.end - late) for name in names}
    sizes = {name: float(np.ptp(curve.values[:, :, 0].real)) for name, curve in curves.items()}
    moving = [name for name in names if sizes[name] > _MOVES * float(np.abs(curves[name].values[:, :, 0].real).max())]
    for name in moving:
        period = _period(curves[name], sizes[name]) if _steady(curves[name], sizes[name]) else None
        if period is None:
            return None
        frequency = 2 * np.pi / period
        return frequency, {
            other: float(harmonics_of_curve(response.output(other), frequency, 1).amplitude[0]) for other in names
        }
    return None


def _steady(curve: Curve, size: float) -> bool:
    """Return whether a curve swings in its second half between the values of its first: it neither decays nor drifts."""
    middle = 0.5 * (float(curve.times[0]) + curve.end)
    early, late = (part.values[:, :, 0].real for part in (curve.until(middle), curve.since(middle)))
    apart = max(abs(float(late.max() - early.max())), abs(float(late.min() - early.min())))
    return apart <= _STEADY * size


def _period(curve: Curve, size: float) -> float | None:
    """Return the time after which a curve repeats itself up to its end, None where it does not."""
    values = curve.values[:, :, 0].real
    middle = 0.5 * (float(values.min()) + float(values.max()))
    instants = np.array([float(instant[0].real) for instant, _ in curve.crossings(np.array([middle]))])
    begin = float(curve.times[0])
    for apart in range(1, min(2 * _MULTIPLES, len(instants) - 1) + 1):
        span = float(instants[-1] - instants[-1 - apart])
        if span <= 0 or curve.end - _PERIODS * span < begin:
            continue
        times = np.linspace(curve.end - 2 * span, curve.end - span, 200, endpoint=False)
        away = np.abs(curve.sample(times + span) - curve.sample(times))
        if float(np.mean(away)) <= _SAME * size and float(np.mean(np.abs(np.diff(curve.sample(times))))) > 0:
            return span
    return None
