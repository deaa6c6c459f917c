"""What users ask of a system over frequency: a path or an open loop with its metrics and margins; the exact path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.document import Remark
from engine.errors import DiagramError
from engine.evaluation import Evaluation
from engine.frequency_range import shown
from engine.limit_cycles import PredictedCycle, predicted
from engine.linear.frequency import SMALLEST_LOOP_GAIN
from engine.linear.nyquist import NyquistCount, listed_to, nyquist_count
from engine.measuring import MetricRequest, find, measured_of
from engine.metrics import catalogue
from engine.metrics._base import LoopMetric, PathMetric, SystemMetric
from engine.metrics._loop import delay_margins, gain_margins, phase_margins
from engine.verdicts import Measured, Verdict

if TYPE_CHECKING:
    from engine.diagram import Diagram

Real = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Margins:
    """Every crossing of the loop where |L| is ``smallest_loop_gain`` or more: (frequency in rad/s, margin)."""

    smallest_loop_gain: float
    gain: tuple[tuple[float, float], ...]
    phase: tuple[tuple[float, float], ...]
    delay: tuple[tuple[float, float], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyStudy:
    """A frequency response with its metrics; ``margins`` only for an open loop, and ``nyquist`` where it can be counted.

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
    verdict: Verdict
    warnings: tuple[Remark, ...]
    operating_point: Rest | None = None
    limit_cycles: tuple[PredictedCycle, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Rest:
    """Where a nonlinear system is linearised: constant inputs, the outputs there; ``rests`` is False where nothing rests.

    The slopes are then those of the initial state.
    """

    inputs: Mapping[str, float]
    outputs: Mapping[str, float]
    rests: bool


PATH_METRICS = tuple(name for name, metric in catalogue().items() if issubclass(metric, PathMetric) and not metric.mask)
LOOP_METRICS = tuple(name for name, metric in catalogue().items() if issubclass(metric, LoopMetric) and not metric.mask)
SYSTEM_METRICS = tuple(name for name, metric in catalogue().items() if issubclass(metric, SystemMetric))


def frequency_response(
    diagram: Diagram,
    *,
    overrides: Mapping[str, float] | None = None,
    source: str | None = None,
    target: str | None = None,
    open_at: str | None = None,
    frequencies: Real | None = None,
    metrics: Sequence[str] | None = None,
) -> FrequencyStudy:
    """Return the response of a path, or of the open loop at ``open_at``, with its metrics.

    Parameters
    ----------
    diagram : Diagram
    overrides : mapping, optional
        Parameter values, SI.
    source, target : str, optional
        An input and an output.
    open_at : str, optional
        Where the loop is cut; the curve is then L, with 1 + L = 0 the characteristic equation.
    frequencies : ndarray, optional
        rad/s, rising, > 0; chosen from poles, zeros and crossings when absent.
    metrics : sequence of str, optional
        By default those of the path, the loop and the poles that apply.

    Raises
    ------
    DiagramError
        When neither a path nor a loop is named, or a name is unknown.
    """
    if open_at is None and (source is None or target is None):
        msg = "a frequency response must have 'from' and 'to', or 'open_at', got neither"
        raise DiagramError(msg)
    evaluation = Evaluation(diagram, overrides)
    margins = nyquist = rest = None
    remarks = diagram.warnings
    if diagram.nonlinear:
        rest, doubts = _rest(diagram, overrides)
        remarks = (*remarks, *doubts)
    if open_at is not None:
        loop = evaluation.loop(open_at)
        curve = loop.response
        nyquist = nyquist_count(curve, loop.opened, loop.closed)
        remarks = (*remarks, *_doubts(open_at, listed_to(curve), nyquist, loop.verdict))
        margins = Margins(
            smallest_loop_gain=SMALLEST_LOOP_GAIN,
            gain=_listed(gain_margins(curve, loop.static)),
            phase=_listed(phase_margins(curve)),
            delay=_listed(delay_margins(curve)),
        )
    else:
        assert source is not None
        assert target is not None
        curve = evaluation.path(source, target).response
    scan, values = curve.scan
    listed = margins.gain if margins is not None else ()
    chosen = shown(curve, listed) if frequencies is None else np.asarray(frequencies, dtype=float)
    response = curve(chosen)
    phase = _unwrapped(scan, values, chosen, response)
    wanted = metrics
    if wanted is None:
        wanted = (*((PATH_METRICS) if source and target else ()), *(LOOP_METRICS if open_at else ()), *SYSTEM_METRICS)
    requests = [MetricRequest(metric=m, source=source, target=target, open_at=open_at) for m in wanted]
    found = {r.metric: measured_of(diagram, r, find(evaluation, r, {})) for r in requests}
    return FrequencyStudy(
        frequency=chosen,
        response=response,
        phase=phase,
        metrics=found,
        margins=margins,
        nyquist=nyquist,
        poles=evaluation.poles.values,
        verdict=evaluation.poles.verdict,
        warnings=(*remarks, *diagram.linearization),
        operating_point=rest,
        limit_cycles=predicted(diagram, overrides) if diagram.nonlinear and open_at is not None else (),
    )


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


def _doubts(open_at: str, last: float | None, count: NyquistCount | None, verdict: Verdict) -> tuple[Remark, ...]:
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
    return tuple(Remark(at=("open_at", open_at), detail=detail) for detail in details)


def _unwrapped(
    scan: Real, values: npt.NDArray[np.complex128], chosen: Real, response: npt.NDArray[np.complex128]
) -> Real:
    """Return the phase at the chosen frequencies, unwrapped along the scan, which is fine enough for it."""
    everything = np.concatenate([scan, chosen])
    order = np.argsort(everything, kind="stable")
    with np.errstate(invalid="ignore"):
        angles = np.unwrap(np.angle(np.concatenate([values, response])[order]))
    phase = np.empty_like(angles)
    phase[order] = angles
    return np.asarray(phase[len(scan) :])


def _listed(
    crossings: Sequence[tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]],
) -> tuple[tuple[float, float], ...]:
    return tuple((float(frequency[0].real), float(value[0].real)) for frequency, value in crossings)
