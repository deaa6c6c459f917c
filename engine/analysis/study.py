"""What users ask of a system: curves with their metrics over time, and what :mod:`engine.analysis.frequency_study` has; the exact path.

Everything shown to a user comes from here and from :mod:`engine.analysis.measuring`; the batched screening only searches.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.analysis.evaluation import LARGEST, Evaluation, TimeResponse
from engine.analysis.frequency_study import FrequencyStudy, Margins, frequency_response
from engine.analysis.limit_cycles import LimitCycle, observed, predicted
from engine.analysis.measuring import (
    Gradient,
    MetricRequest,
    command_of,
    find,
    measure,
    measured_of,
    metric_named,
    named_unit,
    unit_of,
)
from engine.exact.frequency.nyquist import NyquistCount
from engine.exact.frequency.path import path
from engine.exact.frequency.poles import Poles
from engine.exact.time.trajectory import respond
from engine.metrics import catalogue
from engine.metrics._base import TimeMetric
from engine.model.document import Remark
from engine.model.errors import UnresolvedError
from engine.model.failures import numerical
from engine.model.metric_options import USUAL, Options
from engine.model.verdicts import Measured, Verdict

if TYPE_CHECKING:
    from engine.diagram.diagram import Diagram
    from engine.exact.nonlinear.response import Response
    from engine.exact.time.curve import Curve
    from engine.signals import Signal

Real = npt.NDArray[np.float64]

_ROUGH = 1e-9
"""A curve that is known to no better than this part of its largest value is spoken of."""
_ELSEWHERE = 8.0
"""Times what rounding leaves at rest, where it is seen: while a system moves it may leave more, by the processor's arithmetic."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Simulation:
    """Curves and metrics of one experiment; curves beyond 1e100 are NaN."""

    time: Real
    curves: Mapping[str, Real]
    metrics: Mapping[str, Mapping[str, Measured]]
    verdict: Verdict
    warnings: tuple[Remark, ...]
    error: float | None = None
    """Estimated error of the curves relative to their largest values; None for the exact response of a linear system."""
    limit_cycle: LimitCycle | None = None
    """What a nonlinear response swings in for ever after its commands have settled."""


@numerical()
def simulate(
    diagram: Diagram,
    *,
    signals: Mapping[str, Signal],
    overrides: Mapping[str, float] | None = None,
    outputs: Sequence[str] | None = None,
    duration: float | None = None,
    samples: int = 1000,
    metrics: Sequence[str] | None = None,
    band: tuple[float, float] | None = None,
    options: Options = USUAL,
) -> Simulation:
    """Return sampled curves, and metrics of the continuous response (they do not depend on ``samples``).

    Parameters
    ----------
    diagram : Diagram
    signals : mapping of input name to Signal
        Inputs left out are 0.
    overrides : mapping, optional
        Parameter values, SI.
    outputs : sequence of str, optional
        All by default.
    duration : float, optional
        End of the curves, s; chosen from the response when absent. Integrals are then taken to infinity.
    samples : int
        Points of the curves, both ends included.
    metrics : sequence of str, optional
        Time metrics; by default all that have a value or a telling verdict for each output.
    band : (low, high), optional
        What a metric of the spectrum looks at, rad/s.
    options : Options, optional
        Numbers that some metrics take.
    """
    names = tuple(diagram.outputs if outputs is None else outputs)
    evaluation = Evaluation(diagram, overrides)
    if diagram.nonlinear:
        return _simulate_nonlinear(
            evaluation, signals, names, duration=duration, samples=samples, metrics=metrics, band=band, options=options
        )
    response = evaluation.response_within(signals, names, duration)
    length = duration if duration is not None else _length(evaluation, signals, names)
    time = np.linspace(0.0, length, samples)
    curves = _curves(response, evaluation, signals, names, time)
    found = _metrics(evaluation, signals, names, duration=duration, metrics=metrics, band=band, options=options)
    remarks = (*diagram.warnings, *_hidden(response.hidden), *_rough(evaluation, signals, names, duration))
    return Simulation(time=time, curves=curves, metrics=found, verdict=evaluation.poles.verdict, warnings=remarks)


def _metrics(
    evaluation: Evaluation,
    signals: Mapping[str, Signal],
    names: Sequence[str],
    *,
    duration: float | None,
    metrics: Sequence[str] | None,
    band: tuple[float, float] | None,
    options: Options,
) -> dict[str, dict[str, Measured]]:
    """Return the metrics of every output; by default those that have a value or a telling verdict."""
    diagram = evaluation.diagram
    found: dict[str, dict[str, Measured]] = {}
    for name in names:
        wanted = _fitting(named_unit(diagram, name)) if metrics is None else metrics
        requests = [
            MetricRequest(metric=m, signals=signals, output=name, duration=duration, band=band, options=options)
            for m in wanted
        ]
        together = {command_of(r): names for r in requests}
        found[name] = {r.metric: measured_of(diagram, r, find(evaluation, r, together)) for r in requests}
        if metrics is None:
            found[name] = {m: v for m, v in found[name].items() if v.verdict is not Verdict.NOT_APPLICABLE}
    return found


