"""What a metric is: a definition, a unit, and one function of an exact response.

The function is written once. It works on quantities that carry infinitesimals, so the value and all its derivatives come
out of the same lines; it returns why there is no value where there is none.
"""

from __future__ import annotations

import abc
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from engine.exact.time.curve import Curve
from engine.model.metric_options import USUAL, Options
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.exact.frequency.poles import Poles
    from engine.exact.frequency.response import FrequencyResponse
    from engine.model.linear_system import Array
    from engine.model.masks import Mask

NEGLIGIBLE = 1e-9
"""A difference below this part of the signal is not a difference: rounding of the exact response is far below it."""

TOUCHES = 1e-7
"""A turning point this near to a level, relative to it, touches it; two peaks this near to each other are as high."""

_THIN = 1e-4
"""A band below this part of the largest value is looked for in the distance from rest: the output has few digits left there."""

Domain = Literal["time", "path", "loop", "system"]
MaskKind = Literal["", "envelope", "reference", "frequency bounds"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """A metric's value.

    ``value`` has shape (lanes,) and carries its derivatives; ``at`` is the instant (s) or frequency (rad/s) where it is
    found; ``one_sided`` says that the metric jumps here, so that its derivative holds on one side only; ``kinked`` that its
    derivative does, as that of the larger of two equal peaks. ``settled_from`` says what a value that is relative to where the
    output settles took for that, if it has not settled; ``doubt`` how far the rest may change it, None where that is not known.
    """

    value: Array
    at: float | None = None
    one_sided: bool = False
    kinked: bool = False
    verdict: Verdict = Verdict.OK
    doubt: float | None = None
    settled_from: str = ""


@dataclass(frozen=True, kw_only=True)
class Absent:
    """Why a metric has no value."""

    verdict: Verdict
    advice: str


Finding = Found | Absent


def _unknown() -> None:
    """Return that a distance from rest is not known."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeSubject:
    """The whole response of one output.

    Parameters
    ----------
    y : Curve or None
        The output from t = 0 until nothing moves any more; up to the duration where the path does not settle.
    initial : ndarray, shape (lanes,)
        Value just before the command.
    final : ndarray or None
        Value that it settles at; None where the command or the path does not settle.
    start, end : float
        When the command starts and ends, s; ``end`` is None for a command that goes on for ever.
    error : Curve or None
        r - y; None without a reference.
    error_final : ndarray or None
        Where the error goes to.
    duration : float or None
        Limit of the integrals, s; None means infinity.
    verdict : Verdict
        Of the path from the input to this output.
    incomplete : Absent or None
        Why nothing is measured on it: it ends before its time. None for one that was followed to its end.
    to_go : (float, float) or None
        Of one that has not settled within its duration: how far it may still go down and up from its last value; None where that is
        not known.
    band : (float, float) or None
        Angular frequencies between which a spectrum is looked at, rad/s.
    mask : Mask or None
        What the curve is held against.
    moving_start, moving_end : ndarray or None
        Start and end of the command with what the lanes carry; None where no lane moves them.
    loading : ndarray, shape (lanes,) or (1,)
        When the last command begins, that of a load say, s.
    options : Options
        Numbers that some metrics take.
    fading : callable
        Returns y - final from the end of the command on, with the digits of what is left of it; None where it is not known.
    """

    y: Curve | None
    initial: Array
    final: Array | None
    start: float
    end: float | None
    error: Curve | None
    error_final: Array | None
    duration: float | None
    verdict: Verdict
    incomplete: Absent | None = None
    to_go: tuple[float, float] | None = None
    band: tuple[float, float] | None = None
    mask: Mask | None = None
    moving_start: Array | None = None
    moving_end: Array | None = None
    loading: Array = field(default_factory=lambda: np.zeros(1))
    options: Options = USUAL
    fading: Callable[[], Curve | None] = _unknown

    @property
    def curve(self) -> Curve:
        """The output; only asked for where it exists."""
        assert self.y is not None
        return self.y

    def during(self, curve: Curve, final: Array | None) -> Curve:
        """Return the part of a curve before the duration; beyond its end it stands still where it goes to, if anywhere."""
        assert self.duration is not None
        return curve.until(self.duration) if final is None else curve.held(self.duration, final)

    def since_start(self, instant: Array) -> Array:
        """Return how long after the start of the command an instant is, s."""
        return np.asarray(instant - (self.start if self.moving_start is None else self.moving_start))


@dataclass(frozen=True, kw_only=True, eq=False)
class PathSubject:
    """The frequency response from one input to one output, its poles; ``static`` is None where s = 0 is one."""

    response: FrequencyResponse
    static: Array | None
    own: Poles
    verdict: Verdict
    mask: Mask | None = None
    options: Options = USUAL


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopSubject:
    """An open loop L, negative feedback, the poles of the loop open and closed, and the stability of the closed one."""

    response: FrequencyResponse
    static: Array | None
    opened: Poles
    closed: Poles
    verdict: Verdict
    mask: Mask | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class SystemSubject:
    """The poles of the whole system."""

    poles: Poles


class Metric(abc.ABC):
    """One definition. A metric is a final class in a file of its own, named after its kind."""

    kind: ClassVar[str]
    title: ClassVar[str]
    unit: ClassVar[str]
    """SI unit; ``output`` stands for the unit of the output, ``output*s`` and so on for products with it."""
    domain: ClassVar[Domain]
    better: ClassVar[Literal["lower", "higher"]]
    definition: ClassVar[str]
    source: ClassVar[str]
    amplitude_power: ClassVar[int] = 0
    """The metric grows with this power of the command's amplitude."""
    time_power: ClassVar[float] = 0
    """The metric grows with this power of the time scale."""
    belongs_to: ClassVar[tuple[str, ...]] = ()
    """Units of the outputs that it is shown for by default; empty for any."""
    mask: ClassVar[MaskKind] = ""
    """What a request must bring besides, for a metric that holds a whole curve against something."""
    options: ClassVar[tuple[str, ...]] = ()
    """Names of the numbers that it takes; see :class:`Options`."""
    by_default: ClassVar[bool] = True
    """Whether it is among the metrics of a frequency response that names none; one that takes a number is where it is given."""
    absent_is_infinite: ClassVar[bool] = False
    """``never_crosses`` or ``not_oscillatory`` means that it is as large as can be: no finite margin or bandwidth, no pole."""
    range: ClassVar[tuple[float, float]] = (0.0, math.inf)
    """Where what goals compare of it lies, in SI."""
    compares: ClassVar[str] = ""
    """What goals compare of it where that is not the value itself, as a formula."""
    usual_unit: ClassVar[str] = ""
    """What its field speaks of it in: ``deg``, ``%`` or ``dB``."""
    seldom_beyond: ClassVar[float] = math.inf
    """A bound beyond this was hardly meant in SI."""

    @classmethod
    def distance(cls, value: Array) -> Array:
        """Return what goals compare of values, which may carry infinitesimals: of margins the distance from instability."""
        return value


class TimeMetric(Metric):
    """A metric of one output's response."""

    domain: ClassVar[Domain] = "time"
    of_the_end: ClassVar[bool] = False
    """It is relative to where the output settles: of a window in which it does not, it is told from the last value."""
    of_the_error: ClassVar[bool] = False
    """It compares the output with its reference."""
    order: ClassVar[int | None] = None
    """Which derivative of a position it is of; 0 of what a controller gives, None where any output is taken as it is."""
    of_the_window: ClassVar[bool] = False
    """It looks no further than the duration, where one is given; the others do so only where an output has not settled in it."""

    @classmethod
    @abc.abstractmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""


class PathMetric(Metric):
    """A metric of the frequency response from one input to one output."""

    domain: ClassVar[Domain] = "path"

    @classmethod
    @abc.abstractmethod
    def measure(cls, subject: PathSubject) -> Finding:
        """Return the value or the reason why there is none."""


class LoopMetric(Metric):
    """A metric of an open loop."""

    domain: ClassVar[Domain] = "loop"

    @classmethod
    @abc.abstractmethod
    def measure(cls, subject: LoopSubject) -> Finding:
        """Return the value or the reason why there is none."""


class SystemMetric(Metric):
    """A metric of the whole system's poles."""

    domain: ClassVar[Domain] = "system"

    @classmethod
    @abc.abstractmethod
    def measure(cls, subject: SystemSubject) -> Finding:
        """Return the value or the reason why there is none."""


_ADVICE = {
    Verdict.UNSTABLE: "the path is unstable: lower the loop gain or add phase lead",
    Verdict.MARGINAL: "the path oscillates without decay: add damping, or lower the gain of its loop slightly",
    Verdict.INTEGRATING: "the output goes on moving under a constant command: look at its velocity, or close the loop",
    Verdict.ILL_POSED: "an algebraic loop has no solution at these values",
    Verdict.NOT_SETTLED: "the output goes on moving: follow it for longer, or look at a limit cycle over a given duration",
    Verdict.DOUBTFUL: "the simulation could not be followed to its end, or rounding leaves what lasts no digits: see the warnings",
}


def unsettled(verdict: Verdict) -> Absent | None:
    """Return why a path of this verdict has no value, or None when it decays."""
    return None if verdict is Verdict.OK else Absent(verdict=verdict, advice=_ADVICE[verdict])


def without_final_value(subject: TimeSubject) -> Absent | None:
    """Return why a metric relative to the final value does not exist, or None when it does."""
    refusal = unsettled(subject.verdict)
    if refusal is not None:
        return refusal
    if subject.final is None:
        return Absent(
            verdict=Verdict.NOT_APPLICABLE, advice="it needs a command that settles at a constant, such as a step"
        )
    largest = float(np.abs(subject.curve.values[:, :, 0].real).max())
    if abs(float((subject.final - subject.initial)[0].real)) <= NEGLIGIBLE * largest or largest == 0.0:
        return Absent(
            verdict=Verdict.ZERO_STATIC_GAIN,
            advice="the output returns to where it began: relative metrics do not exist",
        )
    return None


def span(subject: TimeSubject) -> tuple[Array, Array, float]:
    """Return (initial value, way from there to the final value, its sign)."""
    assert subject.final is not None
    way = subject.final - subject.initial
    return subject.initial, way, 1.0 if way[0].real > 0 else -1.0


def passage(subject: TimeSubject, part: float) -> Array | None:
    """Return the first instant at which the output has gone ``part`` of its way, or None if it never does."""
    assert subject.final is not None
    initial, way, sign = span(subject)
    level = initial + part * way
    curve = subject.curve
    if sign * (curve.values[0, 0, 0] - level[0]).real >= 0:
        return np.asarray(curve.edges[0])
    return next((instant for instant, _ in curve.crossings(level)), None)


def last_entry(subject: TimeSubject, band: float) -> Finding:
    """Return when the output enters, for the last time, the band of ± ``band`` of its way around its final value."""
    refusal = without_final_value(subject)
    if refusal is not None:
        return refusal
    assert subject.final is not None
    _, way, sign = span(subject)
    half = band * way * sign
    away = away_from(subject, subject.final, float(half[0].real))
    if abs(away.values[-1, -1, 0].real) > half[0].real:
        return Absent(verdict=Verdict.NOT_SETTLED, advice=_ADVICE[Verdict.NOT_SETTLED])
    candidates = []
    for edge in (half, -half):
        last = next((instant for instant, _ in away.crossings(edge, backwards=True)), None)
        if last is not None:
            candidates.append(last)
    zero = subject.curve.edges[0]
    entry = max(candidates, key=lambda instant: float(instant[0].real)) if candidates else zero
    return Found(value=subject.since_start(entry), at=float(entry[0].real), one_sided=grazes(away, half))


def away_from(subject: TimeSubject, level: Array, reach: float) -> Curve:
    """Return how far the output is from a level near its final value, with the digits that leaving ± ``reach`` asks for."""
    assert subject.final is not None
    largest = float(np.abs(subject.curve.values[:, :, 0].real).max())
    left = subject.fading() if reach < _THIN * largest else None
    if left is not None and float(np.abs(left.values[:, :, 0].real).max()) > reach:
        return left + (subject.final - level)
    return subject.curve + (-level)


def grazes(away: Curve, half: Array) -> bool:
    """Return whether a turning point just touches the band: a little more or less, and the last entry jumps there."""
    reach = float(half[0].real)
    _, turns = away.turnings(0.9 * reach)
    return bool(np.any(np.abs(np.abs(turns) / reach - 1) <= TOUCHES))


def touched(subject: TimeSubject, part: float, until: Array) -> bool:
    """Return whether the output only just reaches ``part`` of its way, or nearly, up to an instant: then its passage jumps."""
    initial, way, sign = span(subject)
    size = sign * float(way[0].real)
    instants, turns = (subject.curve + (-initial)).turnings(0.9 * part * size)
    # the passage itself lies a little before a turning point that goes a little beyond
    before = instants <= 1.001 * float(until[0].real)
    return bool(np.any(before & (np.abs(sign * turns - part * size) <= TOUCHES * size)))


def unclosed(subject: LoopSubject) -> Absent | None:
    """Return why a margin of this loop means nothing, or None; on the stability limit margins still exist."""
    return unsettled(subject.verdict) if subject.verdict is Verdict.UNSTABLE else None
