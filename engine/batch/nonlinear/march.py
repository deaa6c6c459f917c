"""Marches of many candidates under given commands: equal steps between the breakpoints, inputs tabulated once for all.

The tapes are interpreted until code has been generated for them; the results are the same to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import LANES
from engine.batch.kernels.marching import march
from engine.batch.kernels.switching import ChangeRows, Tapes, march_modes
from engine.batch.nonlinear.curves import Corners
from engine.batch.nonlinear.generated import Generated, generated
from engine.batch.nonlinear.lookback import Lookback, apart, echoes, lookbacks, nowhere
from engine.batch.nonlinear.program import Compiled, Program
from engine.exact.nonlinear.bounds import LARGEST
from engine.model.interruption import look

if TYPE_CHECKING:
    from engine.signals import Signal

Real = npt.NDArray[np.float64]

_INSIDE: Final = 1e-9
"""The ends of a piece are looked at so much inside it, in steps: commands jump there."""
_INFINITESIMAL: Final = 1e-30
_RATIO: Final = 4.0
_OCTAVES: Final = 7
_WITHIN: Final = 4
"""The first step behind a breakpoint is cut at its part 4^-7, 4^-6, ... and each of these is cut into so many steps."""
MOST_SAMPLES: Final = 8192
"""A curve has about so many samples at most, however small its steps are; a cubic goes through them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """The times between breakpoints of the commands, each cut into equal steps.

    Attributes
    ----------
    edges : ndarray, shape (pieces + 1,)
    samples : ndarray of int, shape (pieces,)
        How often each piece is sampled besides its beginning.
    stride : int
        Steps from one sample to the next.
    inputs : list of ndarray, each (3 steps + 1, 2 inputs)
        Commands and their slopes at the beginning, in the middle and at the end of every step, and behind the last one.
    lookbacks : list of Lookback
        What delayed signals are made of, likewise.
    breaks : list of bool
        Whether commands may jump at the beginning of each piece, at once or out of a delay.
    """

    edges: Real
    samples: npt.NDArray[np.int64]
    stride: int
    inputs: list[Real]
    lookbacks: list[Lookback]
    breaks: list[bool]

    @classmethod
    def of(
        cls,
        signals: Sequence[Signal | None],
        end: float,
        steps: int,
        doublings: int = 0,
        *,
        delays: Sequence[float] = (),
        graded: bool = False,
        most: int = MOST_SAMPLES,
    ) -> Pieces:
        """Return pieces until ``end`` (s).

        Parameters
        ----------
        signals : sequence of Signal or None
            One for each input, None for 0.
        end : float
        steps : int
            At least so many steps altogether,
        doublings : int
            which are halved so often.
        delays : sequence of float
            s; steps end where breakpoints come out of them.
        graded : bool
            Whether steps are smaller behind every breakpoint, where what is fast moves: a limit may be reached in an instant.
        most : int
            About so many samples at most, but never fewer than ``steps``.
        """
        breaks = sorted({t for signal in signals if signal is not None for t in signal.breaks(end) if 0 < t < end})
        inside = apart([*breaks, *echoes(breaks, delays, end)], end) if delays else breaks
        edges = np.array([0.0, *inside, end])
        counts = np.maximum(np.ceil(steps * np.diff(edges) / end).astype(int), 1)
        if graded:
            edges, counts = _graded(edges, counts)
        fine = int(np.clip(np.floor(np.log2(most / counts.sum())), 0, doublings))
        samples, stride = counts << fine, 1 << (doublings - fine)
        tables, rows = [], []
        for first, last, count in zip(edges[:-1], edges[1:], samples * stride, strict=True):
            times = np.linspace(first, last, 2 * count + 1)
            margin = max(_INSIDE * (last - first) / count, 4 * np.spacing(last))
            times[0], times[-1] = first + margin, last - margin
            table = np.concatenate([_values(signals, times), _slopes(signals, times)], axis=1)
            tables.append(np.ascontiguousarray(table[_rows(count)]))
            rows.append(times[_rows(count)])
        past = list(lookbacks(edges, samples * stride, rows, delays))
        jumps = np.isin(edges[:-1], [0.0, *inside]).tolist()
        return cls(edges=edges, samples=samples, stride=stride, inputs=tables, lookbacks=past, breaks=jumps)

    @property
    def words(self) -> int:
        """How many samples there are altogether."""
        return int((self.samples + 1).sum())

    @classmethod
    def moment(cls, inputs: int, delays: int) -> Pieces:
        """Return the instant 0 alone, all inputs being 0."""
        return cls(
            edges=np.zeros(2),
            samples=np.zeros(1, dtype=int),
            stride=1,
            inputs=[np.zeros((1, 2 * inputs))],
            lookbacks=[nowhere(1, delays)],
            breaks=[False],
        )

    @property
    def slots(self) -> int:
        """How many instants there are to look back at."""
        return int((self.samples * self.stride + 1).sum())

    @property
    def times(self) -> Real:
        """Instants of the samples, s; breakpoints twice, (samples,)."""
        return np.concatenate([
            np.linspace(a, b, count + 1)
            for a, b, count in zip(self.edges[:-1], self.edges[1:], self.samples, strict=True)
        ])  # fmt: skip

    @property
    def commands(self) -> Real:
        """Commands at `times` and in the middle of what follows them, (samples, 2, inputs)."""
        found = []
        for table in self.inputs:
            count = table.shape[1] // 2
            # a middle is that of the steps to the next sample: of one step, or the beginning of a later one
            half = 1 if self.stride == 1 else 3 * (self.stride // 2)
            ends, middles = table[:: 3 * self.stride, :count], table[half :: 3 * self.stride, :count]
            found.append(np.stack([ends, np.concatenate([middles, ends[-1:]])], axis=1))
        return np.concatenate(found)


@dataclass(frozen=True, kw_only=True, eq=False)
class Marched:
    """Curves of B candidates at the instants ``times`` (samples,).

    ``values`` and ``slopes`` are (watched, samples, B); ``states`` (states, B), ``modes`` (modes, B) and delayed signals ``heard``
    (m, B) those at the end;
    ``covered`` (B,) tells that no law was left and no state grew beyond what is followed; ``corners`` are where modes ended that are
    remembered, None where none is.
    """

    times: Real
    values: Real
    slopes: Real
    states: Real
    modes: Real
    heard: Real
    covered: npt.NDArray[np.bool_]
    corners: Corners | None


class Marcher:
    """What marches the candidates of a structure.

    Parameters
    ----------
    compiled : Compiled
    generate : bool
        Whether code is generated; otherwise the tapes are interpreted for ever.
    """

    def __init__(self, compiled: Compiled, *, generate: bool = True) -> None:
        self._compiled = compiled
        self._code: Generated | None = None
        self._generate = generate

    def prepared(self) -> Marcher:
        """Return the same when its code is ready."""
        if self._generate:
            self._code = generated(self._compiled.program)
            self._code.wait()
        return self

    def __call__(self, start: Real, once: Real, pieces: Pieces) -> Marched:
        """March from ``start`` (states, B), with ``once`` (once, B) from `Compiled.start`."""
        program = self._compiled.program
        remembers = len(program.guards) > 0
        if self._generate and self._code is None and not remembers:
            self._code = generated(program)
        batch = start.shape[1]
        groups = -(-batch // LANES)
        read = len(program.read) + remembers
        registers = _aligned((program.registers, groups, LANES))
        registers[...] = 0.0
        _fill(registers[: program.states], start)
        _fill(registers[program.first_once : program.first_once + len(once)], once)
        registers[program.first_mode : program.first_once] = self._compiled.begins[:, None, None]
        scales = np.zeros((len(program.guards), groups, LANES))
        watched = len(program.read) // 2
        corners = np.empty((groups, watched, 4, LANES))
        corners[...] = np.array([-np.inf, 0.0, np.inf, 0.0])[:, None]
        record = _aligned((read, pieces.words, groups, LANES))
        code = None if self._code is None else self._code.march
        past = _aligned((len(program.entering), pieces.slots + 1, groups, LANES))
        past[...] = 0.0
        following = 0
        with np.errstate(all="ignore"):
            for begin, length, count, inputs, back, breaks in zip(
                pieces.edges.tolist(), np.diff(pieces.edges), pieces.samples.tolist(), pieces.inputs, pieces.lookbacks,
                pieces.breaks, strict=False,
            ):  # fmt: skip
                look()
                own = record[:, following : following + count + 1]
                following += count + 1
                width = float(length) / max(1, count * pieces.stride)
                if code is None:
                    turned = _aligned((groups, count + 1, read, LANES))
                    driven = (inputs, back.places, back.shares, past, back.first, width, pieces.stride)
                    if remembers:
                        march_modes(_tapes(program), registers, *driven, begin, breaks, scales, corners, turned)
                    else:
                        march(
                            program.whole, program.rates_only, program.rates, program.read, program.entering, registers, *driven,
                            turned,
                        )  # fmt: skip
                    own[...] = turned.transpose(2, 1, 0, 3)
                else:
                    code(registers, (inputs, back, past), width, pieces.stride, own)
        whole = record.reshape(read, pieces.words, -1)[:, :, :batch]
        states = registers[: program.states].reshape(program.states, -1)[:, :batch]
        # a state that nobody looks at ends a response as well
        bounded = (np.abs(states) <= LARGEST).all(axis=0)
        covered = (whole[2 * watched] <= 0).all(axis=0) & np.isfinite(whole[:, -1]).all(axis=0) & bounded
        heard = _last(pieces.lookbacks[-1], past.reshape(len(past), pieces.slots + 1, groups * LANES)[:, :, :batch])
        known = None
        if remembers:
            extremes = corners.transpose(2, 1, 0, 3).reshape(4, watched, groups * LANES)[:, :, :batch]
            known = Corners(extremes=extremes, before=whole[-1] > 0)
        return Marched(
            times=pieces.times, values=whole[: 2 * watched : 2], slopes=whole[1 : 2 * watched : 2], states=states, heard=heard,
            covered=covered, corners=known,
            modes=registers[program.first_mode : program.first_once].reshape(len(scales), groups * LANES)[:, :batch],
        )  # fmt: skip


def _tapes(program: Program) -> Tapes:
    """Return what the kernel takes."""
    changes = [
        ChangeRows(change.tape, change.made, change.given, change.residuals, change.guards)
        for change in (program.switched, program.settled, program.released)
    ]
    return Tapes(
        program.whole, program.rates_only, program.rates, program.read, program.entering, program.guards, *changes
    )


def _last(back: Lookback, past: Real) -> Real:
    """Return the delayed signals at the end of the last piece, (m, B), of ``past`` (2 m, slots, B)."""
    count = len(past) // 2
    found = np.zeros((count, past.shape[2]))
    for k, (place, share) in enumerate(zip(back.places[-1], back.shares[-1, :, :4], strict=True)):
        parts = (part[place + more] for more in (0, 1) for part in (past[k], past[count + k]))
        for part, weight in zip(parts, share, strict=True):
            found[k] += weight * part
    return found


def _rows(count: int) -> npt.NDArray[np.intp]:
    """Return the places of beginning, middle and end of each of ``count`` steps among their ends and middles, and the last."""
    return np.append((2 * np.arange(count)[:, None] + np.arange(3)).ravel(), 2 * count)


def _graded(edges: Real, counts: npt.NDArray[np.int64]) -> tuple[Real, npt.NDArray[np.int64]]:
    """Return pieces whose first step is cut geometrically."""
    fractions = _RATIO ** -np.arange(_OCTAVES, -1.0, -1.0)
    cut, steps = [float(edges[0])], []
    for first, last, count in zip(edges[:-1], edges[1:], counts.tolist(), strict=True):
        small = first + (last - first) / count * fractions
        cut += [*small[:-1].tolist(), float(small[-1] if count > 1 else last)]
        steps += [_WITHIN] * len(fractions)
        if count > 1:
            cut.append(float(last))
            steps.append(count - 1)
    return np.array(cut), np.array(steps)


def _aligned(shape: tuple[int, ...]) -> Real:
    """Return an array to be written whose vectors each lie in one line of the cache; numpy's own begin 16 bytes beyond one."""
    count = math.prod(shape)
    raw = np.empty(count + LANES - 1)
    skip = -(raw.ctypes.data // raw.itemsize) % LANES
    return raw[skip : skip + count].reshape(shape)


def _fill(registers: Real, values: Real) -> None:
    """Put values (n, B) into registers (n, groups, LANES); lanes that are left over repeat the last candidate."""
    flat = registers.reshape(len(registers), registers.shape[1] * LANES)
    flat[:, : values.shape[1]] = values
    flat[:, values.shape[1] :] = values[:, -1:]


def _values(signals: Sequence[Signal | None], times: Real) -> Real:
    columns = [np.zeros_like(times) if signal is None else signal.value(times) for signal in signals]
    return np.stack(columns, axis=1) if columns else np.zeros((len(times), 0))


def _slopes(signals: Sequence[Signal | None], times: Real) -> Real:
    """Return the exact slopes of the commands, by the complex step."""
    moved: npt.NDArray[Any] = times + 1j * _INFINITESIMAL
    columns = [
        np.zeros_like(times) if signal is None else np.imag(signal.value(moved)) / _INFINITESIMAL for signal in signals
    ]
    return np.stack(columns, axis=1) if columns else np.zeros((len(times), 0))


def by_input(inputs: Sequence[str], signals: Mapping[str, Signal]) -> list[Signal | None]:
    """Return the signal of each input, None for those that stay 0."""
    return [signals.get(name) for name in inputs]
