"""Parameters of a system from a recording: grey-box output-error estimation, and how far it can be trusted.

    minimize over p   Σ_o Σ_t (y_o(t) - ŷ_o(t; p) - c_o)² / (n var y_o),   t in the estimation window

ŷ is the exact response of the whole model to the recorded inputs from the recording's start (a simulation, never a
one-step prediction), c_o the constant offset of a sensor, found by linear regression inside. Any addressable parameter
may be unknown.

References
----------
L. Ljung, "System Identification: Theory for the User", 2nd ed., Prentice Hall 1999, sections 7.2 and 10.2.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from engine.errors import EngineError
from engine.fit import Fit, ResidualTests, baselines, compare, examine_residuals
from engine.linear.path import connected
from engine.linear.sampled import Drive
from engine.linear.system import LaneSystem
from engine.linear.tangent import INFINITESIMAL
from engine.nonlinear.recorded import simulate_recorded
from optimizers.confidence import correlations, covariance
from optimizers.methods.least_squares import Minimum, minimize_squares
from optimizers.recording import Identification, Unknown, Window
from optimizers.result import Monitor, Status, Unwatched

Samples = npt.NDArray[np.float64]

NORMAL_95 = 1.959963984540054
STRONG_CORRELATION = 0.95

_GROWTH_LIMIT = 1e6
"""A trial model that could grow more within the recording explains no machine that stayed in one piece."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A parameter (SI) with its 95 % interval within its bounds; None where nothing limits it."""

    value: float
    unit: str
    lower95: float | None
    upper95: float | None
    start: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Identified:
    """Everything that a user needs to judge an identification.

    Attributes
    ----------
    correlations : ndarray, shape (parameters, parameters)
        Of the estimates, in the order of the parameters.
    indistinguishable : tuple of str
        Sentences on what the recording cannot tell apart, or cannot tell at all.
    estimation, validation : mapping of output to Fit
        Of the same model, offsets included, in either window; empty without such a window or model.
    baselines : mapping of baseline to mapping of output to Fit
        What models without dynamics reach in the validation window (in the estimation window when there is none).
    residuals : mapping of output to ResidualTests
        In the estimation window.
    """

    parameters: Mapping[str, Estimate]
    offsets: Mapping[str, float]
    correlations: Samples
    indistinguishable: tuple[str, ...]
    estimation: Mapping[str, Fit]
    validation: Mapping[str, Fit]
    baselines: Mapping[str, Mapping[str, Fit]]
    residuals: Mapping[str, ResidualTests]
    status: Status
    advice: str
    evaluations: int
    seconds: float


def identify(problem: Identification, *, rng: np.random.Generator, monitor: Monitor | None = None) -> Identified:
    """Estimate the unknown parameters.

    Parameters
    ----------
    problem : Identification
    rng : numpy.random.Generator
        Chooses the starts after the first.
    monitor : Monitor, optional

    Returns
    -------
    Identified
        Always: a search that failed says so in ``status`` and ``advice``.
    """
    began = time.perf_counter()
    model = _Model(problem, monitor or Unwatched())
    first = np.array([unknown.coordinate(unknown.start) for unknown in problem.unknowns])
    lower = np.array([unknown.coordinate(unknown.lower) for unknown in problem.unknowns])
    upper = np.array([unknown.coordinate(unknown.upper) for unknown in problem.unknowns])
    starts = np.array([first, *(_elsewhere(problem.unknowns, rng) for _ in range(problem.starts - 1))])
    try:
        found = minimize_squares(
            model.errors, starts, lower=lower, upper=upper, max_evaluations=problem.max_evaluations
        )
        status = Status.STALLED if found is None else Status.CONVERGED if found.converged else Status.BUDGET
    except _CancelledError:
        found = model.best
        status = Status.CANCELLED
    x = first if found is None else found.x
    recording, (part, rest) = problem.recording, problem.windows
    judged = recording.within(rest or part)
    trivial = {
        name: baselines(measured[judged], model.inputs[:, judged], constant=problem.offsets)
        for name, measured in recording.outputs.items()
    }
    simulated = {} if found is None else model.simulate(x)
    window = recording.within(part)
    offsets = {
        name: float(np.mean(recording.outputs[name][window] - y[window])) if problem.offsets else 0.0
        for name, y in simulated.items()
    }
    cov = None if found is None else _covariance(found, len(recording.outputs))
    indistinguishable = () if cov is None else tuple(_sentences(problem.unknowns, x, cov))
    return Identified(
        parameters={
            u.parameter: _estimate(u, float(x[i]), None if cov is None else math.sqrt(cov[i, i]))
            for i, u in enumerate(problem.unknowns)
        },
        offsets=offsets if problem.offsets else {},
        correlations=np.eye(len(x)) if cov is None else correlations(cov),
        indistinguishable=indistinguishable,
        estimation=_fits(problem, simulated, offsets, part),
        validation=_fits(problem, simulated, offsets, rest),
        baselines={
            kind: {name: fits[kind] for name, fits in trivial.items()} for kind in ("mean", "input", "static_gain")
        },
        residuals={
            name: examine_residuals(
                recording.outputs[name][window] - y[window] - offsets[name], model.inputs[:, window]
            )
            for name, y in simulated.items()
        },
        status=status,
        advice=_advice(status, problem.unknowns, x, indistinguishable),
        evaluations=model.evaluations,
        seconds=time.perf_counter() - began,
    )


