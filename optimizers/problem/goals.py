"""One goal: a metric of an experiment, a path, a loop or the poles, as an objective, as a constraint, or as both.

Met or not is told on one scale for all goals:  score = 1 + max((f - upper) / |upper|, (lower - f) / |lower|),  met at ≤ 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from engine.analysis.study import MetricRequest
from engine.metrics import catalogue as metric_catalogue
from engine.model.errors import EngineError, Path
from engine.model.masks import Envelope, FrequencyBounds, Mask, Polyline
from engine.model.metric_options import MEANINGS, USUAL, Options
from engine.model.verdicts import Verdict
from optimizers.problem.bounds import check_reachable
from optimizers.problem.errors import ProblemError, listed

if TYPE_CHECKING:
    from engine.diagram.connections import Opening
    from engine.diagram.diagram import Diagram
    from optimizers.problem.experiments import Experiment

ON_AIM = 0.01
"""A goal with a target is met within this part of it, unless its tolerance says otherwise."""

_ACCEPTED = (Verdict.OK, Verdict.NOT_SETTLED)
_WIRE = {"source": "from", "target": "to"}
_NEEDS = {"time": ("experiment", "output"), "path": ("source", "target"), "loop": ("open_at",)}
_MASKS: Mapping[str, type[Mask]] = {"envelope": Envelope, "reference": Polyline, "frequency bounds": FrequencyBounds}


class Sense(StrEnum):
    """The direction in which a goal's metric is to go."""

    MINIMIZE = "minimize"
    MAXIMIZE = "maximize"


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """One metric, as an objective (``sense``), as a constraint (``lower``, ``upper``; SI), or as both.

    Sense and bounds are those of what it compares (`optimizers.evaluation.compared`): of gain and phase margins the distance from
    instability.

    Parameters
    ----------
    metric : str
        A key of the catalogue of metrics.
    experiment, output, source, target, open_at : str, optional
        Where it is measured.
    band : (float, float), optional
        What a metric of the spectrum looks at, rad/s.
    mask : Mask, optional
        What a metric of a whole curve holds it against. Such a metric is met at 1: with neither sense nor bound, 1 is its
        upper bound.
    aim : float, optional
        Value to be hit, within ``tolerance`` (1 % of it by default); becomes ``lower`` and ``upper``.
    options : Options
        Numbers that some metrics take: the band of a recovery time, say.
    accept : Verdict
        ``not_settled`` takes also what a window says of an output that has not settled in it; ``ok`` only what has.
    hard : bool
        Whether the bounds must hold. Soft ones are approached: beside an objective an excess counts ``weight`` times, without
        one the worst weighted excess is made as small as possible.
    """

    metric: str
    experiment: str | None = None
    output: str | None = None
    source: str | None = None
    target: str | None = None
    open_at: Opening | None = None
    band: tuple[float, float] | None = None
    sense: Sense | None = None
    lower: float | None = None
    upper: float | None = None
    weight: float = 1.0
    mask: Mask | None = None
    aim: float | None = None
    tolerance: float | None = None
    hard: bool = True
    options: Options = USUAL
    accept: Verdict = Verdict.NOT_SETTLED

    def __post_init__(self) -> None:
        if self.aim is not None and self.lower is None and self.upper is None:
            reach = ON_AIM * abs(self.aim) if self.tolerance is None else self.tolerance
            object.__setattr__(self, "lower", self.aim - reach)
            object.__setattr__(self, "upper", self.aim + reach)
        elif self.mask is not None and not isinstance(self.mask, Polyline) and not self.bounded and self.sense is None:
            object.__setattr__(self, "upper", 1.0)

    @property
    def unlimited(self) -> bool:
        """Whether an absent value means that the metric is as large as can be (margins, bandwidth, damping)."""
        return metric_catalogue()[self.metric].absent_is_infinite

    @property
    def bounded(self) -> bool:
        """Whether it has a lower or an upper bound."""
        return self.lower is not None or self.upper is not None

    @property
    def soft(self) -> bool:
        """Whether it has bounds that are approached and need not hold."""
        return not self.hard and self.bounded

    @property
    def bounds(self) -> tuple[tuple[float, float], ...]:
        """Bounds that are there, upper before lower, each with its sign: an excess is sign (f - bound) / |bound|."""
        both = ((self.upper, 1.0), (self.lower, -1.0))
        return tuple((bound, sign) for bound, sign in both if bound is not None)


