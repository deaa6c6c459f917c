"""Metrics of a diagram on the exact path, with their derivatives: one request, one number or the word why there is none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from engine.analysis.derivatives import order_of
from engine.analysis.derivatives import unit_of as derived_unit
from engine.analysis.evaluation import Evaluation
from engine.metrics import Absent, Finding, Found, catalogue
from engine.metrics import _window as window
from engine.metrics._base import LoopMetric, PathMetric, SystemMetric, TimeMetric, TimeSubject, unsettled
from engine.model.errors import DiagramError, IllPosedError, UnresolvedError
from engine.model.failures import numerical
from engine.model.metric_options import MEANINGS, USUAL, USUAL_BAND, Options
from engine.model.verdicts import Measured, Verdict

if TYPE_CHECKING:
    from engine.analysis.commanded import CommandParameter
    from engine.diagram.connections import Opening
    from engine.diagram.diagram import Diagram
    from engine.metrics import Metric
    from engine.model.masks import Mask
    from engine.signals import Signal

Real = npt.NDArray[np.float64]


_JUMPS = (
    "a turning point just touches a level that this value is read at, or two are as high: a small change makes it jump"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class MetricRequest:
    """One metric of one experiment.

    ``signals`` and ``output`` serve time metrics, ``source`` and ``target`` path metrics, ``open_at`` loop metrics; poles
    need none. ``duration`` limits integrals, s (None: infinity); ``band`` is what a metric of the spectrum looks at, rad/s;
    ``mask`` is what a whole curve is held against; ``options`` are the numbers that some metrics take; ``unsettled`` says whether a
    value will do that a window has of an output which has not settled in it.
    """

    metric: str
    signals: Mapping[str, Signal] = field(default_factory=dict)
    output: str | None = None
    source: str | None = None
    target: str | None = None
    open_at: Opening | None = None
    duration: float | None = None
    band: tuple[float, float] | None = None
    mask: Mask | None = None
    options: Options = USUAL
    unsettled: bool = True

    def __post_init__(self) -> None:
        if self.band is not None and not 0 <= self.band[0] < self.band[1] < np.inf:
            low, high = self.band
            raise DiagramError(
                f"band must be [low, high] with 0 <= low < high rad/s, got [{low:g}, {high:g}]", at=("band",)
            )

    @property
    def usual(self) -> bool:
        """Whether its metric is the one that its name alone says, of the whole response: no number is given that changes it."""
        return not self.windowed and (self.metric != "settling_time" or self.options.settling_band == USUAL_BAND)

    @property
    def windowed(self) -> bool:
        """Whether nothing counts that lies beyond the duration."""
        metric = catalogue().get(self.metric)
        return (
            self.duration is not None and metric is not None and issubclass(metric, TimeMetric) and metric.of_the_window
        )

    @property
    def compares(self) -> bool:
        """Whether its metric is one of the error, reference minus output."""
        metric = catalogue().get(self.metric)
        return metric is not None and issubclass(metric, TimeMetric) and metric.of_the_error

    def as_told(self, diagram: Diagram) -> bool:
        """Return whether every evaluator knows what it means: an error reference minus output, in one unit, nothing differentiated."""
        if self.compares and self.signals and not diagram.references.plain(self.signals, str(self.output)):
            return False
        return self.order(diagram) == 0

    def order(self, diagram: Diagram) -> int | str:
        """Return how often its output is differentiated; what the request must still say where that is not known."""
        metric = catalogue().get(self.metric)
        if metric is None or not issubclass(metric, TimeMetric) or metric.order is None or self.output is None:
            return 0
        return order_of(metric.order, self.output, diagram.references, self.options.derivative)

    @property
    def opened_besides(self) -> bool:
        """Whether more is opened than the loop is cut at: then not the closed system must be stable, but one that is open there."""
        return isinstance(self.open_at, tuple)


_BESIDE: Final = 1e-6
_SHORT: Final = 1e-7
"""Of the time of the fastest mode."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Gradient:
    """Derivatives of a metric: ``values`` (parameters,) in metric unit per SI unit; ``one_sided`` where it jumps or has a kink."""

    values: Real
    one_sided: bool


