"""Fast metrics of many candidates of one diagram: what an optimiser looks at, never what a user is shown.

Batched numpy: step responses as piecewise polynomials with exact delays (``screening_march``), their metrics
(``screening_time``), frequency metrics (``screening_frequency``). Complex overrides carry derivatives through:
``parameter * (1 + 1e-30j)`` gives d metric / d ln parameter in the imaginary part, divided by 1e-30.

A candidate that cannot be vouched for is flagged ``doubtful``; what screening cannot measure at all (commands other than
steps, delays of different length, integrals over a limited time, metrics without a batched form) is said in advance by
:attr:`Screening.measurable`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.batch.collocation.frequency import LOOP_METRICS, PATH_METRICS
from engine.batch.collocation.march import Lanes, Mesh, Responses, balance, march
from engine.batch.collocation.masks import LOOP_MASKS, PATH_MASKS, TIME_MASKS, ratio
from engine.batch.collocation.scan import Path, Scan
from engine.batch.collocation.time import METRICS as TIME_METRICS
from engine.batch.collocation.time import Readings, last_entry
from engine.batch.collocation.trace import Trace
from engine.batch.linear.generator import eigenvalues_of
from engine.batch.linear.poles import growth_of

if TYPE_CHECKING:
    from engine.analysis.study import MetricRequest
    from engine.diagram.diagram import Diagram
    from engine.model.linear_system import Array, StackedSystem
    from engine.signals import Signal

RESOLVED = 1e-6
"""Largest share of the highest polynomial coefficient at which a response counts as resolved."""
_CHUNK = 256
_MOST_OCTAVES = 10
_RESOLVED_PHASE = 4.0
_FINER = ((2, 6, _CHUNK), (2, 9, 16))
"""What is tried where a response is not resolved: pieces cut in so many, so many octaves fine, so many candidates at once."""
_RINGING = 0.35
"""Damping ratio below which an oscillation outlives the fine pieces."""
_INTEGRALS = frozenset({"iae", "ise", "itae"})
_MARGINAL = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Screened:
    """Metrics of B candidates.

    Attributes
    ----------
    values : ndarray, shape (B, R)
        Metrics in SI; complex where the overrides are. Infinite where a frequency metric never crosses, NaN where there
        is no value.
    doubtful : ndarray of bool, shape (B, R)
        The exact path has to decide.
    growth : ndarray, shape (B,)
        Real part of the rightmost characteristic root of the closed system (1/s), about; >= 0: unstable, no values; NaN: not known.
    valid : ndarray of bool, shape (B,)
        The system exists at these parameters.
    """

    values: Array
    doubtful: npt.NDArray[np.bool_]
    growth: npt.NDArray[np.float64]
    valid: npt.NDArray[np.bool_]

    @classmethod
    def unknown(cls, members: int, requests: int, *, dtype: type[float | complex] = float) -> Screened:
        """Return candidates of which nothing is known: every value belongs to the exact path."""
        return cls(
            values=np.full((members, requests), np.nan, dtype=dtype), doubtful=np.ones((members, requests), dtype=bool),
            growth=np.full(members, np.nan), valid=np.ones(members, dtype=bool),
        )  # fmt: skip


class Screening:
    """The batched evaluator of some metrics of a diagram.

    Parameters
    ----------
    diagram : Diagram
    requests : sequence of MetricRequest
    """

    def __init__(self, diagram: Diagram, requests: Sequence[MetricRequest]) -> None:
        self._diagram = diagram
        self._requests = tuple(requests)
        self.measurable = tuple(self._is_measurable(request) for request in requests)
        self._commands: list[Array] = []
        self._experiment: dict[int, int] = {}
        self._outputs: list[int] = []
        for index, request in enumerate(self._requests):
            if self.measurable[index] and (request.metric in TIME_METRICS or request.metric in TIME_MASKS):
                self._register(index, request)

    def __call__(self, overrides: Mapping[str, Array]) -> Screened:
        """Return the metrics for arrays (B,) of parameter values; those that are not measurable stay NaN and doubtful."""
        (batch,) = {len(values) for values in overrides.values()}
        complex_lanes = any(np.iscomplexobj(values) for values in overrides.values())
        found = Screened.unknown(batch, len(self._requests), dtype=complex if complex_lanes else float)
        if self._diagram.nonlinear:  # there is no exponential to march with: every value is found one by one
            return found
        values, doubtful, growth, valid = found.values, found.doubtful, found.growth, found.valid
        doubtful[:], valid[:] = ~np.array(self.measurable, dtype=bool), False
        for start in range(0, batch, _CHUNK):
            span = slice(start, min(start + _CHUNK, batch))
            part = {name: column[span] for name, column in overrides.items()}
            self._chunk(part, values[span], doubtful[span], growth[span], valid[span])
        return found

    def _is_measurable(self, request: MetricRequest) -> bool:
        if request.opened_besides or not request.as_told(self._diagram):
            return False
        if request.metric in LOOP_METRICS or request.metric in PATH_METRICS:
            return True
        if request.mask is not None and (request.metric in LOOP_MASKS or request.metric in PATH_MASKS):
            return True
        timed = request.metric in TIME_METRICS or (request.metric in TIME_MASKS and request.mask is not None)
        if not timed or not request.signals:
            return False
        if request.windowed or (request.duration is not None and request.metric in _INTEGRALS):
            return False
        return len({step[0] for step in map(_step, request.signals.values()) if step}) == 1 and all(
            _step(signal) is not None for signal in request.signals.values()
        )

    def _register(self, index: int, request: MetricRequest) -> None:
        assert request.signals is not None
        command = np.zeros(len(self._diagram.inputs))
        for port, signal in request.signals.items():
            step = _step(signal)
            assert step is not None
            command[self._diagram.inputs.index(port)] = step[1]
        for number, known in enumerate(self._commands):
            if np.array_equal(known, command):
                self._experiment[index] = number
                break
        else:
            self._experiment[index] = len(self._commands)
            self._commands.append(command)
        assert request.output is not None
        output = self._diagram.outputs.index(request.output)
        if output not in self._outputs:
            self._outputs.append(output)

    def _chunk(
        self, overrides: Mapping[str, Array], values: Array, doubtful: Array, growth: Array, valid: Array
    ) -> None:
        stack = self._diagram.realize_stack(overrides)
        valid[:] = stack.valid
        here = np.flatnonzero(stack.valid)
        if not here.size:
            return
        if not stack.a.shape[1] and not stack.delays.shape[1]:
            # Nothing moves by itself: no width of time to march over.
            doubtful[here], growth[here] = True, -np.inf
            return
        if not self._experiment:
            self._without_time(stack, overrides, here, values, doubtful, growth=growth)
            return
        lanes, equal = self._lanes(stack, here)
        doubtful[here[~equal]] = True
        here = here[equal]
        if not here.size:
            return
        lanes = lanes.take(np.flatnonzero(equal))
        octaves, ringing = _octaves(lanes)
        for level, rings in np.unique(np.stack([octaves, ringing], axis=1), axis=0):
            chosen = np.flatnonzero((octaves == level) & (ringing == rings))
            run = march(lanes.take(chosen), Mesh.graded(int(level)), detail=5 if rings else 3)
            growth[here[chosen]] = run.growth
            unsure = ~run.settled & ~(run.growth * run.width.real > _MARGINAL)
            doubtful[np.ix_(here[chosen[unsure]], np.array(list(self._experiment), dtype=int))] = True
            coarse = run.settled & ~_resolved(run)
            self._read_time(run, here[chosen], run.settled & ~coarse, values, doubtful)
            again = chosen[coarse]
            for split, detail, most in _FINER:
                left: list[Array] = []
                for first in range(0, len(again), most):
                    those = again[first : first + most]
                    finer = march(lanes.take(those), Mesh.graded(int(level) + 1, split=split), detail=detail)
                    left.append(those[~_resolved(finer)])
                    self._read_time(finer, here[those], finer.settled, values, doubtful)
                again = np.concatenate(left) if left else again[:0]
        # An eigenvalue of 1 to rounding, or too near to tell: an integrator beside the path, or the edge of stability. Not for
        # screening.
        edge = ~(np.abs(growth[here] * lanes.width.real) >= _MARGINAL)
        doubtful[here[edge]] = True
        stable = here[growth[here] < 0]
        if stable.size:
            self._read_frequency(stack, overrides, stable, values, doubtful, growth=growth)

    def _without_time(
        self, stack: StackedSystem, overrides: Mapping[str, Array], here: Array, values: Array, doubtful: Array, *,
        growth: Array,
    ) -> None:  # fmt: skip
        """Write the frequency metrics where nothing else is asked: poles alone tell who is stable, with delays of any lengths."""
        told = (stack.delays[here].real > 0).all(axis=1) & ~np.any(stack.x0[here] != 0, axis=1)
        doubtful[here[~told]] = True
        here = here[told]
        if not here.size:
            return
        flow = [np.asarray(part[here].real) for part in (stack.a, stack.b2, stack.c2, stack.d22, stack.delays)]
        roots = eigenvalues_of(*flow) if stack.delays.shape[1] else np.linalg.eigvals(flow[0])
        growth[here] = growth_of(roots)
        doubtful[here[np.isnan(growth[here])]] = True
        stable = here[growth[here] < 0]
        if stable.size:
            self._read_frequency(stack, overrides, stable, values, doubtful, growth=growth)

    def _lanes(self, stack: StackedSystem, here: Array) -> tuple[Lanes, Array]:
        """Return what a march needs, and for which candidates all delays are equal."""
        scale = balance(stack.a[here])
        a = stack.a[here] * scale[:, None, :] / scale[:, :, None]
        command = np.stack(self._commands, axis=1)
        c1, d11, d12 = (array[here][:, self._outputs] for array in (stack.c1, stack.d11, stack.d12))
        c = np.concatenate([c1, stack.c2[here]], axis=1) * scale[:, None, :]
        direct = np.concatenate([d11, stack.d21[here]], axis=1)
        through = np.concatenate([d12, stack.d22[here]], axis=1)
        delays = stack.delays[here]
        equal = ~np.any(stack.x0[here] != 0, axis=1)
        if delays.shape[1]:
            width = delays[:, 0]
            spread = (
                np.abs((delays - width[:, None]).real).max(axis=1)
                + np.abs((delays - width[:, None]).imag).max(axis=1) * 1e30
            )
            equal &= (spread <= 1e-12 * width.real) & (width.real > 0)
        else:
            fastest = np.abs(np.linalg.eigvals(a.real)).max(axis=1, initial=0.0)
            width = _RESOLVED_PHASE / np.where(fastest > 0, fastest, _RESOLVED_PHASE)
        lanes = Lanes(
            a=a, b=stack.b1[here] @ command / scale[:, :, None], b2=stack.b2[here] / scale[:, :, None],
            c=c, d=direct @ command, dw=through, width=width,
        )  # fmt: skip
        return lanes, equal

    def _read_time(self, run: Responses, index: Array, which: Array, values: Array, doubtful: Array) -> None:
        """Write the time metrics of the responses ``which`` of a run into the rows ``index`` of the candidates."""
        if not which.any():
            return
        part, rows = run.take(which), index[which]
        known: dict[tuple[object, ...], Readings] = {}
        for column, experiment in self._experiment.items():
            request = self._requests[column]
            assert request.output is not None
            output = self._outputs.index(self._diagram.outputs.index(request.output))
            metric = _reading(request)
            key = (experiment, output, request.metric, request.mask, request.options)
            if key not in known:
                command = self._commands[experiment]
                roles = self._diagram.references.roles
                reference = sum(
                    value
                    for name, value in zip(self._diagram.inputs, command, strict=True)
                    if roles[name] == "reference"
                )
                known[key] = metric(Trace.of(part, experiment, output, np.asarray(reference, dtype=float)))
            found = known[key]
            values[rows, column] = found.value
            doubtful[rows, column] = found.doubtful | (part.resolution[:, experiment, output] > RESOLVED)

    def _read_frequency(
        self, stack: StackedSystem, overrides: Mapping[str, Array], here: Array, values: Array, doubtful: Array,
        *, growth: Array,
    ) -> None:  # fmt: skip
        scans: dict[tuple[object, ...], tuple[Path, Scan]] = {}
        for index, request in enumerate(self._requests):
            loop = request.metric in LOOP_METRICS or request.metric in LOOP_MASKS
            if not self.measurable[index] or not (
                loop or request.metric in PATH_METRICS or request.metric in PATH_MASKS
            ):
                continue
            key = (request.open_at,) if loop else (request.source, request.target)
            if key not in scans:
                if loop:
                    opened = self._diagram.realize_stack(overrides, open_at=request.open_at)
                    path = _path(opened, here, "loop", "loop", sign=-1.0)
                else:
                    assert request.source is not None
                    assert request.target is not None
                    path = _path(stack, here, request.source, request.target, sign=1.0)
                scans[key] = path, Scan(path)
            path, scan = scans[key]
            if request.mask is not None:
                quantity = (LOOP_MASKS if loop else PATH_MASKS)[request.metric]
                found = ratio(path, scan, request.mask, quantity)
            else:
                metric = LOOP_METRICS[request.metric] if loop else PATH_METRICS[request.metric]
                found = metric(path, scan)
            values[here, index] = found.value if np.iscomplexobj(values) else found.value.real
            # What is slower than the lowest frequency of the table crosses and bends below it.
            doubtful[here, index] = found.doubtful | (np.abs(growth[here]) < scan.frequencies[:, 0])


def _reading(request: MetricRequest) -> Callable[[Trace], Readings]:
    """Return what reads a time metric off a response."""
    if not request.usual:  # of another band
        return partial(last_entry, band=request.options.settling_band)
    if request.mask is None:
        return TIME_METRICS[request.metric]
    mask, held = request.mask, TIME_MASKS[request.metric]
    start = next(step[0] for step in map(_step, request.signals.values()) if step)
    return lambda trace: held(trace, mask, start)


def _step(signal: Signal) -> tuple[float, float] | None:
    """Return (start, amplitude) of a command that is one step, None for any other."""
    points, final = signal.breakpoints(), signal.final()
    if signal.degree() != 0 or len(points) != 1 or final is None:
        return None
    return points[0], final


def _resolved(run: Responses) -> Array:
    return np.asarray((run.resolution <= RESOLVED).all(axis=(1, 2)))


def _octaves(lanes: Lanes) -> tuple[Array, Array]:
    """Return how often the interval must be halved until its first piece resolves the fastest mode, and who rings, (B,).

    A mode of low damping is still there when the pieces have grown beyond its period, so it needs more of them.
    """
    modes = np.linalg.eigvals(lanes.a.real)
    size = np.abs(modes)
    phase = np.maximum(size.max(axis=1, initial=0.0) * lanes.width.real, 1e-300)
    octaves = np.clip(np.ceil(np.log2(phase / _RESOLVED_PHASE)), 2, _MOST_OCTAVES)
    swings = (np.abs(modes.real) < _RINGING * size) & (size * lanes.width.real[:, None] > 1)
    return octaves.astype(int), swings.any(axis=1).astype(int)


def _path(stack: StackedSystem, here: Array, source: str, target: str, *, sign: float) -> Path:
    """Return one path of the candidates ``here``, balanced."""
    i, o = stack.inputs.index(source), stack.outputs.index(target)
    scale = balance(stack.a[here])
    b = np.concatenate([stack.b1[here][:, :, i : i + 1], stack.b2[here]], axis=2) / scale[:, :, None]
    c = np.concatenate([sign * stack.c1[here][:, o : o + 1], stack.c2[here]], axis=1) * scale[:, None, :]
    top = np.concatenate(
        [sign * stack.d11[here][:, o : o + 1, i : i + 1], sign * stack.d12[here][:, o : o + 1]], axis=2
    )
    bottom = np.concatenate([stack.d21[here][:, :, i : i + 1], stack.d22[here]], axis=2)
    return Path(
        a=stack.a[here] * scale[:, None, :] / scale[:, :, None], b=b, c=c,
        d=np.concatenate([top, bottom], axis=1), delays=stack.delays[here],
    )  # fmt: skip
