"""Candidates with samplers, those of one structure and one timing together: what flows between the instants of a period, and what jumps.

x' = M x + B u between instants,   x -> J x + K u at them,   y = C x + D u
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from engine.batch import stacks
from engine.batch.frequency.balance import balance
from engine.batch.sampled_data.maps import period_maps
from engine.elements._nonlinear import entries
from engine.exact.sampled_data.period import Period

if TYPE_CHECKING:
    from collections.abc import Sequence

    from engine.exact.laws.system import NonlinearSystem
    from engine.exact.sampled_data.system import Event, Limit, SampledSystem
    from engine.model.linear_system import Array

Flags = npt.NDArray[np.bool_]
Numbers = npt.NDArray[np.intp]

MOST_INSTANTS: Final = 256
MOST_WIDTHS: Final = 16
_TOGETHER: Final = 1e-9
"""Widths that differ by less than this part of the period are one."""
_ON_CIRCLE: Final = 1e-11
"""An eigenvalue nearer to the unit circle, as ln |z|, is on either side of it."""


def alike(system: NonlinearSystem, exist: Flags) -> list[Numbers]:
    """Return the members of a batch, those together that have the same structure and the same times.

    What a candidate is followed by then does not depend on who stands beside it.
    """
    lanes = len(exist)
    flags = [np.broadcast_to(m != 0, (lanes, *m.shape[1:])).reshape(lanes, -1) for m in system.matrices.values()]
    numbers = [system.delays.real]
    for law in system.laws:
        flags += [value != 0 for value in entries(law.values) if isinstance(value, np.ndarray)]
        times = (law.element.period(law.values), law.element.latency(law.values), law.element.offset(law.values))
        numbers += [np.asarray(time).real.reshape(-1, 1) for time in times]
    parts = [*flags, *(np.ascontiguousarray(part, dtype=float).view(np.uint8) for part in numbers)]
    whole = np.concatenate([np.broadcast_to(part, (lanes, part.shape[1])).astype(np.uint8) for part in parts], axis=1)
    here = np.flatnonzero(exist)
    return [here[members] for members in stacks.alike(whole[here])]


@dataclass(frozen=True, kw_only=True, eq=False)
class Cycle:
    """One common period of B systems.

    Attributes
    ----------
    flow, driven, read, direct : ndarray, shapes (B, n, n), (B, n, inputs), (B, outputs, n), (B, outputs, inputs)
        Of states scaled by powers of two; the first ``flowing`` flow, the others are moved by jumps alone.
    instants : ndarray, shape (g,)
        Never falling, within the period of ``length``, s; what follows a limit at one instant stands behind it.
    limits : tuple
        Those behind each jump, None: none. Left out where the linear part is all that is wanted.
    jumps, entering : ndarray, shapes (B, g, n, n), (B, g, n, inputs)
        All that happens at each instant.
    widths, kinds : ndarray, shapes (K,), (g,)
        The distinct times between instants, s, and which of them follows each instant.
    scale : ndarray, shape (B, n)
        What the states of ``system`` are divided by.
    """

    system: SampledSystem
    flow: Array
    driven: Array
    read: Array
    direct: Array
    flowing: int
    instants: Array
    limits: tuple[Limit | None, ...]
    jumps: Array
    entering: Array
    length: float
    widths: Array
    kinds: npt.NDArray[np.int64]
    scale: Array

    @classmethod
    def of(cls, system: SampledSystem, *, limited: bool = False) -> Cycle | None:
        """Return the common period of systems of one timing; None where it is too long, or carries infinitesimals.

        Its limits are left out unless it is ``limited``.

        Raises
        ------
        UnresolvedError
            If there is no common period.
        """
        times = [time for one in system.samplings for time in (one.period, one.delay, one.offset)]
        if any(np.iscomplexobj(time) and np.any(time.imag) for time in times):
            return None
        events = system.events()
        length = float(system.period[0].real)
        groups = _together(events, limited=limited)
        instants = np.array([float(group[0].time[0].real) for group in groups])
        gaps = np.diff(np.append(instants, instants[0] + length))
        widths: list[float] = []
        kinds = np.zeros(len(gaps), dtype=np.int64)
        for k, gap in enumerate(gaps.tolist()):
            near = [w for w, width in enumerate(widths) if abs(width - gap) <= _TOGETHER * length]
            kinds[k] = near[0] if near else len(widths)
            widths += [] if near else [gap]
        if len(instants) > MOST_INSTANTS or len(widths) > MOST_WIDTHS:
            return None
        moved = np.logical_or.reduce([one.moved for one in system.samplings])
        flowing = int(np.argmax(moved)) if moved.any() else system.n
        scale = np.ones((system.lanes, system.n))
        scale[:, :flowing] = balance(system.flow[:, :flowing, :flowing])
        jumps, entering = _of_instants(groups, system)
        back = 1 / scale
        return cls(
            system=system, flow=back[:, :, None] * system.flow * scale[:, None], driven=back[:, :, None] * system.driven,
            read=system.read * scale[:, None], direct=system.direct, flowing=flowing, instants=instants,
            limits=tuple(group[-1].limit if limited else None for group in groups),
            jumps=back[:, None, :, None] * jumps * scale[:, None, None], entering=back[:, None, :, None] * entering,
            length=length, widths=np.array(widths), kinds=kinds, scale=scale,
        )  # fmt: skip

    @cached_property
    def moved(self) -> Flags:
        """Which states jump at all, (n,)."""
        return np.asarray(np.logical_or.reduce([one.moved for one in self.system.samplings]))

    def maps(self, first: int = 0, column: tuple[Array, Array] | None = None) -> Array:
        """Return Φ - 1 over a period that begins before the jump of an instant, (B, n, n).

        With a ``column`` of what a constant drives, and enters at each instant, (B, n) and (B, g, n), it is one more state.
        """
        flow, jumps = self.flow, self.jumps
        if column is not None:
            members, g, n = self.entering.shape[:3]
            kind = np.result_type(flow, jumps, *column)
            flow, jumps = np.zeros((members, n + 1, n + 1), kind), np.zeros((members, g, n + 1, n + 1), kind)
            flow[:, :n, :n], flow[:, :n, n] = self.flow, column[0]
            jumps[:, :, :n, :n], jumps[:, :, :n, n], jumps[:, :, n, n] = self.jumps, column[1], 1.0
        kind = np.result_type(flow, jumps)
        flow, jumps = (np.ascontiguousarray(part, dtype=kind) for part in (flow, jumps))
        found = np.empty_like(flow)
        period_maps(flow, self.flowing, jumps, self.widths, self.kinds, first, found)
        return found

    @cached_property
    def alive(self) -> Numbers:
        """The states whose values at the start of a period matter."""
        return np.asarray(Period(self.system).alive)

    @cached_property
    def own(self) -> Array:
        """Φ - 1 of the states that matter, (B, alive, alive)."""
        return self.maps()[:, self.alive[:, None], self.alive]

    @cached_property
    def growth(self) -> npt.NDArray[np.float64]:
        """The largest real part of a pole, 1/s; NaN where it cannot be told from 0."""
        return growth_of(np.linalg.eigvals(self.own.real), self.length)

    def rest(self, members: Numbers, inputs: Array) -> Array:
        """Return where the states of some stable members are when everything rests under constant ``inputs``, (k, n); NaN for nowhere.

        What flows does not, and what each sampler takes changes nothing.
        """
        whole, right = self.system.flow[members].copy(), -self.system.driven[members] @ inputs
        kind = np.result_type(whole, right, self.jumps, self.entering)
        whole, right = whole.astype(kind), right.astype(kind)
        written = np.zeros(self.system.n, dtype=np.int64)
        for one in self.system.samplings:
            for number, jump in enumerate((one.taken, one.updated)):
                if jump is None:
                    continue
                rows = np.flatnonzero((jump != np.eye(self.system.n)).any(axis=(0, 2)))
                written[rows] += 1
                whole[:, rows] = jump[members][:, rows] - np.eye(self.system.n)[rows]
                right[:, rows] = -one.entering[members][:, rows] @ inputs if number == 0 else 0.0
        if (written > 1).any():
            return np.full(right.shape, np.nan, dtype=kind)
        return np.asarray(stacks.solve(whole, right[:, :, None])[:, :, 0] / self.scale[members])


def growth_of(less_one: Array, length: float) -> npt.NDArray[np.float64]:
    """Return the largest real part of a pole, 1/s, of eigenvalues z - 1 (B, n) of maps over a ``length``; NaN where it cannot be told from 0."""
    largest = np.full(len(less_one), -np.inf)
    if less_one.shape[1]:
        with np.errstate(divide="ignore"):
            sizes = np.log1p(np.maximum(2 * less_one.real + np.abs(less_one) ** 2, -1.0))
        largest = 0.5 * sizes.max(axis=1)
    return np.where(np.abs(largest) <= _ON_CIRCLE, np.nan, largest / length)


def _together(events: Sequence[Event], *, limited: bool) -> list[list[Event]]:
    """Return the events that make one jump, in their order: those of an instant, a limit at most behind the last of them."""
    groups: list[list[Event]] = []
    for event in events:
        last = groups[-1][-1] if groups else None
        if last is None or last.time[0].real != event.time[0].real or (limited and last.limit is not None):
            groups.append([])
        groups[-1].append(event)
    return groups


def _of_instants(groups: Sequence[Sequence[Event]], system: SampledSystem) -> tuple[Array, Array]:
    """Return what the events of each group make together: J (B, g, n, n) and K (B, g, n, inputs)."""
    kind = np.result_type(*(part for group in groups for event in group for part in (event.jump, event.entering)))
    jumps = np.zeros((system.lanes, len(groups), system.n, system.n), dtype=kind) + np.eye(system.n)
    entering = np.zeros((system.lanes, len(groups), system.n, len(system.inputs)), dtype=kind)
    for k, group in enumerate(groups):
        for event in group:
            jumps[:, k] = event.jump @ jumps[:, k]
            entering[:, k] = event.jump @ entering[:, k] + event.entering
    return jumps, entering
