"""Margins and peaks of many loops with samplers, where the cut carries a sequence of one value a period: L(z) = -R (z - A)⁻¹ E.

The scan of continuous loops finds all that does not depend on how frequencies are named: z = (1 + v)/(1 - v) makes the unit circle
the imaginary axis of v.

References
----------
K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 3rd ed., section 8.2 (the w-transform).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from engine.batch import stacks
from engine.batch.frequency.balance import balance
from engine.batch.frequency.margins import LOOP_METRICS
from engine.batch.frequency.scan import Path, Scan
from engine.batch.linear.spans import in_spans
from engine.batch.sampled_data.cycle import Cycle, alike, growth_of
from engine.exact.sampled_data.loop import SampledLoop
from engine.model.errors import EngineError

if TYPE_CHECKING:
    from engine.analysis.measuring import MetricRequest
    from engine.batch.screened import Screened
    from engine.batch.stacks import Numbers
    from engine.diagram.connections import Opening
    from engine.diagram.diagram import Diagram
    from engine.exact.sampled_data.system import SampledSystem
    from engine.model.linear_system import Array

MEASURED: Final = frozenset(LOOP_METRICS) - {"delay_margin"}
"""A delay is no phase for what is held: its margin is left to the exact path."""
SCANNED: Final = 128
"""Neighbours that are scanned together."""
_MOST_STATES: Final = 64


def is_measured(request: MetricRequest) -> bool:
    """Return whether a request is one of a loop that is cut at one place."""
    return request.metric in MEASURED and request.open_at is not None and not request.opened_besides


def measure_loops(
    diagram: Diagram, open_at: Opening, requests: Mapping[int, MetricRequest], overrides: Mapping[str, Array], found: Screened
) -> None:  # fmt: skip
    """Enter the metrics of a loop, by their columns, and how it grows when it is closed."""
    system, exist = diagram.sampled_members(overrides, open_at)
    for members in alike(system, exist):
        try:
            part = SampledLoop(system.members(members)).part
            loop = _Sequence.of(part) if part.samplings and not np.isfinite(part.pace) else None
        except EngineError:
            continue
        for those, own in [] if loop is None else loop.parts():
            _measure(own, members[those], requests, found)


def _measure(loop: _Sequence, members: Array, requests: Mapping[int, MetricRequest], found: Screened) -> None:
    """Enter the metrics of some members."""
    growth, closed = loop.closed()
    found.growth[members] = np.fmax(found.growth[members], growth)
    found.doubtful[np.ix_(members[growth >= 0], np.array(list(requests)))] = False
    stable = np.flatnonzero(growth < 0)

    def work(span: slice) -> None:
        rows = stable[span]
        path = loop.path(rows)
        scan = Scan(path, np.abs(closed[rows]))
        for column, request in requests.items():
            read = LOOP_METRICS[request.metric](path, scan)
            found.values[members[rows], column] = read.value if np.iscomplexobj(found.values) else read.value.real
            found.doubtful[members[rows], column] = read.doubtful

    if stable.size:
        in_spans(members[stable], work, 1, SCANNED)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sequence:
    """What the cut carries as a sequence: ``whole`` A - 1 (B, n, n), ``entered`` E (B, n), ``read`` R (B, n); one value in ``length`` s."""

    whole: Array
    entered: Array
    read: Array
    length: float

    @classmethod
    def of(cls, part: SampledSystem) -> _Sequence | None:
        """Return the sequence of a loop that is cut open; None where what it carries flows, or has several values in a period.

        Raises
        ------
        UnresolvedError
            If its rates have no common period.
        """
        cycle = Cycle.of(part) if part.n <= _MOST_STATES else None
        if cycle is None or np.any(part.direct):
            return None
        driven, entering, read = cycle.driven[:, :, -1], cycle.entering[:, :, :, -1], cycle.read[:, -1]
        seen, entered = np.flatnonzero((read != 0).any(axis=0)), np.flatnonzero((entering != 0).any(axis=(0, 2)))
        if not np.any(driven) and len(entered) == 1:
            first = int(entered[0])
            before = _before(part, float(cycle.instants[first]))
            if before is None:
                return None
            read = (read[:, None] @ (before * cycle.scale[:, None] / cycle.scale[:, :, None]))[:, 0]
        elif np.any(driven) and not len(entered) and seen.size and seen[0] >= cycle.flowing:  # a value that is held
            same = np.eye(part.n)[seen]
            changed = np.flatnonzero((cycle.jumps[:, :, seen] != same).any(axis=(0, 2, 3)))
            if len(changed) != 1:
                return None
            first = int(changed[0])
            read = (read[:, None] @ cycle.jumps[:, first])[:, 0]
        else:
            return None
        whole = cycle.maps(first, (driven, entering))
        n = part.n
        return cls(whole=whole[:, :n, :n], entered=whole[:, :n, n], read=read, length=cycle.length)

    def parts(self) -> list[tuple[Numbers, _Sequence]]:
        """Return the members, by number, with those states alone whose values at the start of a period matter to them."""
        acts = ((self.whole + np.eye(self.whole.shape[1])) != 0).any(axis=1) | (self.read != 0)
        found = []
        for members in stacks.alike(acts):
            kept = np.flatnonzero(acts[members[0]])
            whole = self.whole[members][:, kept[:, None], kept]
            part = _Sequence(
                whole=whole,
                entered=self.entered[members][:, kept],
                read=self.read[members][:, kept],
                length=self.length,
            )
            found.append((members, part))
        return found

    def closed(self) -> tuple[Array, Array]:
        """Return the largest real part of a pole of the closed loop, 1/s and in the plane of v, (B,); NaN where it cannot be told from 0."""
        whole = (self.whole + self.entered[:, :, None] * self.read[:, None]).real
        less_one = np.linalg.eigvals(whole)
        with np.errstate(divide="ignore", invalid="ignore"):
            turned = (less_one / (2 + less_one)).real.max(axis=1, initial=-np.inf)
        return growth_of(less_one, self.length), turned

    def path(self, rows: Array) -> Path:
        """Return some loops as paths."""
        scale = balance(self.whole[rows])
        return Path(
            a=self.whole[rows] * scale[:, None, :] / scale[:, :, None], b=(self.entered[rows] / scale)[:, :, None],
            c=-(self.read[rows] * scale)[:, None], d=np.zeros((len(rows), 1, 1)), delays=np.zeros((len(rows), 0)), sampled=True,
        )  # fmt: skip


def _before(part: SampledSystem, instant: float) -> Array | None:
    """Return what happens at an instant before the cut's value enters, (B, n, n); None where it enters several times."""
    before = np.zeros((part.lanes, part.n, part.n)) + np.eye(part.n)
    found = None
    for event in part.events():
        if float(event.time[0].real) != instant:
            continue
        if np.any(event.entering[:, :, -1]):
            if found is not None:
                return None
            found = before
        before = event.jump @ before
    return found
