"""Which goals the second measurement can state, and how."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.model.errors import EngineError
from engine.model.masks import Envelope, FrequencyBounds, Polyline
from optimizers.independent_check import margins, timing
from optimizers.independent_check.march import CannotFollowError, March, Marcher
from optimizers.independent_check.sweep import Sweep
from optimizers.independent_check.timing import READINGS, Trace
from optimizers.independent_check.windows import Runs

if TYPE_CHECKING:
    from engine.analysis.measuring import MetricRequest
    from engine.model.linear_system import LinearSystem
    from engine.signals import Signal
    from optimizers.problem import Problem, Scenario

_OF_SWEEPS: Mapping[str, Callable[[Sweep], float]] = {
    "bandwidth": margins.bandwidth,
    "disk_margin": margins.disk_margin,
    "gain_margin": margins.gain_margin,
    "gain_margin_down": margins.gain_margin_down,
    "gain_margin_up": margins.gain_margin_up,
    "phase_margin": margins.phase_margin,
    "delay_margin": margins.delay_margin,
}
_OF_MODES: Mapping[str, Callable[[npt.NDArray[np.complex128]], float]] = {
    "damping_ratio": margins.damping_ratio,
    "critical_frequency": margins.critical_frequency,
    "spectral_abscissa": margins.spectral_abscissa,
}
_STABLE = -1e-9
_VANISHING, _ROUNDING = frozenset({"residual_vibration", "steady_state_error"}), 1e-12
_FAR = 1e4


@dataclass(frozen=True, slots=True, kw_only=True)
class Statement:
    """The value of a goal's metric, infinite for one that is never crossed; ``tolerance`` is how far it may itself be off."""

    value: float
    tolerance: float = 0.0


def witnessed(problem: Problem, values: Mapping[str, float], scenario: Scenario) -> list[Statement | None]:
    """Return the value of every goal that can be measured here, None for the others.

    Linear systems that are stable as a whole, commands that settle (or a limited time); nonlinear systems without delays and
    samplers over a given duration, and without samplers what their linearisation says. A response of very many steps or events, and metrics without
    a reading of their own here, are left to the exact engine alone.

    Parameters
    ----------
    problem : Problem
    values : mapping of str to float
        The variables, SI.
    scenario : mapping of str to float
    """
    nothing: list[Statement | None] = [None] * len(problem.goals)
    tied = problem.tied({axis.parameter: values[axis.parameter] for axis in problem.axes}, scenario)
    overrides = {p: v for p, v in {**scenario, **values, **tied}.items() if p not in problem.commands}
    try:
        experiments = {experiment.name: experiment.signals for experiment in problem.experiments_at(values)}
        system = problem.diagram.realize(overrides)
        runs = Runs(problem.diagram, overrides) if problem.diagram.nonlinear else None
    except EngineError:
        return nothing
    # the linearisation replaces samplers by what is continuous: no second measurement of what is exact with them
    bench = _Bench(problem, overrides, system) if _decays(system) and not problem.diagram.sampled else None
    found: list[Statement | None] = []
    for goal, request in zip(problem.goals, problem.requests, strict=True):
        signals = experiments.get(goal.experiment or "", {}) if request.signals else {}
        try:
            if runs is not None and signals:
                read = runs.measure(request, signals)
            else:
                value = None if bench is None else bench.measure(request, signals)
                read = None if bench is None or value is None else (value, bench.rounding(request))
        except (CannotFollowError, EngineError, ValueError, IndexError, np.linalg.LinAlgError):
            read = None  # beyond what is followed here
        found.append(None if read is None or np.isnan(read[0]) else Statement(value=read[0], tolerance=read[1]))
    return found


def _decays(system: LinearSystem) -> bool:
    """Return whether every mode of the system without its delays decays; with delays the march itself will tell."""
    if len(system.delays):
        return True
    modes = np.linalg.eigvals(system.a)
    return bool((modes.real < _STABLE * np.abs(modes).max(initial=0.0)).all())


