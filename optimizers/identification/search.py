"""The errors of all experiments as least squares wants them, and the best point so far.

    minimize over p   Σ_e Σ_o Σ_t (y_eo(t) - ŷ_eo(t; p))² / (n_e var y_eo),   t in the estimation windows

Every output of every experiment counts alike, whatever its unit, its size and its length. Measured frequency responses are
compared relative to their own size, each line by its standard deviation; where they stand beside other signals, the search
goes on with every output weighted by the variance that is left of it.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import pairwise
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from engine.model.errors import EngineError
from engine.model.traced import UnsuitableError
from optimizers.identification.answers import Answer, Model, Samples
from optimizers.identification.comparison import Comparison, Errors, Part
from optimizers.identification.exact import ExactModel
from optimizers.identification.frequency import FrequencyComparison
from optimizers.identification.linear import LinearModel
from optimizers.identification.marched import MarchedModel, Structure
from optimizers.methods.least_squares import Minimum

if TYPE_CHECKING:
    from optimizers.recorded.recording import Identification, RecordedExperiment
    from optimizers.search.result import Monitor

S = TypeVar("S")
T = TypeVar("T")


class CancelledError(Exception):
    """The monitor wants the search to end."""


class Search:
    """All experiments of an identification with their models."""

    def __init__(self, problem: Identification, monitor: Monitor) -> None:
        self.problem, self.monitor = problem, monitor
        self.evaluations = 0
        self.best: Minimum | None = None
        self.least_told = math.inf
        """Cost of the best point of which the monitor has heard."""
        self.stopped = False
        """Whether the monitor ended the search."""
        build = _models(problem, self._clock)
        self.comparisons = [Comparison(e, build(e), offsets=problem.offsets) for e in problem.experiments]
        self.responses = [
            FrequencyComparison(f, problem.diagram, problem.unknowns, clock=self._clock) for f in problem.frequency
        ]
        self._estimating: list[Part] = [
            *(c for c in self.comparisons if c.experiment.windows[0] is not None), *self.responses
        ]  # fmt: skip
        self._outputs = [shape for part in self._estimating for shape in part.signals]
        self._sizes = [parts * samples for parts, samples in self._outputs]
        self._weights: Samples | None = None
        """Of each output; None where all outputs count alike."""
        self.parameters = len(problem.unknowns)
        ends = np.cumsum([self.parameters, *(part.states for part in self._estimating)])
        self._states = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        self.coordinates = int(ends[-1])
        self._lock = threading.Lock()
        self._searching = False
        self._pool: ThreadPoolExecutor | None = None

    @property
    def samples(self) -> int:
        """Number of errors, of all outputs."""
        return sum(self._sizes)

    @contextmanager
    def workers(self) -> Iterator[None]:
        """Answer for several experiments at once, inside."""
        count = min(len(os.sched_getaffinity(0)), len(self.comparisons) + len(self.responses))
        if count < 2:
            yield
            return
        with ThreadPoolExecutor(count) as self._pool:
            yield
        self._pool = None

    def values(self, x: Samples) -> dict[str, float]:
        """Return the parameters at coordinates."""
        return {u.parameter: u.value(float(c)) for u, c in zip(self.problem.unknowns, x, strict=False)}

    def errors(self, x: Samples) -> tuple[Samples, Samples]:
        """Return residuals and Jacobian at the coordinates ``x``, infinite where the model has no usable response."""
        self._searching = True
        self.check()
        self.evaluations += 1
        found = self._each(lambda place: self._errors(place, x), range(len(self._estimating)))
        size = self.samples
        if any(errors is None for errors in found):
            return np.full(size, np.inf), np.zeros((size, len(x)))
        residuals, jacobian = np.concatenate([e.residuals for e in found if e]), np.zeros((size, len(x)))
        row = 0
        for errors, states in zip(found, self._states, strict=True):
            if errors is not None:
                rows = slice(row, row + errors.residuals.size)
                jacobian[rows, : self.parameters] = errors.jacobian[:, : self.parameters]
                jacobian[rows, states] = errors.jacobian[:, self.parameters :]
                row = rows.stop
        scale = 1 / math.sqrt(len(self._outputs))
        residuals, jacobian = residuals * scale, jacobian * scale
        if self._weights is not None:
            return residuals * self._weights, jacobian * self._weights[:, None]
        self._report(
            Minimum(x=x.copy(), residuals=residuals, jacobian=jacobian, converged=False, evaluations=self.evaluations)
        )
        return residuals, jacobian

    def answers(self, x: Samples) -> list[tuple[Answer, Samples] | None]:
        """Return the answer of every experiment as it is shown, with its deviation from rest; None where there is none."""
        values = self.values(x)
        self._searching = False  # what was found is shown, whoever has ended the search

        def answer(comparison: Comparison) -> tuple[Answer, Samples] | None:
            deviation = np.zeros(comparison.model.states)
            if comparison in self._estimating:
                deviation = x[self._states[self._estimating.index(comparison)]]
            try:
                found = comparison.model.shown(values, deviation)
            except EngineError:
                return None
            return (found, deviation) if np.isfinite(found.values).all() else None

        return self._each(answer, self.comparisons)

    def blocks(self, found: Minimum) -> tuple[list[Samples], list[Samples]]:
        """Return Jacobian and residuals of a minimum, output by output, as they were weighted at the end of the search."""
        weights = np.ones(sum(self._sizes)) if self._weights is None else self._weights
        cuts = np.cumsum(self._sizes)[:-1]
        residuals = np.split(found.residuals * weights, cuts)
        widths = [width for part in self._estimating for width in part.widths()]
        wider = [r.reshape(shape) * width for r, shape, width in zip(residuals, self._outputs, widths, strict=True)]
        return np.split(found.jacobian * weights[:, None], cuts), wider

    @property
    def weighs(self) -> bool:
        """Whether outputs are to count by what is left of them: where frequencies stand beside other signals."""
        return bool(self.responses) and len(self._outputs) > 1

    def weigh(self, found: Minimum) -> None:
        """Let each output count by the variance that is left of it: a combination of estimates is best so."""
        parts = np.split(found.residuals, np.cumsum(self._sizes)[:-1])
        left = np.array([np.linalg.norm(part) / math.sqrt(part.size) for part in parts])
        left = np.maximum(left, 1e-9 * max(float(left.max()), 1e-300))
        self._weights = np.repeat(float(left.min()) / left, self._sizes)

    @contextmanager
    def alike(self) -> Iterator[None]:
        """Let all outputs count alike inside."""
        weights, self._weights = self._weights, None
        try:
            yield
        finally:
            self._weights = weights

    def _errors(self, place: int, x: Samples) -> Errors | None:
        self.check()
        part, states = self._estimating[place], x[self._states[place]]
        unknowns = self.problem.unknowns
        slope = np.array([u.slope(float(c)) for u, c in zip(unknowns, x, strict=False)] + [1.0] * states.size)
        try:
            return part.errors(self.values(x), states, slope)
        except EngineError:
            return None  # an algebraic loop without a solution or a delay too short to follow: no model at these values

    def _each(self, function: Callable[[S], T], over: Iterable[S]) -> list[T]:
        return list(map(function, over) if self._pool is None else self._pool.map(function, over))

    def _clock(self) -> float:
        """Return the time (s); a response of the search that takes long is ended here when the monitor wants it."""
        if self._searching:
            self.check()
        return time.monotonic()

    def check(self) -> None:
        """End the search where the monitor wants it.

        Raises
        ------
        CancelledError
        """
        with self._lock:
            if self.monitor.cancelled():
                raise CancelledError

    def took(self, evaluations: int, found: Minimum | None) -> None:
        """Take note of what somebody else has found from a start."""
        self.evaluations += evaluations
        if found is not None:
            self._report(found)

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
        if here.cost < self.least_told:
            self.least_told = here.cost
            self.monitor.best(self.evaluations, here.cost, 0.0, self.values(here.x))


def _models(problem: Identification, clock: Callable[[], float]) -> Callable[[RecordedExperiment], Model]:
    """Return what makes the model of an experiment."""
    diagram, initial = problem.diagram, problem.initial_states
    if not diagram.nonlinear:
        return lambda experiment: LinearModel(diagram, experiment, initial=initial)
    try:
        structure = Structure(diagram, problem.unknowns, problem.experiments)
    except UnsuitableError:
        return lambda experiment: ExactModel(diagram, experiment, initial=initial, clock=clock)
    return lambda experiment: MarchedModel(structure, experiment, initial=initial, clock=clock)
