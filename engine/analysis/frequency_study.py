"""What users ask of a system over frequency: a path or an open loop with its metrics and margins; the exact path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.analysis.evaluation import Evaluation
from engine.analysis.frequency_range import shown
from engine.analysis.limit_cycles import PredictedCycle, predicted
from engine.analysis.measuring import MetricRequest, find, measured_of, metric_named
from engine.exact.frequency.nyquist import NyquistCount, listed_to, nyquist_count
from engine.exact.frequency.response import FrequencyResponse
from engine.exact.frequency.zeros import zeros
from engine.exact.sampled_data.response import SampledResponse
from engine.metrics import catalogue
from engine.metrics._base import LoopMetric, LoopSubject, PathMetric, PathSubject, SystemMetric
from engine.metrics._loop import Crossing, delay_margins, gain_margins, phase_margins
from engine.model.document import Remark
from engine.model.errors import DiagramError, UnresolvedError
from engine.model.failures import numerical
from engine.model.metric_options import USUAL, Options
from engine.model.verdicts import Measured, Verdict

if TYPE_CHECKING:
    from engine.diagram.connections import Opening
    from engine.diagram.diagram import Diagram
    from engine.exact.frequency.poles import Poles
    from engine.model.linear_system import Array

Real = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Margins:
    """Every crossing of the loop where |L| is ``smallest_loop_gain`` or more: (frequency in rad/s, margin)."""

    smallest_loop_gain: float
    gain: tuple[tuple[float, float], ...]
    phase: tuple[tuple[float, float], ...]
    delay: tuple[tuple[float, float], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class PathStudy:
    """The response of one path with its metrics and zeros; ``zeros`` is None where they have no end."""

    source: str
    target: str
    frequency: Real
    response: npt.NDArray[np.complex128]
    phase: Real
    metrics: Mapping[str, Measured]
    zeros: npt.NDArray[np.complex128] | None
    unbounded: tuple[Unbounded, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyStudy:
    """A frequency response with its metrics; ``margins`` only for an open loop, and ``nyquist`` where it can be counted.

    Where a frequency meets a pole there is no response: NaN, and ``unbounded`` says why.
    Of a nonlinear system it is that of its linearisation at the ``operating_point``; where its loop is opened,
    ``limit_cycles`` are those that describing functions predict.
    """

    frequency: Real
    response: npt.NDArray[np.complex128]
    phase: Real
    metrics: Mapping[str, Measured]
    margins: Margins | None
    nyquist: NyquistCount | None
    poles: npt.NDArray[np.complex128]
    zeros: npt.NDArray[np.complex128] | None
    verdict: Verdict
    warnings: tuple[Remark, ...]
    operating_point: Rest | None = None
    limit_cycles: tuple[PredictedCycle, ...] = ()
    unbounded: tuple[Unbounded, ...] = ()
    paths: tuple[PathStudy, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Unbounded:
    """A frequency (rad/s) at which a response has no value, since it meets a pole."""

    frequency: float
    verdict: Verdict
    advice: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Rest:
    """Where a nonlinear system is linearised: constant inputs, the outputs there; ``rests`` is False where nothing rests.

    The slopes are then those of the initial state.
    """

    inputs: Mapping[str, float]
    outputs: Mapping[str, float]
    rests: bool


PATH_METRICS = tuple(
    name
    for name, metric in catalogue().items()
    if issubclass(metric, PathMetric) and not metric.mask and metric.by_default
)
LOOP_METRICS = tuple(name for name, metric in catalogue().items() if issubclass(metric, LoopMetric) and not metric.mask)
SYSTEM_METRICS = tuple(name for name, metric in catalogue().items() if issubclass(metric, SystemMetric))


@numerical()
def frequency_response(
    diagram: Diagram,
    *,
    overrides: Mapping[str, float] | None = None,
    source: str | None = None,
    target: str | None = None,
    open_at: Opening | None = None,
    frequencies: Real | None = None,
    metrics: Sequence[str] | None = None,
    options: Options = USUAL,
    paths: Sequence[tuple[str, str]] = (),
) -> FrequencyStudy:
    """Return the response of a path, or of the open loop at ``open_at``, with its metrics.

    Parameters
    ----------
    diagram : Diagram
    overrides : mapping, optional
        Parameter values, SI.
    source, target : str, optional
        An input and an output.
    open_at : str or tuple of str, optional
        Where the loop is cut; the curve is then L, with 1 + L = 0 the characteristic equation. Of several places opened
        together it is cut at the first.
    frequencies : ndarray, optional
        rad/s, rising, >= 0; chosen from poles, zeros and crossings when absent.
    metrics : sequence of str, optional
        By default those of the path, the loop and the poles that apply.
    options : Options, optional
        Numbers that some metrics take.
    paths : sequence of (input, output), optional
        Further paths that are wanted, each with its own metrics.

    Raises
    ------
    DiagramError
        When neither a path nor a loop is named, or a name is unknown.
    """
    if open_at is None and (source is None or target is None):
        raise DiagramError("a frequency response must have 'from' and 'to', or 'open_at', got neither")
    evaluation = Evaluation(diagram, overrides)
    rest, remarks = _rest(diagram, overrides) if diagram.nonlinear else (None, ())
    subject: LoopSubject | PathSubject
    margins = nyquist = None
    if open_at is not None:
        subject = evaluation.loop(open_at)
        margins, nyquist, doubts = _opened(subject, open_at)
        remarks = (*remarks, *doubts)
    else:
        subject = evaluation.path(str(source), str(target))
    curve, own = subject.response, subject.opened if isinstance(subject, LoopSubject) else subject.own
    listed = margins.gain if margins is not None else ()
    chosen = shown(curve, listed) if frequencies is None else np.asarray(frequencies, dtype=float)
    response, unbounded = _defined(curve, chosen, subject.static, own)
    wanted = metrics
    if wanted is None:
        known = (*(PATH_METRICS if source and target else ()), *(LOOP_METRICS if open_at else ()), *SYSTEM_METRICS)
        wanted = _wanted(known, options)
    requests = [MetricRequest(metric=m, source=source, target=target, open_at=open_at, options=options) for m in wanted]
    found = {r.metric: measured_of(diagram, r, find(evaluation, r, {})) for r in requests}
    return FrequencyStudy(
        frequency=chosen,
        response=response,
        phase=_unwrapped(*curve.scan, chosen, response),
        metrics=found,
        margins=margins,
        nyquist=nyquist,
        poles=evaluation.poles.values,
        zeros=None if isinstance(curve, SampledResponse) else zeros(curve.system),
        verdict=evaluation.poles.verdict,
        warnings=(*diagram.warnings, *remarks, *diagram.analysis),
        operating_point=rest,
        limit_cycles=predicted(diagram, overrides) if diagram.nonlinear and open_at is not None else (),
        unbounded=unbounded,
        paths=tuple(_path_study(evaluation, ends, frequencies, metrics, options) for ends in paths),
    )


def _opened(loop: LoopSubject, open_at: Opening) -> tuple[Margins, NyquistCount | None, tuple[Remark, ...]]:
    """Return margins, encirclements and what is doubtful about a loop that is cut."""
    curve = loop.response
    if isinstance(curve, SampledResponse):
        # its encirclements are those of another curve, and its crossings end at a frequency
        margins, doubts = _sampled_margins(loop, open_at)
        return margins, None, doubts
    nyquist = nyquist_count(curve, loop.opened, loop.closed)
    doubts = _doubts(open_at, listed_to(curve), nyquist, loop.verdict)
    return _margins(loop), nyquist, (*_without_loop(open_at, curve), *doubts)


def _margins(loop: LoopSubject) -> Margins:
    gains, smallest = gain_margins(loop.response, loop.static)
    return Margins(
        smallest_loop_gain=smallest,
        gain=_listed(gains),
        phase=_listed(phase_margins(loop.response)),
        delay=_listed(delay_margins(loop.response, loop.verdict)),
    )


def _sampled_margins(loop: LoopSubject, open_at: Opening) -> tuple[Margins, tuple[Remark, ...]]:
    """Return the margins of a loop with samplers, and what is not known of them."""
    gains, smallest = gain_margins(loop.response, loop.static)
    delays: list[Crossing] = []
    doubts: tuple[Remark, ...] = ()
    try:
        delays = delay_margins(loop.response, loop.verdict)
    except UnresolvedError as error:
        places = (open_at,) if isinstance(open_at, str) else open_at
        doubts = (Remark(at=("open_at", *places), detail=error.message),)
    found = Margins(
        smallest_loop_gain=smallest,
        gain=_listed(gains),
        phase=_listed(phase_margins(loop.response)),
        delay=_listed(delays),
    )
    return found, doubts


def _path_study(
    evaluation: Evaluation,
    ends: tuple[str, str],
    frequencies: Real | None,
    metrics: Sequence[str] | None,
    options: Options,
) -> PathStudy:
    source, target = ends
    path = evaluation.path(source, target)
    curve = path.response
    chosen = shown(curve, ()) if frequencies is None else np.asarray(frequencies, dtype=float)
    response, unbounded = _defined(curve, chosen, path.static, path.own)
    wanted = _wanted(PATH_METRICS, options) if metrics is None else metrics
    requests = [
        MetricRequest(metric=m, source=source, target=target, options=options)
        for m in wanted
        if issubclass(metric_named(m), PathMetric)
    ]
    return PathStudy(
        source=source,
        target=target,
        frequency=chosen,
        response=response,
        phase=_unwrapped(*curve.scan, chosen, response),
        metrics={r.metric: measured_of(evaluation.diagram, r, find(evaluation, r, {})) for r in requests},
        zeros=None if isinstance(curve, SampledResponse) else zeros(curve.system),
        unbounded=unbounded,
    )


def _wanted(names: Sequence[str], options: Options) -> tuple[str, ...]:
    """Return those metrics that are shown by default: one that takes a number is where that is given."""
    return tuple(name for name in names if not options.lacking(catalogue()[name].options))


def _rest(diagram: Diagram, overrides: Mapping[str, float] | None) -> tuple[Rest, tuple[Remark, ...]]:
    """Return where a nonlinear system is linearised, and what to say where it does not rest."""
    point = diagram.operating_point(overrides)
    rest = Rest(
        inputs={name: float(value) for name, value in zip(diagram.inputs, point.inputs, strict=True)},
        outputs={name: float(value) for name, value in zip(diagram.outputs, point.y[0].real, strict=True)},
        rests=point.rests,
    )
    detail = "no state of rest is found: the system is linearised about its initial state"
    return rest, () if point.rests else (Remark(at=("blocks",), detail=detail),)


def _without_loop(open_at: Opening, curve: FrequencyResponse) -> tuple[Remark, ...]:
    """Say where the place at which the loop is cut lies on none: its gain is 0, whatever the margins say."""
    system = curve.system
    if system.n or system.m or np.any(system.d11):
        return ()
    place = open_at if isinstance(open_at, str) else open_at[0]
    detail = f"no loop runs through {place}: its loop gain is 0 at all frequencies, so that margins say nothing"
    return (Remark(at=("open_at", place), detail=detail),)


def _doubts(open_at: Opening, last: float | None, count: NyquistCount | None, verdict: Verdict) -> tuple[Remark, ...]:
    """Return what a reader of the margins must know besides."""
    details = []
    if last is not None:
        details.append(
            f"the crossings of this loop have no end, or are too many to follow: listed up to {last:.3g} rad/s"
        )
    if count is not None and (count.closed_loop > 0) != (verdict is Verdict.UNSTABLE):
        details.append(
            f"the Nyquist criterion counts {count.closed_loop} unstable poles of the closed loop, but its poles say "
            f"'{verdict}': do not rely on either"
        )
    places = (open_at,) if isinstance(open_at, str) else open_at
    return tuple(Remark(at=("open_at", *places), detail=detail) for detail in details)


def _defined(
    curve: FrequencyResponse, frequencies: Real, static: Array | None, own: Poles
) -> tuple[npt.NDArray[np.complex128], tuple[Unbounded, ...]]:
    """Return the response, at rest the gain there, and where it has none; NaN there."""
    response = np.array(curve(frequencies), dtype=complex)
    if static is not None:
        response[frequencies == 0] = static[0].real
    axis = own.on_axis | own.at_zero
    distance = np.abs(1j * frequencies[:, None] - own.values[axis])
    met = ~np.isfinite(response) | (distance <= own.uncertainty[axis]).any(axis=1)
    met[frequencies == 0] = static is None
    response[met] = complex(np.nan, np.nan)
    if isinstance(curve, SampledResponse):
        return response, tuple(_unsampled(float(frequency), curve.nyquist) for frequency in frequencies[met])
    return response, tuple(
        Unbounded(
            frequency=float(frequency),
            verdict=Verdict.MARGINAL if frequency else Verdict.INTEGRATING,
            advice=f"there is a pole at {frequency:g} rad/s: ask beside it",
        )
        for frequency in frequencies[met]
    )


def _unsampled(frequency: float, nyquist: float) -> Unbounded:
    """Return why a sampled system has no response at a frequency."""
    if frequency > nyquist:
        advice = f"the samples are too far apart for {frequency:g} rad/s: beyond {nyquist:g} rad/s they show an alias"
        return Unbounded(frequency=frequency, verdict=Verdict.NOT_APPLICABLE, advice=advice)
    verdict = Verdict.MARGINAL if frequency else Verdict.INTEGRATING
    return Unbounded(
        frequency=frequency, verdict=verdict, advice=f"there is a pole at {frequency:g} rad/s: ask beside it"
    )


def _unwrapped(
    scan: Real, values: npt.NDArray[np.complex128], chosen: Real, response: npt.NDArray[np.complex128]
) -> Real:
    """Return the phase at the chosen frequencies, unwrapped along the scan, which is fine enough for it.

    NaN where there is no response, or nothing of it: 0 has no phase.
    """
    everything, known = np.concatenate([scan, chosen]), np.concatenate([values, response])
    order = np.argsort(everything, kind="stable")
    order = order[np.isfinite(known[order]) & (known[order] != 0)]
    phase = np.full(len(everything), np.nan)
    phase[order] = np.unwrap(np.angle(known[order]))
    # At rest a negative gain is as well -π as π: the scan says which turn is meant, whatever is asked besides.
    first = next((k for k in order if k < len(scan)), None)
    turn = 0.0 if first is None else np.angle(known[first]) - phase[first]
    return np.asarray(phase[len(scan) :] + turn)


def _listed(
    crossings: Sequence[tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]],
) -> tuple[tuple[float, float], ...]:
    found = ((float(frequency[0].real), float(value[0].real)) for frequency, value in crossings)
    return tuple(one for one in found if np.isfinite(one[0]))
