"""What the time part of a kernel needs to know of a diagram: where the registers of its tape go.

States are those that carry a step of the command to a watched output and those of the loops that are asked about; they are
scaled by powers of two so that the matrix is balanced at the values where the diagram was traced.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack

from engine.batch.kernels.assembly import Row, is_zero

if TYPE_CHECKING:
    from engine.batch.kernels.assembly import Assembly
    from engine.batch.kernels.tape import Registers

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int32]


class TimeProgram(NamedTuple):
    """Sizes and scatter lists.

    ``states`` n, ``padded`` the multiple of 4 above it, ``rows`` sampled rows of a step (output and slope of every output,
    padded to a multiple of 4), ``outputs``, ``experiments``. A scatter list (k, 3) holds row, column and register, its
    scale (k,) the power of two. ``traces`` (T, 3): output, experiment, kinds of readings wanted.
    """

    states: int
    padded: int
    rows: int
    outputs: int
    experiments: int
    a: Whole
    a_scale: Real
    b: Whole
    b_scale: Real
    c: Whole
    c_scale: Real
    d: Whole
    traces: Whole


class TimePart:
    """The closed loop of an assembly as far as its responses need it, in numbers and formulas.

    Parameters
    ----------
    assembly : Assembly
    commands : sequence of mapping
        For every experiment: column of an external signal -> amplitude of its step.
    outputs : sequence of int
        Which of the assembly's reads are watched.
    probes : sequence of (column, read)
        Paths whose states must be kept for the sake of stability, from an external signal to a read.
    """

    def __init__(
        self,
        assembly: Assembly,
        commands: Sequence[Mapping[int, float]],
        outputs: Sequence[int],
        probes: Sequence[tuple[int, int]],
    ) -> None:
        self._assembly = assembly
        self.commands, self.outputs = commands, outputs
        kept: set[int] = set()
        for command in commands:
            for read in outputs:
                kept |= self._between(command.keys(), assembly.reads[read])
        for column, read in probes:
            kept |= self._between({column}, assembly.reads[read])
        self.kept = sorted(kept)
        self._place = {state: k for k, state in enumerate(self.kept)}
        nominal = np.zeros((len(kept), len(kept)))
        for i in self.kept:
            for j, value in assembly.flow[i].items():
                if j in self._place:
                    nominal[self._place[i], self._place[j]] = value.real
        # Balanced where it was traced: elsewhere the scaling may be less good, but stays exact.
        self.scale = lapack.dgebal(nominal, scale=1, permute=0)[3] if kept else np.ones(0)

    def _between(self, columns: Any, read: Row) -> set[int]:
        """Return the states that lead from external columns to a read."""
        n, flow = self._assembly.states, self._assembly.flow
        forward = {i for i in range(n) if any(column in flow[i] for column in columns)}
        pending = list(forward)
        users: dict[int, list[int]] = {}
        for i in range(n):
            for j in flow[i]:
                users.setdefault(j, []).append(i)
        while pending:
            for i in users.get(pending.pop(), ()):
                if i not in forward:
                    forward.add(i)
                    pending.append(i)
        backward = {j for j in read if j < n}
        pending = list(backward)
        while pending:
            for j in flow[pending.pop()]:
                if j < n and j not in backward:
                    backward.add(j)
                    pending.append(j)
        return forward & backward

    def _entries(self) -> dict[str, list[tuple[int, int, Any, float]]]:
        """Return (row, column, value, scale) of A, B, C and D."""
        assembly, place, scale = self._assembly, self._place, self.scale
        a = [
            (place[i], place[j], value, scale[place[j]] / scale[place[i]])
            for i in self.kept
            for j, value in assembly.flow[i].items()
            if j in place
        ]
        b, d = [], []
        for e, command in enumerate(self.commands):
            for i in self.kept:
                drive = _sum(assembly.flow[i], command)
                if not is_zero(drive):
                    b.append((place[i], e, drive, 1.0 / scale[place[i]]))
            for o, read in enumerate(self.outputs):
                drive = _sum(assembly.reads[read], command)
                if not is_zero(drive):
                    d.append((o, e, drive, 1.0))
        c = [
            (o, place[j], value, scale[place[j]])
            for o, read in enumerate(self.outputs)
            for j, value in assembly.reads[read].items()
            if j in place
        ]
        return {"a": a, "b": b, "c": c, "d": d}

    def numbers(self) -> list[Any]:
        """Return every number that the tape must compute."""
        return [value for entries in self._entries().values() for _, _, value, _ in entries]

    def program(self, registers: Registers, traces: Sequence[tuple[int, int, int]]) -> TimeProgram:
        """Return the program, registers being known."""
        n = len(self.kept)
        lists: dict[str, Any] = {}
        for name, entries in self._entries().items():
            lists[name] = np.array([(i, j, registers.of(value)) for i, j, value, _ in entries], np.int32).reshape(-1, 3)
            lists[f"{name}_scale"] = np.array([scale for *_, scale in entries], dtype=float)
        del lists["d_scale"]
        return TimeProgram(
            states=n, padded=max(4, -(-n // 4) * 4), rows=max(4, -(-2 * len(self.outputs) // 4) * 4),
            outputs=len(self.outputs), experiments=len(self.commands),
            traces=np.array(traces, dtype=np.int32).reshape(-1, 3), **lists,
        )  # fmt: skip


def _sum(row: Row, command: Mapping[int, float]) -> Any:
    total: Any = 0.0
    for column, amplitude in command.items():
        if column in row:
            total = total + row[column] * amplitude
    return total
