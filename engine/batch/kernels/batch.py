"""Metrics of many parameter sets of one diagram, by compiled kernels.

A `Batch` is made for a diagram, the parameters that vary and the metrics wanted. Making one takes milliseconds and compiles
nothing: the diagram becomes tapes and tables, which the kernels read. Candidates are evaluated in chunks on several threads.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels import spectrum_program as frequency_kernel
from engine.batch.kernels.assembly import Assembly
from engine.batch.kernels.compiled import LANES
from engine.batch.kernels.evaluate import evaluate
from engine.batch.kernels.events import READINGS as TIMED
from engine.batch.kernels.frequency_program import program, reals, tabulated
from engine.batch.kernels.readings import LOOP_READINGS, PATH_READINGS, TIME_READINGS, read, reading_list
from engine.batch.kernels.spectrum_program import CHUNK, SpectrumProgram
from engine.batch.kernels.tangents import differentiate
from engine.batch.kernels.tape import Registers
from engine.batch.kernels.time_program import TimePart, TimeProgram
from engine.batch.kernels.transfer import Curve, Curves, Network
from engine.diagram.diagram import LOOP

if TYPE_CHECKING:
    from engine.analysis.study import MetricRequest
    from engine.diagram.diagram import Diagram
    from engine.diagram.realize import Wiring
    from engine.signals import Signal

Real = npt.NDArray[np.float64]

MOST_STATES: Final = 64
_BLOCK: Final = 8192
"""At most so many candidates are one piece of work for a thread."""
NEIGHBOURS: Final = 128
"""Neighbours of whom those in doubt are looked at again together."""
_PER_DECADE: Final = 30
_EXTRA: Final = 3
"""How often the samples of a response are doubled where the usual ones leave doubt."""
_DENSITIES: Final = (1, 3, 12, 64)
"""How densely frequency is sampled, at first and where that is not enough, and so much further beyond the poles."""
_MARGIN: Final = 6.0
_DECADES: Final = 10.0
_NEAR_SINGULAR: Final = 1e-6
"""A divisor of an algebraic loop that is so much smaller than at the document's values leaves doubt."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Results:
    """Metrics of B candidates: ``values`` and ``doubtful`` (B, R), ``growth`` and ``valid`` (B,), as a screening gives them."""

    values: Real
    doubtful: npt.NDArray[np.bool_]
    growth: Real
    valid: npt.NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Slopes(Results):
    """Metrics of B candidates with ``slopes`` (B, R, D): their derivatives in D directions, NaN where there are none."""

    slopes: Real


@dataclass(frozen=True, kw_only=True, eq=False)
class _Readings:
    """What was read off the responses (B, T, READINGS) and curves (B, C, READINGS) of candidates."""

    responses: Real
    curves: Real


class UnsuitableError(Exception):
    """The kernels do not cover this diagram; the message says what they do not cover."""