def only_places(metric: str, diagram: Diagram, experiments: Sequence[str]) -> dict[str, str]:
    """Return where a metric is taken that names no place: the only experiment, input or output, where there is one.

    Parameters
    ----------
    metric : str
    diagram : Diagram
    experiments : sequence of str
        Their names.
    """
    known = metric_catalogue().get(metric)
    if known is None:
        return {}
    there = {"experiment": experiments, "output": diagram.outputs, "source": diagram.inputs, "target": diagram.outputs}
    needed = _NEEDS.get(known.domain, ())
    return {name: there[name][0] for name in needed if name in there and len(there[name]) == 1}


def request_of(diagram: Diagram, goal: Goal, experiments: Mapping[str, Experiment], at: Path) -> MetricRequest:
    """Check a goal and return it as a request to the engine.

    Raises
    ------
    ProblemError
        An unknown metric or place, something that the metric needs and is not given, contradictory bounds.
    """
    metrics = metric_catalogue()
    if goal.metric not in metrics:
        raise ProblemError(f"metric must be one of {listed(metrics)}, got {goal.metric!r}", at=(*at, "metric"))
    _check_bounds(goal, at)
    check_reachable(goal, at)
    metric = metrics[goal.metric]
    _check_mask(goal, metric.mask, at)
    _check_options(goal, metric.options, at)
    for name in _NEEDS.get(metric.domain, ()):
        if getattr(goal, name) is None:
            key = _WIRE.get(name, name)
            several = {"experiment": experiments, "source": diagram.inputs}.get(name, diagram.outputs)
            which = f", one of {listed(several)}" if name != "open_at" else ""
            raise ProblemError(f"{key} must be given for {goal.metric}{which}, got nothing", at=(*at, key))
    experiment = None
    if goal.experiment is not None:
        if goal.experiment not in experiments:
            raise ProblemError(
                f"experiment must be one of {listed(experiments)}, got {goal.experiment!r}", at=(*at, "experiment")
            )
        experiment = experiments[goal.experiment] if metric.domain == "time" else None
    for name, known in (("output", diagram.outputs), ("target", diagram.outputs), ("source", diagram.inputs)):
        value = getattr(goal, name)
        if value is not None and value not in known:
            key = _WIRE.get(name, name)
            raise ProblemError(f"{key} must be one of {listed(known)}, got {value!r}", at=(*at, key))
    if goal.open_at is not None:
        try:
            diagram.realize(open_at=goal.open_at)
        except EngineError as error:
            raise ProblemError(error.message, at=(*at, "open_at")) from error
    return _told(
        diagram,
        MetricRequest(
            metric=goal.metric,
            signals=experiment.signals if experiment is not None else {},
            output=goal.output,
            open_at=goal.open_at,
            source=goal.source,
            target=goal.target,
            duration=experiment.duration if experiment is not None else None,
            band=goal.band,
            mask=goal.mask,
            options=goal.options,
            unsettled=goal.accept is Verdict.NOT_SETTLED,
        ),
        at,
    )


def _told(diagram: Diagram, request: MetricRequest, at: Path) -> MetricRequest:
    """Return a request; refuse it where it is not known which derivative of its output is meant."""
    order = request.order(diagram)
    if isinstance(order, str):
        raise ProblemError(f"{request.metric}: {order}", at=(*at, "derivative"))
    return request