def _simulate_nonlinear(
    evaluation: Evaluation,
    signals: Mapping[str, Signal],
    names: Sequence[str],
    *,
    duration: float | None,
    samples: int,
    metrics: Sequence[str] | None,
    band: tuple[float, float] | None,
    options: Options,
) -> Simulation:
    """Return curves and metrics of a system with nonlinear blocks; curves are NaN beyond where it could be followed."""
    for name in names:
        evaluation.output_index(name)
    response = evaluation.simulated(signals, duration)
    length = duration
    if length is None:
        last = max(
            (t for signal in signals.values() for t in (*signal.breakpoints(), signal.end() or 0.0)), default=0.0
        )
        periods = max((signal.repeats_after() or 0.0 for signal in signals.values()), default=0.0)
        ends = [last + 5 * periods] + [_moves_until(response.output(name), last) for name in names if not periods]
        longest = max(ends)
        length = min(_rounded(longest) if longest > 0 else 1.0, response.outcome.end)
    time = np.linspace(0.0, length, samples)
    curves = {name: np.clip(response.sample(name, time), *response.limits(name)) for name in names}
    for values in curves.values():
        values[(time > response.outcome.end * (1 + 1e-12)) | ~(np.abs(values) <= LARGEST)] = np.nan
    outcome = response.outcome
    verdict = outcome.verdict
    if verdict is Verdict.OK and not response.settled and duration is None:
        verdict = Verdict.NOT_SETTLED
    advice = [outcome.advice] if outcome.advice else []
    if verdict is not Verdict.ILL_POSED and _runs_away(evaluation):
        alone = evaluation.diagram.sampled_alone
        verdict = Verdict.UNSTABLE if alone and verdict is Verdict.OK else verdict
        advice.append(
            "the sampled loop is unstable about its operating point"
            + ("" if alone else ": what is not linear bounds it")
        )
    cycle = _limit_cycle(evaluation, response, signals, names)
    if cycle is not None:
        advice.append(f"the response does not settle: it ends in a limit cycle of {cycle.frequency:.6g} rad/s")
    return Simulation(
        time=time,
        curves=curves,
        metrics=_metrics(evaluation, signals, names, duration=duration, metrics=metrics, band=band, options=options),
        verdict=verdict,
        warnings=(*evaluation.diagram.warnings, *(Remark(at=("blocks",), detail=detail) for detail in advice)),
        error=outcome.error,
        limit_cycle=cycle,
    )


def _runs_away(evaluation: Evaluation) -> bool:
    """Return whether a loop with samplers is unstable, as far as that is known."""
    if not evaluation.diagram.sampled:
        return False
    try:
        return evaluation.poles.verdict is Verdict.UNSTABLE
    except UnresolvedError:
        return False


def _limit_cycle(
    evaluation: Evaluation, response: Response, signals: Mapping[str, Signal], names: Sequence[str]
) -> LimitCycle | None:
    """Return the limit cycle in which a response to commands that settle ends, None where it does not."""
    if response.settled or any(signal.final() is None for signal in signals.values()):
        return None
    last = max((t for s in signals.values() for t in (*s.breakpoints(), s.end() or 0.0)), default=0.0)
    found = observed(response, names, last)
    if found is None:
        return None
    frequency, outputs = found
    predictions = predicted(evaluation.diagram, evaluation.overrides)
    return LimitCycle(frequency=frequency, outputs=outputs, predictions=predictions)


def _moves_until(curve: Curve, last: float) -> float:
    """Return how much of a curve is worth looking at, s."""
    values = curve.values[:, :, 0].real
    rest = np.abs(values - values[-1, -1]).max(axis=1)
    moving = np.flatnonzero(rest > 0.005 * max(float(np.ptp(values)), 1e-300))
    return 1.25 * (float(curve.times[moving[-1] + 1]) - last) + last if len(moving) else last


def _fitting(unit: str) -> tuple[str, ...]:
    """Return the time metrics that make sense for an output of this unit ("1": unknown, any)."""
    kinds = [metric for metric in catalogue().values() if issubclass(metric, TimeMetric)]
    return tuple(metric.kind for metric in kinds if unit == "1" or not metric.belongs_to or unit in metric.belongs_to)


def _hidden(names: Sequence[str]) -> tuple[Remark, ...]:
    return tuple(
        Remark(
            at=("outputs", name),
            detail=f"output {name} settles, but the system has modes that do not decay and are not seen there",
        )
        for name in names
    )


