"""What is due at one instant of a nonlinear response although each part of it moves otherwise with a parameter.

    x(t + δ) = x(t) + δ f,   δ infinitesimal

A sampler meets a breakpoint of a command, an echo or another sampler: each is reached at its own infinitesimal, in the order in which
they happen. Where another order would give other slopes, they are those of the side on which this order holds: samplers, moved later by
their parameters, come after the breakpoint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.elements._nonlinear import first
from engine.exact.laws.system import Instants
from engine.exact.nonlinear.switching import StoppedError
from engine.model.tangent import INFINITESIMAL, slopes

if TYPE_CHECKING:
    from engine.exact.nonlinear.agenda import Stop
    from engine.exact.nonlinear.pieces import Record
    from engine.exact.nonlinear.switching import Switchboard

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]

_MATTERS: Final = 1e-8
"""A jump of a signal, or of its slope over a sample time, matters from this part of the largest value on."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Look:
    """The laws' inputs ``e`` and their slopes in time, (channels,); inputs and outputs; what enters the delays."""

    e: Real
    slope: Real
    shown: Real
    delayed: Real


class Meeting:
    """Reach stops of one instant one after the other.

    Parameters
    ----------
    board : Switchboard
        At the lanes of one of them, or of an event.
    record : Record
        What has been followed so far: it ends at these lanes.
    due : sequence of Stop
        In the order in which they happen: what is no law's first.
    left : ndarray, shape (n,), or None
        The rates just before the instant; None behind an event in it.
    """

    def __init__(self, board: Switchboard, record: Record, due: Sequence[Stop], left: Real | None) -> None:
        self._board, self._record, self._due, self._left = board, record, due, left
        self._reached = board.t
        self._known = self._before() if record.y else None
        self._jumped: list[Array] = []
        self._delayed: list[Array] = []
        self._pending = {stop.delay for stop in due if stop.delay is not None}
        self._around, board.around = board.around, self._partly
        self.smooth = left is not None or not record.y
        """Whether slopes are those of both sides."""

    @staticmethod
    def of(board: Switchboard, record: Record, due: Sequence[Stop], left: Real | None) -> Meeting | None:
        """Return the meeting where something moves otherwise than what has been reached."""
        apart = any(_apart(stop.lanes, board.t) for stop in due)
        return Meeting(board, record, due, left) if apart else None

    def reach(self, stop: Stop) -> None:
        """Go to the infinitesimals of a stop, which then happens."""
        self._glide(stop.lanes)
        self._left = None
        self._pending.discard(stop.delay)

    def _partly(self, t: Array) -> tuple[Array, Array, Array]:
        """Return inputs, their slopes and the delayed signals at ``t`` (lanes,): those that are still to come as they were before."""
        u, du, w = self._around(t)
        if self._pending:
            rows, w = list(self._pending), w.copy()
            w[..., rows] = self._record.delayed(t[:, None], self._board.system.delays, later=False)[..., rows]
        return u, du, w

    def _glide(self, lanes: Array) -> None:
        """Go on, or back, by the rates before whatever comes next."""
        board = self._board
        moved = 1j * (lanes - board.t).imag
        if not np.any(moved):
            return
        rates = self._rates() if self._left is None else self._left
        board.x, board.t = board.x + moved[:, None] * rates, board.t + moved

    def _rates(self) -> Real:
        """Return the rates, (n,), in the modes that the laws would settle into were there nothing more to come."""
        board = self._board
        kept = board.x, list(board.modes), board.switches
        try:
            board.settle()
        except StoppedError:
            self.smooth = False
        found = board.real.flow(board.instant().real).f[0, 0]
        board.x, board.modes, board.switches = kept
        return np.asarray(found)

    def happened(self, stop: Stop) -> None:
        """See what has come of a stop: whether others would have seen it, had they come before it."""
        known, self._known = self._known, self._look()
        if known is None:
            return
        now = self._known
        if np.any(_differ(known.shown, now.shown, np.maximum(np.abs(known.shown), np.abs(now.shown)))):
            self._jumped.append(stop.lanes)
        if np.any(_differ(known.delayed, now.delayed, np.maximum(np.abs(known.delayed), np.abs(now.delayed)))):
            self._delayed.append(stop.lanes)
        size, laws = self._board.largest, self._board.real.laws
        jumps = _differ(known.e, now.e, size)
        for law, mode in zip(
            laws, self._board.modes, strict=True
        ):  # what several jumps make of a product is not the sum
            self.smooth = self.smooth and (law.element.affine(mode, law.real) or not np.any(jumps[law.inputs]))
        for other in self._due:
            if other.law is not None and not other.updates and _apart(other.lanes, stop.lanes):
                law = laws[other.law]
                period = first(law.element.period(law.real))
                seen = jumps | _differ(period * known.slope, period * now.slope, size)
                self.smooth = self.smooth and not np.any(seen[law.inputs])

    def end(self, *, stays: bool) -> bool:
        """Go to where the signals jump and let the record end there, unless its end ``stays``; return whether it is where they jump."""
        board = self._board
        self.smooth = self.smooth and board.switches == 0
        board.around = self._around
        jumped = self._delayed or self._jumped
        edge = jumped[-1] if jumped and self._record.y and not stays else self._reached
        self._glide(edge)
        if edge is not self._reached:
            self._record.stretch((edge - self._reached).imag)
        return not any(_apart(lanes, edge) for lanes in (*self._jumped, *self._delayed))

    def _before(self) -> _Look:
        assert self._board.before is not None
        e, _, slope = self._board.before
        assert slope is not None
        shown = [part[-1][-1, 0].real for part in (self._record.y, self._record.u)]
        return _Look(
            e=e[0, 0].real, slope=slope[0, 0].real, shown=np.concatenate(shown), delayed=self._record.z[-1][-1, 0].real
        )

    def _look(self) -> _Look:
        board = self._board
        system, at = board.system, board.instant()
        flow = system.flow(at)
        ahead = 1j * INFINITESIMAL
        u, du, w = board.around(board.t + ahead)
        later = Instants(t=at.t + ahead, x=at.x + ahead * flow.f, u=u, du=du, w=w, modes=at.modes)
        slope = slopes(system.flow(later).e - flow.e)[0, 0]
        y, z = system.read(at, flow.v)
        shown = np.concatenate([part[0, 0].real for part in (y, at.u)])
        return _Look(e=flow.e[0, 0].real, slope=slope, shown=shown, delayed=z[0, 0].real)


def _apart(one: Array, other: Array) -> bool:
    """Return whether two instants have other infinitesimals, (lanes,), than rounding alone gives them."""
    return bool(np.any(np.abs((one - other).imag) > 1e-12 * np.maximum(np.abs(one.imag), np.abs(other.imag))))


def _differ(one: Real, other: Real, size: Real) -> npt.NDArray[np.bool_]:
    return np.asarray(np.abs(one - other) > _MATTERS * size)