class _CancelledError(Exception):
    """The monitor wants the search to end."""


class _Model:
    """The errors of the model, as least squares wants them, and the best point so far."""

    def __init__(self, problem: Identification, monitor: Monitor) -> None:
        self.problem = problem
        self.monitor = monitor
        self.evaluations = 0
        self.best: Minimum | None = None
        recording, diagram = problem.recording, problem.diagram
        self.inputs = np.array(list(recording.inputs.values()))
        self._window = recording.within(problem.windows[0])
        self._from = [diagram.inputs.index(name) for name in recording.inputs]
        self._to = [diagram.outputs.index(name) for name in recording.outputs]
        self._measured = np.array([measured[self._window] for measured in recording.outputs.values()])
        self._weight = 1 / (self._measured.std(axis=1) * math.sqrt(self._measured.shape[1]))
        self._drive = Drive(self.inputs, recording.sample_time, growth_limit=_GROWTH_LIMIT)

    def _lanes(self, x: Samples) -> LaneSystem:
        """Return the system at ``x`` with one lane for each unknown."""
        unknowns = self.problem.unknowns
        values = {u.parameter: u.value(float(c)) for u, c in zip(unknowns, x, strict=True)}
        lanes = self.problem.diagram.realize_lanes(dict.fromkeys(values, INFINITESIMAL), values)
        return connected(lanes, self._from, self._to)

    def simulate(self, x: Samples) -> dict[str, Samples]:
        """Return the whole outputs by name."""
        return dict(zip(self.problem.recording.outputs, self._respond(x)[0], strict=True))

    def _respond(self, x: Samples) -> tuple[Samples, Samples]:
        """Return outputs (outputs, samples) and their derivatives by each unknown (unknowns, outputs, samples)."""
        diagram = self.problem.diagram
        if not diagram.nonlinear:
            return self._drive.respond(self._lanes(x))
        unknowns = self.problem.unknowns
        values = {u.parameter: u.value(float(c)) for u, c in zip(unknowns, x, strict=True)}
        laws = diagram.laws(values, dict.fromkeys(values, INFINITESIMAL))
        inputs = np.zeros((len(diagram.inputs), self.inputs.shape[1]))
        inputs[self._from] = self.inputs
        names = tuple(self.problem.recording.outputs)
        return simulate_recorded(laws, inputs, self.problem.recording.sample_time, outputs=names)

    def errors(self, x: Samples) -> tuple[Samples, Samples]:
        """Return residuals and Jacobian at the coordinates ``x``, infinite where the model has no usable response."""
        if self.monitor.cancelled():
            raise _CancelledError
        self.evaluations += 1
        unknowns = self.problem.unknowns
        try:
            values, tangents = self._respond(x)
        except EngineError:
            # an algebraic loop without a solution or a delay too short to follow: no model at these values
            values, tangents = (
                np.full((len(self._to), self.inputs.shape[1]), np.inf),
                np.zeros((len(x), len(self._to), self.inputs.shape[1])),
            )
        if not np.isfinite(values).all():
            return np.full(self._measured.size, np.inf), np.zeros((self._measured.size, len(x)))
        slope = np.array([u.slope(float(c)) for u, c in zip(unknowns, x, strict=True)])
        errors = self._measured - values[:, self._window]
        slopes = -tangents[:, :, self._window] * slope[:, None, None]
        if self.problem.offsets:
            errors -= errors.mean(axis=-1, keepdims=True)
            slopes -= slopes.mean(axis=-1, keepdims=True)
        residuals = (errors * self._weight[:, None]).ravel()
        jacobian = (slopes * self._weight[:, None]).reshape(len(x), -1).T
        self._report(
            Minimum(x=x.copy(), residuals=residuals, jacobian=jacobian, converged=False, evaluations=self.evaluations)
        )
        return residuals, jacobian

    def _report(self, here: Minimum) -> None:
        budget = self.problem.starts * self.problem.max_evaluations
        # nobody knows how many steps are left: most searches need a quarter of their budget
        done = self.evaluations / (self.evaluations + 0.25 * budget)
        self.monitor.progress(
            done,
            f"simulation {self.evaluations}: rms error {100 * math.sqrt(2 * here.cost):.3f} % of the output's spread",
        )
        if self.best is None or here.cost < self.best.cost:
            self.best = here
            values = {u.parameter: u.value(float(c)) for u, c in zip(self.problem.unknowns, here.x, strict=True)}
            self.monitor.best(self.evaluations, here.cost, 0.0, values)