@numerical()
def measure(
    diagram: Diagram,
    requests: Sequence[MetricRequest],
    *,
    overrides: Mapping[str, float] | None = None,
    gradient: Sequence[str | CommandParameter] = (),
) -> list[tuple[Measured, Gradient | None]]:
    """Return each metric, and its derivatives with respect to the parameters of ``gradient``.

    Parameters
    ----------
    diagram : Diagram
    requests : sequence of MetricRequest
    overrides : mapping, optional
        Parameter values, SI.
    gradient : sequence of str or CommandParameter, optional
        Parameter paths, and numbers of commands. The derivative is exact (no step size); None where the metric has no value.

    Raises
    ------
    DiagramError
        When a request names an unknown metric, input, output, endpoint or parameter, or the gradient a number of a command
        and the system is nonlinear.
    """
    if not gradient:
        found = findings(Evaluation(diagram, overrides), requests)
        return [
            (measured_of(diagram, request, finding), None) for request, finding in zip(requests, found, strict=True)
        ]
    whole, bringing = _lanes(diagram, overrides, gradient)
    groups = [*whole, *bringing]
    columns = [findings(group, requests) for group in groups]
    values = columns[0] if whole else findings(Evaluation(diagram, overrides), requests)
    order = [lane for group in groups for lane in group.lanes]
    place = [order.index(name) for name in gradient]
    result: list[tuple[Measured, Gradient | None]] = []
    for row, request in enumerate(requests):
        first = values[row]
        slopes = None
        if isinstance(first, Found):
            parts = [_slopes(group, column[row]) for group, column in zip(groups, columns, strict=True)]
            kinked = not all(group.smooth for group in groups)
            kinked = kinked or any(isinstance(f, Found) and f.kinked for f in (column[row] for column in columns))
            slopes = Gradient(values=np.concatenate(parts)[place], one_sided=first.one_sided or kinked)
        result.append((measured_of(diagram, request, first), slopes))
    return result


def _slopes(evaluation: Evaluation, finding: Finding) -> Real:
    """Return the derivatives of one metric for the parameters of one evaluation; NaN where the metric then vanishes."""
    if isinstance(finding, Found):
        return evaluation.derivatives(finding.value)
    return np.full(len(evaluation.lanes), np.nan)


def _lanes(
    diagram: Diagram, overrides: Mapping[str, float] | None, gradient: Sequence[str | CommandParameter]
) -> tuple[list[Evaluation], list[Evaluation]]:
    """Return evaluations that together carry the gradient: of the system as it is, and of one more for each parameter apart.

    One at 0 may bring a state of its own; where that never comes to rest, metrics that need rest have no derivative. One that
    changes the ratio of two rates leaves no common period: metrics that need it have none.
    """
    base = Evaluation(diagram, overrides)
    names = [lane for lane in gradient if isinstance(lane, str)]
    commands = [lane for lane in gradient if not isinstance(lane, str)]
    apart = {name for name in names if base.value_of(name) == 0} | base.changing_rates(names)
    zero = [name for name in names if name in apart]
    plain = [name for name in names if name not in zero]
    whole = [Evaluation(diagram, overrides, plain)] if plain else []
    if commands and diagram.nonlinear:
        msg = f"a derivative by {commands[0].path} of a command must be that of a linear system, got a nonlinear one"
        raise DiagramError(msg, at=("parameters",))
    if commands:
        whole.append(Evaluation(diagram, overrides, commands=commands))
    beside = {name: _beside_zero(diagram, overrides, name) if base.value_of(name) == 0 else overrides for name in zero}
    return whole, [Evaluation(diagram, beside[name], [name]) for name in zero]


def _beside_zero(diagram: Diagram, overrides: Mapping[str, float] | None, name: str) -> Mapping[str, float] | None:
    """Return values at which a parameter has the slope that it has at 0.

    A delay of exactly 0 is a direct connection, from which no infinitesimal leads to a delay: it is taken so short beside the
    fastest mode that its slope has not changed.
    """
    own = {**(overrides or {}), name: 0.0}
    pair = {path: np.array([value, value or _BESIDE]) for path, value in own.items() if path == name or value}
    stack = diagram.realize_stack(pair)
    opened = any((part[0] != part[1]).any() for part in (stack.b2, stack.d12, stack.d22))
    if not stack.valid.all() or not opened:
        return overrides
    fastest = float(np.abs(np.linalg.eigvals(stack.a[0].real)).max(initial=0.0))
    return {**own, name: _SHORT / fastest if fastest > 0 else _BESIDE}


def findings(evaluation: Evaluation, requests: Sequence[MetricRequest]) -> list[Finding]:
    """Return all metrics of one evaluation, each response computed once."""
    together: dict[tuple[int, ...], list[str]] = {}
    for request in requests:
        if request.output is not None:
            outputs = together.setdefault(command_of(request), [])
            if request.output not in outputs:
                outputs.append(request.output)
    return [find(evaluation, request, together) for request in requests]


def command_of(request: MetricRequest) -> tuple[int, ...]:
    """Return what tells one command from another, so that its response is computed once."""
    return tuple(id(signal) for signal in request.signals.values())


def metric_named(name: str) -> type[Metric]:
    """Return the metric class of a kind.

    Raises
    ------
    DiagramError
        When the catalogue has none.
    """
    found = catalogue().get(name)
    if found is None:
        msg = f"metric must be one of the catalogue's ({', '.join(catalogue())}), got '{name}'"
        raise DiagramError(msg, at=("metrics",))
    return found


def find(evaluation: Evaluation, request: MetricRequest, together: Mapping[tuple[int, ...], Sequence[str]]) -> Finding:
    """Return one metric; ``together`` names, for each command, the outputs whose responses are computed with it."""
    metric = metric_named(request.metric)
    diagram = evaluation.diagram
    lacking = _lacking(metric, request) or _unlike(diagram, request) or _unsaid(diagram, request)
    if lacking:
        return Absent(verdict=Verdict.NOT_APPLICABLE, advice=lacking)
    try:
        with numerical():
            finding = _found(metric, evaluation, request, together)
    except IllPosedError as error:
        finding = Absent(verdict=Verdict.ILL_POSED, advice=error.message)
    except UnresolvedError as error:
        finding = Absent(verdict=Verdict.DOUBTFUL, advice=error.message)
    return finding


