"""Goals that are the magnitude of a ratio of responses which are both linear in the parameters of a controller.

    S = 1/D,   T = L/D,   L = L/1,   y/u = N/D,   1 - y/u = (D - N)/D,   ∫e dt = lim E(jω)/D as ω → 0,     D = 1 + L

An upper bound m on the magnitude, |N| ≤ m |D|, is convex but for its right side; a lower bound is an upper one on D/N.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from engine.model.masks import FrequencyBounds, Magnitude
from engine.signals.step import Step
from optimizers.problem import ProblemError, Sense

if TYPE_CHECKING:
    from optimizers.problem import Goal, Problem

Response = Literal["sensitivity", "complementary", "loop", "path", "error", "integral"]

PEAKS: dict[str, Response] = {
    "sensitivity_peak": "sensitivity",
    "complementary_peak": "complementary",
    "compliance_peak": "path",
    "control_sensitivity_peak": "path",
    "resonance_peak": "path",
}
"""Metrics that are the largest magnitude of a response over all frequencies."""

BOUNDS: dict[str, Response] = {
    "sensitivity_bound": "sensitivity",
    "complementary_bound": "complementary",
    "loop_bound": "loop",
    "path_bound": "path",
    "error_bound": "error",
}
"""Metrics that hold the magnitude of a response against bounds over frequency."""

INTEGRATED_ERROR = "ie"


@dataclass(frozen=True, slots=True, kw_only=True)
class Ratio:
    """One side of one goal.

    ``mask`` divides the magnitude (``inverted``: the magnitude divides it); ``commands`` (input, amplitude) and
    ``reference`` say which error is integrated.
    """

    goal: int
    response: Response
    open_at: str | None = None
    source: str | None = None
    target: str | None = None
    mask: Magnitude | None = None
    inverted: bool = False
    commands: tuple[tuple[str, float], ...] = ()
    reference: str | None = None

    @property
    def at_rest(self) -> bool:
        """Whether only the limit ω → 0 counts."""
        return self.response == "integral"

    @property
    def band(self) -> tuple[float, float]:
        """The angular frequencies that count, rad/s."""
        return (0.0, math.inf) if self.mask is None else self.mask.span

    @property
    def corners(self) -> tuple[float, ...]:
        """Where the mask bends or ends, rad/s."""
        if self.mask is None:
            return ()
        return tuple(w for w in (*self.mask.corners, *self.mask.span) if 0 < w < math.inf)


def ratios_of(problem: Problem) -> tuple[Ratio, ...]:
    """Return the goals as ratios: one for each, two for bounds on both sides.

    Raises
    ------
    ProblemError
        If a goal is not of this form: with its place and what to use instead.
    """
    return tuple(ratio for index, goal in enumerate(problem.goals) for ratio in _ratios(problem, index, goal))


def _ratios(problem: Problem, index: int, goal: Goal) -> list[Ratio]:
    at = ("goals", index)
    if goal.metric not in PEAKS and goal.metric not in BOUNDS and goal.metric != INTEGRATED_ERROR:
        known = ", ".join([*PEAKS, *BOUNDS, INTEGRATED_ERROR])
        raise ProblemError(
            f"metric must be one of {known} for the method convex, got {goal.metric!r}: {_instead(goal.metric)}",
            at=(*at, "metric"),
        )
    if goal.lower is not None:
        raise ProblemError(
            f"lower must be absent from a goal of the method convex (that a largest magnitude exceeds something is not "
            f"convex), got {goal.lower:g}: use the method gradient", at=(*at, "lower"),
        )  # fmt: skip
    if goal.sense is Sense.MAXIMIZE:
        raise ProblemError(
            "sense must be minimize for the method convex (a largest magnitude is convex, its negative is not), "
            "got maximize: use the method gradient", at=(*at, "sense"),
        )  # fmt: skip
    if goal.upper is not None and goal.upper <= 0:
        raise ProblemError(f"upper must be > 0 for the method convex, got {goal.upper:g}", at=(*at, "upper"))
    if goal.open_at is not None and not isinstance(goal.open_at, str):
        raise ProblemError(
            f"open_at must be one place for the method convex, got {len(goal.open_at)}: use the method gradient",
            at=(*at, "open_at"),
        )
    if goal.metric in PEAKS:
        return [
            Ratio(goal=index, response=PEAKS[goal.metric], open_at=goal.open_at, source=goal.source, target=goal.target)
        ]
    if goal.metric in BOUNDS:
        bounds = problem.requests[index].mask
        assert isinstance(bounds, FrequencyBounds)
        return [
            Ratio(
                goal=index, response=BOUNDS[goal.metric], open_at=goal.open_at, source=goal.source, target=goal.target,
                mask=mask, inverted=power < 0,
            )
            for mask, power in bounds.sides
        ]  # fmt: skip
    return [_integrated(problem, index, goal)]


def _integrated(problem: Problem, index: int, goal: Goal) -> Ratio:
    number, experiment = next((k, e) for k, e in enumerate(problem.experiments) if e.name == goal.experiment)
    if experiment.duration is not None:
        raise ProblemError(
            f"duration must be absent (the integral to infinity) for the method convex, got {experiment.duration:g} s",
            at=("experiments", number, "duration"),
        )
    commands = []
    for port, signal in experiment.signals.items():
        if not isinstance(signal, Step):
            raise ProblemError(
                f"input {port} must be a step for the integrated error of the method convex, got a {signal.kind}",
                at=("experiments", number, "input"),
            )
        commands.append((port, float(signal.amplitude)))
    reference = problem.diagram.references.input_of([port for port, _ in commands], goal.output)
    return Ratio(goal=index, response="integral", target=goal.output, commands=tuple(commands), reference=reference)


def _instead(metric: str) -> str:
    if metric in {"gain_margin", "gain_margin_up", "gain_margin_down", "phase_margin", "delay_margin", "disk_margin"}:
        return (
            "a bound Ms on sensitivity_peak guarantees a gain margin of Ms/(Ms - 1) and a phase margin of "
            "2 asin(1/(2 Ms)); or use the method gradient"
        )
    if metric in {"iae", "ise", "itae"}:
        return f"minimize {INTEGRATED_ERROR}, the integral of the error with its sign, or use the method gradient"
    return "it is not convex in the parameters of a controller; use the method gradient"