class Batch:
    """The compiled evaluator of some metrics of a diagram.

    Parameters
    ----------
    diagram : Diagram
    varied : sequence of str
        Parameter paths, in the order of the columns of `__call__`.
    requests : sequence of MetricRequest

    Attributes
    ----------
    measured : tuple of bool
        Which requests it answers; the others stay NaN and doubtful.

    Raises
    ------
    UnsuitableError
        If the diagram has delays or nonlinear laws, or no dynamics or too many states on the paths asked about.
    """

    def __init__(self, diagram: Diagram, varied: Sequence[str], requests: Sequence[MetricRequest]) -> None:
        self.requests = tuple(requests)
        if diagram.nonlinear:
            raise UnsuitableError("nonlinear laws")
        traced = diagram.trace(varied)
        if any(block.delays.shape[-1] for block in traced.realizations):
            raise UnsuitableError("delays")
        if any(np.any(block.initial) for block in traced.realizations if block.initial is not None):
            raise UnsuitableError("states that are not at rest")
        closed = diagram.wiring()
        assembly = Assembly.of(traced, closed)
        self._timed: dict[int, tuple[int, str]] = {}
        self._framed: dict[int, tuple[int, str]] = {}
        traces: dict[tuple[int, int], int] = {}
        wants: list[int] = []
        commands: list[Mapping[int, float]] = []
        known: dict[tuple[tuple[int, float], ...], int] = {}
        outputs: list[int] = []
        references: list[float] = []
        for index, request in enumerate(self.requests):
            if (
                not request.usual
                or not request.as_told(diagram)
                or request.metric not in TIME_READINGS
                or (command := _steps(request.signals, diagram)) is None
            ):
                continue
            key = tuple(sorted(command.items()))
            if key not in known:
                known[key] = len(commands)
                commands.append({assembly.states + port: amplitude for port, amplitude in command.items()})
            output = diagram.outputs.index(str(request.output))
            if output not in outputs:
                outputs.append(output)
            trace = (outputs.index(output), known[key])
            if trace not in traces:
                traces[trace] = len(wants)
                wants.append(0)
                references.append(
                    sum(
                        a
                        for port, a in command.items()
                        if diagram.references.roles[diagram.inputs[port]] == "reference"
                    )
                )
            wants[traces[trace]] |= TIME_READINGS[request.metric]
            self._timed[index] = (traces[trace], request.metric)
        functions, bits, probes = self._frame(diagram, traced, assembly)
        part = TimePart(assembly, commands, outputs, probes)
        if not part.kept:
            raise UnsuitableError("no dynamics on the paths asked about")
        if len(part.kept) > MOST_STATES:
            raise UnsuitableError(f"more than {MOST_STATES} states on the paths asked about")
        targets, curves = functions
        wanted = [*part.numbers(), *reals(curves, targets), *(value for _, value in traced.bounds), *assembly.pivots]
        registers = Registers(traced.graph, wanted, len(varied))
        self._tape, self._count = registers.tape, registers.count
        self._bounds = np.array([(registers.of(v), p.lower_open) for p, v in traced.bounds], np.int32).reshape(-1, 2)
        limits = [(max(p.lower, -p.largest), min(p.upper, p.largest)) for p, _ in traced.bounds]
        self._limits = np.array(limits, dtype=float).reshape(-1, 2)
        self._pivots = np.array([registers.of(pivot) for pivot in assembly.pivots], dtype=np.int32)
        self._smallest = np.array([_NEAR_SINGULAR * abs(pivot.real) for pivot in assembly.pivots], dtype=float)
        self._time = part.program(registers, [(o, e, wants[t]) for (o, e), t in traces.items()])
        span = _span(diagram, traced)
        # The finer tables are made when they are needed for the first time.
        self._spectrum = cache(
            lambda density: _spectrum_program(curves, targets, bits, registers, _frequencies(*span, density))
        )
        self._no_spectrum = self._spectrum(1)._replace(wants=np.zeros(0, dtype=np.int32))
        self._no_time = self._time._replace(traces=np.zeros((0, 3), dtype=np.int32))
        self._of_time, self._of_curves = reading_list(self._timed), reading_list(self._framed)
        self._references = np.array(references or [0.0])
        self.measured = tuple(k in self._timed or k in self._framed for k in range(len(self.requests)))
        self._unmeasured = np.flatnonzero(~np.array(self.measured, dtype=bool))

    def _frame(self, diagram: Diagram, traced: Any, assembly: Assembly) -> Any:
        """Return the functions of frequency that are asked for, what of each, and the paths whose stability matters."""
        curves = Curves()
        networks = _Networks(curves, diagram, traced, self.requests)
        targets: dict[tuple[object, ...], int] = {}
        functions: list[Curve] = []
        bits: list[int] = []
        probes: list[tuple[int, int]] = []
        for index, request in enumerate(self.requests):
            loop = request.metric in LOOP_READINGS
            if request.opened_besides or (not loop and request.metric not in PATH_READINGS):
                continue
            key = (request.open_at,) if loop else (request.source, request.target)
            if key not in targets:
                made = (
                    networks.loop(str(request.open_at))
                    if loop
                    else networks.path(str(request.source), str(request.target))
                )
                if not isinstance(made, Curve):
                    continue  # a plain number: the exact path says what that means
                targets[key] = len(functions)
                functions.append(made)
                bits.append(0)
                probes += _probes(diagram, assembly, request, loop=loop)
            bits[targets[key]] |= (LOOP_READINGS if loop else PATH_READINGS)[request.metric]
            self._framed[index] = (targets[key], request.metric)
        return (functions, curves), bits, probes

    def __call__(
        self, points: Real, *, threads: int | None = None, then: Callable[[Results, slice], None] | None = None
    ) -> Results:
        """Return the metrics of candidates.

        Parameters
        ----------
        points : ndarray, shape (B, varied)
            Parameter values, SI.
        threads : int, optional
            As many as the machine has processors for this process by default.
        then : function, optional
            Called with every piece of the candidates that is found, on the thread that found it: no other one waits.
        """
        points = np.ascontiguousarray(points, dtype=float)
        total = len(points)
        results = self._nothing(total)
        available = threads or len(os.sched_getaffinity(0))
        spans = list(_spans(total, available))
        workers = min(available, len(spans))

        def work(span: slice) -> None:
            self._block(points, results, span)
            if then is not None:
                for part in _together(span):
                    then(results, part)

        if workers <= 1:
            for span in spans:
                work(span)
        else:
            with ThreadPoolExecutor(workers) as pool:
                for done in [pool.submit(work, span) for span in spans]:
                    done.result()
        return results

    def slopes(self, points: Real, directions: Real) -> Slopes:
        """Return the metrics of candidates with their exact derivatives.

        Parameters
        ----------
        points : ndarray, shape (B, varied)
            Parameter values, SI.
        directions : ndarray, shape (B, varied, D)
            By how much each parameter changes for the same infinitesimal change of D variables.
        """
        points = np.ascontiguousarray(points, dtype=float)
        results = self._nothing(len(points))
        readings = self._block(points, results, slice(0, len(points)))
        count = directions.shape[2]
        groups = -(-count // LANES)
        padded = np.zeros((*directions.shape[:2], groups * LANES))
        padded[:, :, :count] = directions
        found = np.full((len(points), len(self.requests), groups * LANES), np.nan)
        for first in range(0, groups * LANES, LANES):
            lanes = np.full((len(points), len(self.requests), LANES), np.nan)
            differentiate(
                self._tape, self._count, self._time, self._spectrum(1), self._of_time, self._of_curves, points,
                np.ascontiguousarray(padded[:, :, first : first + LANES]), readings.responses, readings.curves,
                results.growth, lanes,
            )  # fmt: skip
            found[:, :, first : first + LANES] = lanes
        return Slopes(
            values=results.values, doubtful=results.doubtful, growth=results.growth, valid=results.valid,
            slopes=found[:, :, :count],
        )  # fmt: skip

    def _nothing(self, total: int) -> Results:
        return Results(
            values=np.full((total, len(self.requests)), np.nan),
            doubtful=np.zeros((total, len(self.requests)), dtype=bool),
            growth=np.full(total, np.nan),
            valid=np.zeros(total, dtype=bool),
        )

    def _block(self, points: Real, results: Results, span: slice) -> _Readings:
        """Evaluate one block, and again with more samples or frequencies where the first look cannot vouch for it."""
        rows = np.arange(span.start, span.stop)
        readings = self._look(points, results, rows, self._time, self._spectrum(1))
        for part in _together(span):
            if results.doubtful[part].any():
                here = slice(part.start - span.start, part.stop - span.start)
                own = _Readings(responses=readings.responses[here], curves=readings.curves[here])
                self._look_again(points, results, part, own)
        if self._unmeasured.size:
            results.doubtful[span, self._unmeasured] = True
        return readings

    def _look_again(self, points: Real, results: Results, span: slice, readings: _Readings) -> None:
        """Evaluate those in doubt with more samples or frequencies."""
        rows, doubtful = np.arange(span.start, span.stop), results.doubtful[span]
        known = ~np.isnan(results.growth[span])
        again = np.flatnonzero(doubtful[:, self._of_time[:, 0]].any(axis=1) & known)
        if again.size:
            look = self._look(points, results, rows[again], self._time, self._no_spectrum, _EXTRA)
            readings.responses[again] = look.responses
        for density in _DENSITIES[1:]:
            again = np.flatnonzero(doubtful[:, self._of_curves[:, 0]].any(axis=1) & known)
            if again.size:
                look = self._look(points, results, rows[again], self._no_time, self._spectrum(density))
                readings.curves[again] = look.curves

    def _look(
        self, points: Real, results: Results, rows: Any, program: TimeProgram, spectrum: SpectrumProgram,
        extra: int = 0,
    ) -> _Readings:  # fmt: skip
        """Evaluate candidates and enter what the programs ask for."""
        size = len(rows)
        timed = np.full((size, len(program.traces), TIMED), np.nan)
        framed = np.full((size, len(spectrum.wants), frequency_kernel.READINGS), np.nan)
        growth, valid = np.full(size, np.nan), np.zeros(size)
        evaluate(
            self._tape, self._count, self._bounds, self._limits, self._pivots, self._smallest, program, spectrum,
            points[rows], timed, framed, growth, valid, extra,
        )  # fmt: skip
        results.growth[rows], results.valid[rows] = growth, valid > 0
        for wanted, found in ((self._of_time, timed), (self._of_curves, framed)):
            if found.shape[1]:
                read(
                    wanted, self._references, found, results.growth, results.valid, rows, results.values,
                    results.doubtful,
                )  # fmt: skip
        return _Readings(responses=timed, curves=framed)


def _spans(total: int, threads: int) -> Iterator[slice]:
    """Cut candidates into pieces of work, smaller towards the end: no thread waits long for the last one.

    Whole neighbourhoods, so that the same candidates are neighbours on any number of threads and in any part of them that
    begins with a neighbourhood.
    """
    first = 0
    while first < total:
        share = -(-(total - first) // threads)
        size = min(_BLOCK, -(-share // NEIGHBOURS) * NEIGHBOURS)
        yield slice(first, min(first + size, total))
        first += size


def _together(span: slice) -> Iterator[slice]:
    """Return the neighbourhoods of a span that begins with one."""
    for first in range(span.start, span.stop, NEIGHBOURS):
        yield slice(first, min(first + NEIGHBOURS, span.stop))


def _steps(signals: Mapping[str, Signal], diagram: Diagram) -> dict[int, float] | None:
    """Return the amplitude of each input's step at t = 0, None for commands of another kind."""
    if not signals:
        return None
    amplitudes: dict[int, float] = {}
    for name, signal in signals.items():
        points, final = signal.breakpoints(), signal.final()
        if signal.degree() != 0 or points != (0.0,) or final is None:
            return None
        amplitudes[diagram.inputs.index(name)] = final
    return amplitudes


class _Networks:
    """The networks of a diagram, each solved once for everything that is asked of it.

    Closed paths are read off the open loop where one is asked for anyway, as both then share their parts.
    """

    def __init__(self, curves: Curves, diagram: Diagram, traced: Any, requests: Sequence[MetricRequest]) -> None:
        self._curves, self._diagram, self._traced = curves, diagram, traced
        self._sources = sorted({str(r.source) for r in requests if r.metric in PATH_READINGS})
        self._first_cut = next(
            (r.open_at for r in requests if r.metric in LOOP_READINGS and isinstance(r.open_at, str)), None
        )
        self._made: dict[str | None, tuple[Wiring, Network]] = {}

    def loop(self, cut: str) -> Any:
        """Return L, signed so that 1 + L = 0 is the characteristic equation."""
        wiring, network = self._cut(cut)
        return -network.read(wiring.outputs.index(LOOP), 0)

    def path(self, source: str, target: str) -> Any:
        """Return what a target gets from a source in the closed loop."""
        wiring, network = self._cut(self._first_cut)
        o, place = wiring.outputs.index(target), self._sources.index(source)
        if self._first_cut is None:
            return network.read(o, place)
        back = wiring.outputs.index(LOOP)
        return network.read(o, place + 1) + network.read(o, 0) * (
            network.read(back, place + 1) / (1.0 - network.read(back, 0))
        )

    def _cut(self, cut: str | None) -> tuple[Wiring, Network]:
        if cut not in self._made:
            wiring = self._diagram.wiring(cut)
            sources = [] if cut is None else [LOOP]
            sources += self._sources if cut == self._first_cut else []
            places = [wiring.inputs.index(source) for source in sources]
            self._made[cut] = (wiring, Network(self._curves, self._traced, wiring, places))
        return self._made[cut]


def _probes(diagram: Diagram, assembly: Assembly, request: MetricRequest, *, loop: bool) -> list[tuple[int, int]]:
    """Return the closed paths that must be stable: the one asked about, or for a loop from every input to every output."""
    if loop:
        return [(assembly.states + i, o) for i in range(len(diagram.inputs)) for o in range(len(diagram.outputs))]
    return [(assembly.states + diagram.inputs.index(str(request.source)), diagram.outputs.index(str(request.target)))]


def _span(diagram: Diagram, traced: Any) -> tuple[float, float]:
    """Return the lowest and highest frequency, rad/s: well beyond all poles, open and closed, at the document's values."""
    poles = [np.linalg.eigvals(diagram.realize().a)]
    poles += [np.linalg.eigvals(block.a.astype(float)) for block in traced.realizations if block.a.dtype != object]
    sizes = np.abs(np.concatenate(poles))
    largest = sizes.max(initial=0.0)
    sizes = sizes[sizes > 1e-9 * largest]
    low, high = (sizes.min() / _MARGIN, largest * _MARGIN) if sizes.size else (1e-3, 1e3)
    return max(low, high / 10.0**_DECADES), high


def _frequencies(low: float, high: float, detail: int) -> Real:
    """Return the table of frequencies; the first and last stand for 0 and infinity."""
    low, high = low / detail**2, high * detail**2
    count = int(np.ceil(detail * _PER_DECADE * np.log10(high / low)))
    count += -(count + 2) % CHUNK
    return np.concatenate([[low * 1e-5], np.geomspace(low, high, count), [high * 1e4]])


def _spectrum_program(
    curves: Curves, functions: list[Curve], bits: list[int], registers: Registers, frequencies: Real
) -> SpectrumProgram:
    scan, tables = program(curves, functions, registers, tabulate=True)
    points, _ = program(curves, functions, registers, tabulate=False)
    table = tabulated(curves, tables, frequencies)
    return SpectrumProgram(
        scan=scan, points=points, frequencies=frequencies, tables_re=np.ascontiguousarray(table.real),
        tables_im=np.ascontiguousarray(table.imag), wants=np.array(bits, dtype=np.int32),
    )  # fmt: skip