def _rough(
    evaluation: Evaluation, signals: Mapping[str, Signal], names: Sequence[str], duration: float | None
) -> tuple[Remark, ...]:
    """Return what is to be said of outputs and errors that are small differences of large signals."""
    found: list[Remark] = []
    response = evaluation.response_within(signals, names, duration)
    for name, left in response.left.items():
        assert response.joint is not None
        own = response.joint.output(response.columns[name])
        error = evaluation.time_subject(signals, name, duration, names).error
        for what, curve in (("output", own), ("the error of output", error)):
            largest = 0.0 if curve is None else float(np.abs(curve.values[:, :, 0].real).max())
            if left > _ROUGH * largest > 0:
                part = f"rounding leaves {_ELSEWHERE * left / largest:.2g} of its largest value"
                detail = f"{what} {name} is a small difference of large signals, or its time constants lie too far apart: {part}, so that it and its metrics are known no better"
                found.append(Remark(at=("outputs", name), detail=detail))
                break
    return tuple(found)


def _length(evaluation: Evaluation, signals: Mapping[str, Signal], names: Sequence[str]) -> float:
    """Return how much of the response is worth looking at, s."""
    response = evaluation.time_response(signals, names)
    last = max((t for signal in signals.values() for t in (*signal.breakpoints(), signal.end() or 0.0)), default=0.0)
    periods = max((signal.repeats_after() or 0.0 for signal in signals.values()), default=0.0)
    ends = [last + 5 * periods]
    if response.joint is not None:
        y = response.joint.y[:, :, 0].real
        edges = response.joint.edges[:, 0].real
        for column in range(y.shape[2]):
            values = y[:, :, column]
            rest = np.abs(values - values[-1, -1]).max(axis=1)
            moving = np.flatnonzero(rest > 0.005 * max(float(np.ptp(values)), 1e-300))
            if len(moving) and not periods:
                ends.append(1.25 * (float(edges[moving[-1] + 1]) - last) + last)
    if response.joint is None or len(response.columns) < len(names):
        ends.append(last + _pace(evaluation.poles, float(evaluation.system.delays[0].real.sum())))
    length = max(ends)
    return _rounded(length) if length > 0 else 1.0


def _pace(found: Poles, delays: float) -> float:
    """Return a telling length for a response that does not settle: growth by 1000, or ten times the slowest mode.

    Of one that swings 30 periods are enough, however slowly it grows: more are a band of ink that takes minutes.
    """
    if found.neutral:
        return 20 * delays
    growing = found.values[(found.values.real > 0) & ~found.on_axis & ~found.at_zero]
    if len(growing):
        fastest = growing[growing.real.argmax()]
        periods = 30 * 2 * np.pi / abs(fastest.imag) if fastest.imag else np.inf
        return float(min(np.log(1e3) / fastest.real, periods))
    swinging = np.abs(found.values.imag[found.on_axis & ~found.at_zero])
    if len(swinging) and swinging.max() > 0:
        return float(10 * 2 * np.pi / swinging.max())
    return 10.0 / found.slowest if np.isfinite(found.slowest) else 1.0


def _rounded(length: float) -> float:
    """Round up to two digits, so that axes and sample times are readable."""
    unit = 10.0 ** (np.floor(np.log10(length)) - 1)
    return float(np.ceil(length / unit * (1 - 1e-12)) * unit)


def _curves(
    response: TimeResponse, evaluation: Evaluation, signals: Mapping[str, Signal], names: Sequence[str], time: Real
) -> dict[str, Real]:
    curves: dict[str, Real] = {}
    rest = [name for name in names if name not in response.columns]
    if response.joint is not None:
        curves = {name: response.joint.output(k).sample(time) for name, k in response.columns.items()}
        late = time > response.joint.edges[-1, 0].real
        if late.any():
            rest += list(response.columns)
            curves = {}
    if rest:
        inputs = [evaluation.input_index(name) for name in signals]
        part = path(evaluation.system, inputs, [evaluation.output_index(name) for name in rest])
        fastest = max(float(evaluation.poles.values.real.max(initial=0.0)), 0.0)
        seen = time[-1] if fastest == 0 else min(float(time[-1]), float(np.log(LARGEST)) / fastest)
        trajectory = respond(part.value, list(signals.values()), max(seen, 1e-300))
        for k, name in enumerate(rest):
            values = trajectory.output(k).sample(time)
            values[(time > seen) | ~(np.abs(values) <= LARGEST)] = np.nan
            curves[name] = values
    return {name: curves[name] for name in names}


__all__ = [
    "FrequencyStudy",
    "Gradient",
    "Margins",
    "MetricRequest",
    "NyquistCount",
    "Simulation",
    "frequency_response",
    "measure",
    "metric_named",
    "simulate",
    "unit_of",
]