class _Bench:
    """Responses and sweeps of one system, each made once."""

    def __init__(self, problem: Problem, overrides: Mapping[str, float], system: LinearSystem) -> None:
        self._diagram = problem.diagram
        self._outputs = sorted({str(r.output) for r in problem.requests if r.output is not None})
        self._overrides = overrides
        self._system = system
        self._sweeps: dict[tuple[object, ...], Sweep] = {}
        self._marches: dict[tuple[object, ...], March] = {}
        self._refused: set[tuple[object, ...]] = set()

    def measure(self, request: MetricRequest, signals: Mapping[str, Signal]) -> float | None:
        """Return the value of a metric, None where it has no reading here."""
        name, mask = request.metric, request.mask
        if name in margins.PEAKS:
            sweep = self._sweep(request)
            return sweep.highest(margins.PEAKS[name])
        if name in margins.BOUNDED and isinstance(mask, FrequencyBounds):
            return margins.ratio(self._sweep(request), margins.BOUNDED[name], mask)
        if name in ("h2_norm", "noise_rms"):
            return self._noise(request)
        if name in _OF_SWEEPS:
            return _OF_SWEEPS[name](self._sweep(request))
        if name in _OF_MODES:
            return (
                None if len(self._system.delays) else _OF_MODES[name](np.linalg.eigvals(self._system.a).astype(complex))
            )
        return self._timed(request, signals) if signals else None

    def rounding(self, request: MetricRequest) -> float:
        """Return what rounding leaves of a value that vanishes where large signals cancel, in the unit of the output."""
        if request.metric not in _VANISHING:
            return 0.0
        column = self._outputs.index(str(request.output))
        return _ROUNDING * max(
            (float(np.abs(m.values[:, :, column]).max()) for m in self._marches.values()), default=0.0
        )

    def _noise(self, request: MetricRequest) -> float | None:
        """Return what a path makes of white noise; None behind delays, whose gain turns without end."""
        density = request.options.noise_density if request.metric == "noise_rms" else 2.0
        if len(self._system.delays) or density is None:
            return None
        return margins.h2_norm(self._sweep(request)) * float(np.sqrt(density / 2))

    def _timed(self, request: MetricRequest, signals: Mapping[str, Signal]) -> float | None:
        """Return the value of a metric of a response, None where the command does not settle or it has no reading here."""
        name = request.metric
        settles = all(signal.final() is not None for signal in signals.values())
        ends = [signal.end() for signal in signals.values()]
        value = None
        if request.mask is not None:
            value = self._held(request, signals, settles=settles)
        elif not request.as_told(self._diagram):
            value = None
        elif name in timing.INTEGRALS:
            reference = signals.get(self._diagram.references.input_of(signals, request.output) or "")
            trace = self._trace(request, signals, request.duration)
            value = timing.error_integral(trace, name, reference, request.duration)
        elif name == "residual_vibration" and settles and None not in ends:
            end = max(float(end or 0.0) for end in ends)
            value = timing.residual_vibration(self._trace(request, signals, None), end)
        elif name == "recovery_time" and settles and request.options.recovery_band is not None:
            loads = max(signal.breakpoints()[0] for signal in signals.values())
            value = timing.recovery_time(self._trace(request, signals, None), request.options.recovery_band, loads)
        elif request.windowed:
            assert request.duration is not None
            if name != "peak_time":
                value = timing.peak_within(self._trace(request, signals, request.duration), request.duration)
        elif name in READINGS and settles:
            trace = self._trace(request, signals, None)
            value = READINGS[name](trace) if request.usual else timing.last_entry(trace, request.options.settling_band)
        return value

    def _held(self, request: MetricRequest, signals: Mapping[str, Signal], *, settles: bool) -> float | None:
        """Return how a response stands to what it is held against."""
        mask = request.mask
        if isinstance(mask, Envelope):
            end = max(line.times[-1] for line, _ in mask.sides)
            return timing.envelope(self._trace(request, signals, None if settles else end), mask)
        if isinstance(mask, Polyline):
            return timing.tracking_error(self._trace(request, signals, None if settles else mask.times[-1]), mask)
        return None

    def _sweep(self, request: MetricRequest) -> Sweep:
        if request.opened_besides:  # whether the loop that is left is stable is not looked at here
            raise CannotFollowError
        key = (request.open_at, request.source, request.target)
        if key not in self._sweeps:
            if request.open_at is not None:
                opened = self._diagram.realize(self._overrides, request.open_at)
                self._sweeps[key] = Sweep(opened, len(opened.inputs) - 1, len(opened.outputs) - 1, sign=-1.0)
            else:
                source = self._system.inputs.index(str(request.source))
                target = self._system.outputs.index(str(request.target))
                self._sweeps[key] = Sweep(self._system, source, target)
        return self._sweeps[key]

    def _trace(self, request: MetricRequest, signals: Mapping[str, Signal], until: float | None) -> Trace:
        """Return one output; all that some goal looks at are followed together."""
        key = (until, *((port, id(signal)) for port, signal in signals.items()))
        if key in self._refused:
            raise CannotFollowError
        if key not in self._marches:
            self._refused.add(key)
            commands = [(self._system.inputs.index(port), signal) for port, signal in signals.items()]
            columns = [self._system.outputs.index(output) for output in self._outputs]
            self._marches[key] = Marcher(self._system, commands, columns).run(until)
            self._refused.discard(key)
        output = self._system.outputs.index(str(request.output))
        initial = float(self._system.c1[output] @ self._system.x0)
        begin = min((t for signal in signals.values() for t in signal.breakpoints()), default=0.0)
        return Trace.of(self._marches[key], self._outputs.index(str(request.output)), initial=initial, begin=begin)