def _elsewhere(unknowns: tuple[Unknown, ...], rng: np.random.Generator) -> Samples:
    """Return a random start: anywhere within finite bounds, else within a decade of the given start."""
    x = []
    for unknown in unknowns:
        if math.isfinite(unknown.lower) and math.isfinite(unknown.upper):
            low, high = unknown.coordinate(unknown.lower), unknown.coordinate(unknown.upper)
            x.append(float(rng.uniform(low, high)))
        else:
            value = (unknown.start or 1.0) * 10 ** float(rng.uniform(-1, 1))
            x.append(unknown.coordinate(min(max(value, unknown.lower), unknown.upper)))
    return np.array(x)


def _fits(
    problem: Identification, simulated: Mapping[str, Samples], offsets: Mapping[str, float], window: Window | None
) -> dict[str, Fit]:
    if window is None:
        return {}
    part = problem.recording.within(window)
    return {
        name: compare(problem.recording.outputs[name][part], y[part] + offsets[name]) for name, y in simulated.items()
    }


def _covariance(found: Minimum, signals: int) -> Samples:
    return covariance(found.jacobian.reshape(signals, -1, len(found.x)), found.residuals.reshape(signals, -1))


def _interval(unknown: Unknown, x: float, deviation: float) -> tuple[float, float]:
    """Return the 95 % interval of the value, not cut at the bounds."""
    reach = NORMAL_95 * deviation
    if unknown.log:
        return math.exp(max(x - reach, -700.0)), math.exp(min(x + reach, 700.0))
    return x - reach, x + reach


def _estimate(unknown: Unknown, x: float, deviation: float | None) -> Estimate:
    lower: float | None = None
    upper: float | None = None
    if deviation is not None:
        low, high = _interval(unknown, x, deviation)
        lower, upper = max(low, unknown.lower), min(high, unknown.upper)
    return Estimate(value=unknown.value(x), unit=unknown.unit, lower95=lower, upper95=upper, start=unknown.start)


def _sentences(unknowns: tuple[Unknown, ...], x: Samples, cov: Samples) -> list[str]:
    """Say what the recording cannot tell."""
    said = []
    matrix = correlations(cov)
    values = [u.value(float(c)) for u, c in zip(unknowns, x, strict=True)]
    slope = np.array([u.slope(float(c)) for u, c in zip(unknowns, x, strict=True)])
    linear = cov * np.outer(slope, slope)
    for i, first in enumerate(unknowns):
        for j, second in enumerate(unknowns[:i]):
            if abs(matrix[i, j]) <= STRONG_CORRELATION:
                continue
            sentence = (
                f"{second.parameter} and {first.parameter} are hard to tell apart (correlation {matrix[i, j]:.3f})"
            )
            if matrix[i, j] < 0 and first.unit == second.unit:
                spread = NORMAL_95 * math.sqrt(max(linear[i, i] + linear[j, j] + 2 * linear[i, j], 0.0))
                sentence += f": their sum {values[i] + values[j]:.4g} {first.unit} is known to ± {spread:.2g}"
            said.append(sentence)
    for unknown, c, variance in zip(unknowns, x, np.diag(cov), strict=True):
        low, high = _interval(unknown, float(c), math.sqrt(variance))
        interval = f"its 95 % interval reaches from {max(low, unknown.lower):.3g} to {min(high, unknown.upper):.3g} {unknown.unit}".rstrip()
        if low <= unknown.lower and high >= unknown.upper:
            said.append(f"{unknown.parameter} is not determined within its bounds: {interval}")
        elif not unknown.log and low <= 0 <= high:
            said.append(f"{unknown.parameter} cannot be told from 0: {interval}")
    return said


def _advice(status: Status, unknowns: tuple[Unknown, ...], x: Samples, indistinguishable: tuple[str, ...]) -> str:
    if status is Status.STALLED:
        return "The model has no bounded response at any start: choose starts (or fixed parameters) where it is stable."
    said = []
    if status is Status.CANCELLED:
        said.append("Cancelled: these are the best values met before.")
    if status is Status.BUDGET:
        said.append("The search had not settled when its evaluations were used up: start nearer, or narrow the bounds.")
    for unknown, c in zip(unknowns, x, strict=True):
        value = unknown.value(float(c))
        for side, bound in (("lower", unknown.lower), ("upper", unknown.upper)):
            if value == bound == 0:
                said.append(f"{unknown.parameter} came to rest at 0: the recording shows none of it.")
            elif math.isfinite(bound) and math.isclose(value, bound, rel_tol=1e-9):
                limit = f"{bound:.4g} {unknown.unit}".rstrip()
                said.append(
                    f"{unknown.parameter} came to rest at its {side} bound {limit}: the recording asks for more room."
                )
    if indistinguishable:
        said.append(
            "Fix one of the parameters that are hard to tell apart, or design for every combination that the intervals allow."
        )
    return " ".join(said)
