"""Answers of nonlinear diagrams marched in equal steps, all neighbours at once: the slopes are differences of them.

    ∂y/∂p_k ≈ (y(p + δ_k e_k) - y(p)) / δ_k,   δ_k = 1e-6 |p_k|

A march with steps of one length is a smooth map of the parameters, so that tiny differences are slopes to six digits. Every
answer is marched with twice the step, too: where the two differ by more than the tolerance, the steps were too coarse for
what is stiff in the model, and are halved. What is too stiff even then is left to the exact path.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from time import monotonic
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.nonlinear.equations import Equations
from engine.batch.nonlinear.lookback import nowhere
from engine.batch.nonlinear.march import Marcher, Pieces
from engine.batch.nonlinear.program import Compiled
from engine.exact.nonlinear.operating_point import operating_point
from engine.model.between_samples import polynomials, told
from engine.model.tangent import INFINITESIMAL, slopes
from engine.model.traced import UnsuitableError
from optimizers.identification.answers import Answer, Samples
from optimizers.identification.exact import ExactModel

if TYPE_CHECKING:
    from engine.diagram.diagram import Diagram
    from optimizers.recorded.recording import RecordedExperiment, Unknown

Array = npt.NDArray[Any]

SEARCHED: Final = 1e-4
"""Largest difference of two marches, relative to the largest value, while parameters are searched,"""
SHOWN: Final = 1e-6
"""and when a response is shown."""
_DIFFERENCE: Final = 1e-6
_COARSEST: Final = 2
_FINEST: Final = 1 << 12
"""Steps from one sample to the next."""
_STIFFER: Final = 64
"""Steps of a trial may be so much shorter than they were before."""
_MOST_STEPS: Final = 1 << 24
"""Steps of a whole response."""
_FEWEST_FOLLOWED: Final = 8
_ALIKE: Final = 1e-2
"""Samples, and how near to each other, that two marches of a response that grows must show."""
_ROWS: Final = 1 << 17
"""Rows of a table of inputs at a time."""


class Structure:
    """The formulas of a diagram, shared by all of its experiments.

    Parameters
    ----------
    diagram : Diagram
    unknowns : sequence of Unknown
    experiments : sequence of RecordedExperiment

    Raises
    ------
    UnsuitableError
        If the diagram has delays, or a law that is no formula of the instant.
    """

    def __init__(
        self, diagram: Diagram, unknowns: Sequence[Unknown], experiments: Sequence[RecordedExperiment]
    ) -> None:
        known = dict.fromkeys(name for experiment in experiments for name in experiment.values)
        self.diagram = diagram
        self.unknowns = tuple(unknowns)
        self.varied = (*(unknown.parameter for unknown in unknowns), *known)
        self.equations = Equations.of(diagram, self.varied)
        if self.equations.delays or self.equations.changes.modes:
            raise UnsuitableError("delays, or modes that are remembered")
        nominal = diagram.laws().start[0].real
        self.compiled: dict[tuple[str, ...], tuple[Compiled, Marcher]] = {}
        if len(nominal) != len(self.equations.states):
            raise UnsuitableError("states that not all parameter values have")
        for experiment in experiments:
            outputs = tuple(experiment.recording.outputs)
            if outputs not in self.compiled:
                program = Compiled(self.equations, [diagram.outputs.index(name) for name in outputs])
                self.compiled[outputs] = program, Marcher(program).prepared()


class MarchedModel:
    """A nonlinear diagram driven by one recording; ``initial`` and ``clock`` are those of :class:`ExactModel`."""

    def __init__(
        self,
        structure: Structure,
        experiment: RecordedExperiment,
        *,
        initial: bool,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        recording, diagram = experiment.recording, structure.diagram
        self._structure = structure
        self._compiled, self._marcher = structure.compiled[tuple(recording.outputs)]
        self._clock = clock
        self._exact = ExactModel(diagram, experiment, initial=initial, clock=clock)
        self.states = self._exact.states
        self._known = {
            name: experiment.values.get(name, diagram.parameters[name].value)
            for name in structure.varied[len(structure.unknowns) :]
        }
        self._h, self._samples = recording.sample_time, recording.samples
        self._inputs = np.zeros((len(diagram.inputs), self._samples))
        for name, signal in recording.inputs.items():
            self._inputs[diagram.inputs.index(name)] = signal
        ways = told(recording.between_samples, diagram.inputs)
        self._powers = [polynomials(row, way) for row, way in zip(self._inputs, ways, strict=True)]
        self._stride, self._followed, self._stiff = _COARSEST, False, False

    def answer(self, values: Mapping[str, float], deviation: Samples) -> Answer:
        """Return the response with its slopes; on the exact path where the model is too stiff for marches from the beginning."""
        if not self._stiff:
            found = self._march(values, deviation)
            if found is not None:
                self._followed = True
                return found
            if self._followed:
                return self._nothing(len(values))  # a trial far stiffer than the others is not worth their time
            self._stiff = True
        return self._exact.answer(values, deviation)

    def shown(self, values: Mapping[str, float], deviation: Samples) -> Answer:
        """Return the response without slopes; on the exact path where marches do not come near enough to it."""
        found = None if self._stiff else self._march(values, deviation, final=True)
        return self._exact.shown(values, deviation) if found is None else found

    def _march(self, values: Mapping[str, float], deviation: Samples, *, final: bool = False) -> Answer | None:
        """Return the response, None where steps would have to be too short; without slopes when it is final."""
        base, steps = self._candidates(values, deviation, final=final)
        alone = base.first
        tolerance = SHOWN if final else SEARCHED
        stride = self._stride
        finest = min(_FINEST, _STIFFER * stride) if self._followed and not final else _FINEST
        coarse, fine = self._run(alone, stride // 2), self._run(alone, stride)
        while not _agree(fine, coarse, tolerance):
            if _grows(fine, coarse):
                return self._nothing(len(values))
            stride *= 2
            if stride > finest or stride * self._samples > _MOST_STEPS:
                return None
            coarse, fine = fine, self._run(alone, stride)
        if final:
            return Answer(values=fine[..., 0], slopes=np.zeros((len(values) + self.states, *fine.shape[:2])))
        self._stride = stride
        around = self._run(base, stride)
        gradient = (around[..., 1:] - around[..., :1]) / steps
        return Answer(values=around[..., 0], slopes=np.moveaxis(gradient, -1, 0))

    def _candidates(self, values: Mapping[str, float], deviation: Samples, *, final: bool) -> tuple[_Batch, Samples]:
        """Return the model and, unless it is final, its neighbours, and how far away these are."""
        own = np.array([*values.values(), *self._known.values()])
        moved = np.array(
            [_away(u.lower, u.upper, u.start, v) for u, v in zip(self._structure.unknowns, own, strict=False)]
        )
        count = 0 if final else len(moved) + self.states
        points = np.repeat(own[None], 1 + count, axis=0)
        if not final:
            points[1 + np.arange(len(moved)), np.arange(len(moved))] += moved
        starts, once, _, _ = self._compiled.start(points)
        laws = self._structure.diagram.laws(
            {**self._known, **values}, None if final else dict.fromkeys(values, INFINITESIMAL)
        )
        first = dict(zip(laws.inputs, self._inputs[:, 0].tolist(), strict=True))
        point = operating_point(laws, first)
        if point.rests:
            starts[:] = point.x[0].real[:, None]
            if not final:
                starts[:, 1 : 1 + len(moved)] += (slopes(point.x) * moved[:, None]).T
        if not self.states:
            return _Batch(starts, once), moved
        starts += deviation[:, None]
        ended = np.zeros(self.states)
        if not final:
            self._run(_Batch(starts[:, :1], once[:, :1]), self._stride, ended)
        nudges = _DIFFERENCE * np.maximum(np.abs(starts[:, 0]), np.maximum(ended, 1e-9))
        if not final:
            starts[np.arange(self.states), 1 + len(moved) + np.arange(self.states)] += nudges
        return _Batch(starts, once), np.concatenate([moved, nudges])

    def _run(self, batch: _Batch, stride: int, reached: Samples | None = None) -> Samples:
        """Return the outputs at the samples, (outputs, samples, B); ``reached`` takes the largest states seen."""
        width = max(1, _ROWS // (2 * stride))
        states, parts = batch.starts, []
        for begin in range(0, self._samples - 1, width):
            self._clock()
            count = min(width, self._samples - 1 - begin)
            table = self._table(begin, begin + count, stride)
            piece = Pieces(
                edges=self._h * np.array([0.0, count]), samples=np.array([count]), stride=stride, inputs=[table],
                lookbacks=[nowhere(len(table))], breaks=[False],
            )  # fmt: skip
            marched = self._marcher(states, batch.once, piece)
            # a law that has left what its formula covers is no response, however finite it looks
            values = np.where(marched.covered, marched.values, np.inf)
            parts.append(values if not begin else values[:, 1:])
            states = marched.states
            if reached is not None:
                np.fmax(reached, np.abs(states[:, 0]), out=reached)
            if not marched.covered[0]:
                left = self._samples - begin - count - 1
                parts.append(np.full((values.shape[0], left, values.shape[2]), np.inf))
                break
        return np.concatenate(parts, axis=1)

    def _table(self, first: int, last: int, stride: int) -> Samples:
        """Return inputs and their slopes from one sample to another, as `Pieces` wants them."""
        parts = (np.arange(stride)[:, None] + np.array([0.0, 0.5, 1.0])).ravel() / stride
        values, rates = [], []
        for powers, row in zip(self._powers, self._inputs, strict=True):
            value = rate = np.zeros((last - first, parts.size))
            for own in powers[::-1, first:last, None]:  # Horner's scheme, and its derivative
                rate, value = rate * parts + value, value * parts + own
            values.append(np.append(value, row[last]))
            rates.append(np.append(rate, rate[-1, -1]) / self._h)
        return np.ascontiguousarray(np.array([*values, *rates]).T)

    def _nothing(self, parameters: int) -> Answer:
        infinite = np.full((len(self._compiled.program.read) // 2, self._samples), np.inf)
        return Answer(values=infinite, slopes=np.zeros((parameters + self.states, *infinite.shape)))


class _Batch:
    """Candidates: where they start, (states, B), and what is computed once for each, (·, B)."""

    def __init__(self, starts: Samples, once: Samples) -> None:
        self.starts, self.once = np.ascontiguousarray(starts), np.ascontiguousarray(once)

    @property
    def first(self) -> _Batch:
        """The first one alone."""
        return _Batch(self.starts[:, :1], self.once[:, :1])


def _agree(fine: Samples, coarse: Samples, tolerance: float) -> bool:
    """Tell whether two marches show the same, relative to the largest value of each output; never true of infinity."""
    with np.errstate(invalid="ignore"):
        apart, size = np.abs(fine - coarse).max(axis=(1, 2)), np.abs(fine).max(axis=(1, 2))
    return bool((np.isfinite(size) & (apart <= tolerance * size)).all())


def _grows(fine: Samples, coarse: Samples) -> bool:
    """Tell whether a response grows beyond all numbers by itself: two marches show the same on the way there.

    Where steps are too long for what is stiff, they differ from the beginning.
    """
    followed = np.isfinite(fine).all(axis=(0, 2)) & np.isfinite(coarse).all(axis=(0, 2))
    end = int(np.argmin(followed)) if not followed.all() else 0
    return end > _FEWEST_FOLLOWED and _agree(fine[:, : end // 2], coarse[:, : end // 2], _ALIKE)


def _away(lower: float, upper: float, start: float, value: float) -> float:
    """Return how far a neighbour is: within the bounds."""
    step = _DIFFERENCE * (abs(value) or abs(start) or (min(upper - lower, 1.0)))
    return step if value + step <= upper else -step