def check_together(goals: Sequence[Goal]) -> None:
    """Refuse no goals at all, and hard bounds on one metric that cannot hold together.

    Raises
    ------
    ProblemError
    """
    if not goals:
        raise ProblemError("goals must be at least one, got none", at=("goals",))
    strictest: dict[tuple[object, ...], tuple[float, int]] = {}
    for index, goal in enumerate(goals):
        if goal.upper is not None and goal.hard:
            known = strictest.get(_place(goal))
            if known is None or goal.upper < known[0]:
                strictest[_place(goal)] = goal.upper, index
    for index, goal in enumerate(goals):
        upper = strictest.get(_place(goal))
        if upper is None or upper[1] == index or not goal.hard or goal.lower is None:
            continue
        if goal.lower > upper[0]:
            raise ProblemError(
                f"lower of {goal.metric} must be <= {upper[0]:g}, the upper bound of goal {upper[1]}, got {goal.lower:g}",
                at=("goals", index, "lower"),
            )


def _place(goal: Goal) -> tuple[object, ...]:
    return (
        goal.metric, goal.experiment, goal.output, goal.source, goal.target, goal.open_at, goal.band, goal.mask,
        goal.options,
    )  # fmt: skip


def _check_bounds(goal: Goal, at: Path) -> None:
    if goal.accept not in _ACCEPTED:
        raise ProblemError(f"accept must be one of {listed(_ACCEPTED)}, got {goal.accept}", at=(*at, "accept"))
    if goal.sense is None and not goal.bounded:
        raise ProblemError(
            f"goal {goal.metric} must have a sense, a target, a lower or an upper bound, got none", at=at
        )
    if not goal.hard and not goal.bounded:
        raise ProblemError(f"goal {goal.metric} must have a bound to be soft, got none", at=(*at, "hard"))
    _check_aim(goal, at)
    for key, bound in (("lower", goal.lower), ("upper", goal.upper)):
        if bound is not None and not math.isfinite(bound):
            raise ProblemError(f"{key} must be a finite number, got {bound}", at=(*at, key))
    if goal.band is not None and not 0 <= goal.band[0] < goal.band[1] < math.inf:
        low, high = goal.band
        raise ProblemError(
            f"band must be [low, high] with 0 <= low < high rad/s, got [{low:g}, {high:g}]", at=(*at, "band")
        )
    if goal.lower is not None and goal.upper is not None and goal.lower > goal.upper:
        raise ProblemError(f"upper must be >= lower {goal.lower:g}, got {goal.upper:g}", at=(*at, "upper"))
    if not (goal.weight > 0 and math.isfinite(goal.weight)):
        raise ProblemError(f"weight must be > 0, got {goal.weight:g}", at=(*at, "weight"))


def _check_aim(goal: Goal, at: Path) -> None:
    if goal.aim is None:
        if goal.tolerance is not None:
            raise ProblemError("tolerance must be left out without a target, got one", at=(*at, "tolerance"))
        return
    if goal.tolerance is not None and not (goal.tolerance > 0 and math.isfinite(goal.tolerance)):
        raise ProblemError(f"tolerance must be > 0, got {goal.tolerance:g}", at=(*at, "tolerance"))
    if goal.tolerance is None and goal.aim == 0:
        raise ProblemError("tolerance must be given for a target of 0, got nothing", at=(*at, "tolerance"))
    reach = ON_AIM * abs(goal.aim) if goal.tolerance is None else goal.tolerance
    if (goal.lower, goal.upper) != (goal.aim - reach, goal.aim + reach):
        raise ProblemError("target must be given without lower and upper, got both", at=(*at, "target"))


def _check_options(goal: Goal, takes: tuple[str, ...], at: Path) -> None:
    name = goal.options.lacking(takes)
    if name:
        raise ProblemError(f"{name} must be given for {goal.metric} ({MEANINGS[name]}), got nothing", at=(*at, name))
    name = goal.options.needless(takes)
    if name:
        raise ProblemError(f"{name} must be left out for {goal.metric}: it takes no such number", at=(*at, name))


def _check_mask(goal: Goal, needs: str, at: Path) -> None:
    key = "reference" if needs == "reference" or isinstance(goal.mask, Polyline) else "bounds"
    if not needs:
        if goal.mask is not None:
            raise ProblemError(
                f"{key} must be left out for {goal.metric}: it holds no curve against them", at=(*at, key)
            )
        return
    if not isinstance(goal.mask, _MASKS[needs]):
        raise ProblemError(f"{key} must be given for {goal.metric} ({needs}), got nothing of that kind", at=(*at, key))
