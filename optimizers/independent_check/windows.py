"""What runs of nonlinear systems over a given duration say, each followed twice: the second time a thousand times more exactly.

    value of the finer run,   tolerance = 10 |finer - coarser| + 1e-8 |finer|

A metric of where an output settles is read where it rests at the end, to rounding, or clearly moves: its last value is then the
one that counts. What comes near to rest without being there has its end from the exact engine alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import numpy as np

from engine.model.masks import Envelope, Polyline
from optimizers.independent_check import timing
from optimizers.independent_check.march import CannotFollowError
from optimizers.independent_check.switched import Follower
from optimizers.independent_check.timing import READINGS, Trace

if TYPE_CHECKING:
    from engine.analysis.measuring import MetricRequest
    from engine.diagram.diagram import Diagram
    from engine.signals import Signal
    from optimizers.independent_check.march import March

_COARSE: Final = 1e-7
_FINE: Final = 1e-10
_SMALL: Final = 1e-3
"""Tolerances are relative to a state's value, or to this part of its largest one."""
_ROUNDING: Final = 1e-8
_RESTS, _MOVES = 1e-9, 1e-2
"""Of its range, what an output moves by in the last tenth."""


class Runs:
    """Runs of one nonlinear system, each made once.

    Parameters
    ----------
    diagram : Diagram
    overrides : mapping of str to float
        Parameter values, SI.
    """

    def __init__(self, diagram: Diagram, overrides: Mapping[str, float]) -> None:
        self._diagram = diagram
        self._system = diagram.laws(overrides, {}).value
        self._made: dict[tuple[object, ...], tuple[March, March] | None] = {}

    def measure(self, request: MetricRequest, signals: Mapping[str, Signal]) -> tuple[float, float] | None:
        """Return the value of a metric of a response and its tolerance, None where it has no reading here."""
        until = request.duration
        if until is None:
            return None
        marches = self._followed(signals, until)
        output = self._diagram.outputs.index(str(request.output))
        still = Follower(self._system, {}, until).beginning()[output]
        begin = min((t for signal in signals.values() for t in signal.breakpoints()), default=0.0)
        found = []
        for march in marches:
            trace = Trace.of(march, output, initial=float(still), begin=begin)
            value = self._read(request, signals, trace, until)
            if value is None:
                return None
            found.append(value)
        coarse, fine = found
        return fine, 10 * abs(fine - coarse) + _ROUNDING * abs(fine)

    def _followed(self, signals: Mapping[str, Signal], until: float) -> tuple[March, March]:
        key = (until, *((port, id(signal)) for port, signal in signals.items()))
        if key not in self._made:
            self._made[key] = None
            outputs = range(len(self._diagram.outputs))
            sizes = np.full(self._system.states, _SMALL)
            coarse, largest = Follower(self._system, signals, until).run(outputs, relative=_COARSE, sizes=sizes)
            sizes = _SMALL * np.where(largest > 0, largest, 1.0)
            fine, _ = Follower(self._system, signals, until).run(outputs, relative=_FINE, sizes=sizes)
            self._made[key] = coarse, fine
        made = self._made[key]
        if made is None:
            raise CannotFollowError
        return made

    def _read(self, request: MetricRequest, signals: Mapping[str, Signal], trace: Trace, until: float) -> float | None:
        name, mask = request.metric, request.mask
        if not request.as_told(self._diagram):
            return None
        reference = signals.get(self._diagram.references.input_of(signals, request.output) or "")
        ends = [signal.end() for signal in signals.values()]
        last = None if None in ends else max(float(end or 0.0) for end in ends)
        value = None
        if isinstance(mask, Envelope) and max(line.times[-1] for line, _ in mask.sides) <= until:
            value = timing.envelope(trace, mask)
        elif isinstance(mask, Polyline) and mask.times[-1] <= until:
            value = timing.tracking_error(trace, mask)
        elif name in timing.INTEGRALS:
            value = timing.error_integral(trace, name, reference, until)
        elif name == "control_effort_rms":
            value = float(np.sqrt(trace.integral(lambda _, y: y * y, []) / until))
        elif name in READINGS and name not in timing.OF_THE_END:
            value = READINGS[name](_unless_at_the_end(trace))
        elif last is not None and last < until:
            value = self._of_the_end(request, trace.settled_at(_end(trace, last)), reference, last)
        return value

    @staticmethod
    def _of_the_end(request: MetricRequest, trace: Trace, reference: Signal | None, last: float) -> float | None:
        name = request.metric
        assert trace.final is not None
        if name == "steady_state_error":
            return float((reference.final() or 0.0) if reference is not None else 0.0) - trace.final
        if name == "residual_vibration":
            return timing.residual_vibration(trace, last)
        if name == "settling_time":
            return timing.last_entry(trace, request.options.settling_band)
        return READINGS[name](trace) if name in READINGS else None


def _end(trace: Trace, last: float) -> float:
    """Return the last value, where it is sure that this is the one that counts."""
    late = trace.cut(trace.end - 0.1 * (trace.end - last), trace.end).values
    moves = float(np.ptp(late)) / max(float(np.ptp(trace.values)), 1e-300)
    if _RESTS < moves < _MOVES:
        raise CannotFollowError
    return float(trace.values[-1, -1])


def _unless_at_the_end(trace: Trace) -> Trace:
    """Return a run whose greatest value is not its last one: that may be on its way to rest."""
    top = timing.peak(trace)
    if abs(float(trace.values[-1, -1])) >= top * (1 - _RESTS):
        _end(trace, 0.0)
    return trace