def _found(
    metric: type[Metric],
    evaluation: Evaluation,
    request: MetricRequest,
    together: Mapping[tuple[int, ...], Sequence[str]],
) -> Finding:
    if issubclass(metric, TimeMetric):
        outputs = together.get(command_of(request), [str(request.output)])
        order = request.order(evaluation.diagram)
        assert isinstance(order, int)
        subject = evaluation.time_subject(request.signals, str(request.output), request.duration, outputs, order=order)
        subject = replace(subject, band=request.band, mask=request.mask, options=request.options)
        return _in_time(metric, subject, accepts_unsettled=request.unsettled)
    if issubclass(metric, PathMetric):
        path = evaluation.path(str(request.source), str(request.target))
        return metric.measure(replace(path, mask=request.mask, options=request.options))
    if issubclass(metric, LoopMetric):
        assert request.open_at is not None
        return metric.measure(replace(evaluation.loop(request.open_at), mask=request.mask))
    assert issubclass(metric, SystemMetric)
    return metric.measure(evaluation.system_subject)


def _in_time(metric: type[TimeMetric], subject: TimeSubject, *, accepts_unsettled: bool) -> Finding:
    """Return a metric of a response; of a part of a run none: its integrals are those of another, shorter one."""
    if subject.incomplete is not None:
        return subject.incomplete
    finding = window.measured(metric, subject) if window.applies(metric, subject) else metric.measure(subject)
    if isinstance(finding, Found) and finding.verdict is Verdict.NOT_SETTLED and not accepts_unsettled:
        return unsettled(finding.verdict) or finding
    return finding


def _lacking(metric: type[Metric], request: MetricRequest) -> str:
    """Return what a request must still name for this metric, or an empty string."""
    if issubclass(metric, TimeMetric) and (request.output is None or not request.signals):
        return "it needs an input signal and the name of an output"
    if issubclass(metric, PathMetric) and (request.source is None or request.target is None):
        return "it needs 'from' (an input) and 'to' (an output)"
    if issubclass(metric, LoopMetric) and request.open_at is None:
        return "it needs 'open_at': where the loop is cut open"
    number = request.options.lacking(metric.options)
    if number:
        return f"it needs '{number}': {MEANINGS[number]}"
    if metric.mask and request.mask is None:
        return f"it needs 'bounds': the {metric.mask} that the curve is held against"
    return ""


def _unlike(diagram: Diagram, request: MetricRequest) -> str:
    """Return why an output cannot be compared with its reference, or an empty string."""
    return diagram.references.unlike(request.signals, str(request.output)) if request.compares else ""


def _unsaid(diagram: Diagram, request: MetricRequest) -> str:
    """Return why it is not known which derivative of an output is meant, or an empty string."""
    order = request.order(diagram)
    return order if isinstance(order, str) else ""


def unit_of(diagram: Diagram, request: MetricRequest) -> str:
    """Return the SI unit of a metric for this request; "1" where the signals carry no known unit."""
    metric = metric_named(request.metric)
    unit = metric.unit
    if unit.startswith("output/input"):
        return unit.replace("output/input", named_unit(diagram, request.target))
    if "output" not in unit:
        return unit
    own = named_unit(diagram, request.target if issubclass(metric, PathMetric) else request.output)
    order = request.order(diagram)
    if isinstance(order, int):
        own = derived_unit(own, order)
    if own == "1":
        return unit.replace("output**2*", "").replace("output*", "").replace("output", "1")
    base = f"({own})" if any(sign in own for sign in "*/") and "**2" in unit else own
    return unit.replace("output", base)


def named_unit(diagram: Diagram, output: str | None) -> str:
    """Return the unit of an output, "1" where none is known."""
    return (diagram.output_units.get(output) if output else None) or "1"


def measured_of(diagram: Diagram, request: MetricRequest, finding: Finding) -> Measured:
    """Return a finding as the user sees it: a number with its unit, or a verdict with advice."""
    unit = unit_of(diagram, request)
    reference = diagram.references.said(request.signals, request.output) if request.compares else ""
    if isinstance(finding, Absent):
        return Measured(value=None, unit=unit, verdict=finding.verdict, advice=finding.advice, reference=reference)
    value = float(np.ravel(finding.value)[0].real) + 0.0  # no -0.0
    if not np.isfinite(value):
        return Measured(value=None, unit=unit, verdict=Verdict.DIVERGES, advice="the value is not finite")
    advice = _JUMPS if finding.one_sided else ""
    return Measured(
        value=value, unit=unit, verdict=finding.verdict, advice=advice, at=finding.at, doubt=finding.doubt,
        settled_from=finding.settled_from, reference=reference,
    )  # fmt: skip
