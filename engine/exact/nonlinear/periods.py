"""Whole periods of samplers at once: between two kinks of the commands, and where no limit acts, every period does the same.

    ζ(t + P) = Ψ ζ(t),   ζ = (x, s, 1),   s' = 1,   u = u_0 + u_1 s

Ψ is the product of what flows between the instants of one common period P and what jumps at them; between the instants
x is a matrix exponential. Nothing is solved step by step, and the infinitesimals travel in the matrices.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.elements._sampler import Sampler
from engine.exact.laws.system import Instants
from engine.exact.nonlinear.bounds import LARGEST
from engine.exact.nonlinear.windows import Chain, Lines
from engine.exact.sampled_data.build import sampled_system
from engine.exact.time.chebyshev import NODES
from engine.exact.time.propagate import exponentials
from engine.model.errors import EngineError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from engine.elements._nonlinear import Mode
    from engine.exact.laws.system import NonlinearSystem
    from engine.exact.sampled_data.system import Event, SampledSystem

Array = npt.NDArray[Any]

_FEWEST: Final = 4
"""Fewer periods are followed step by step."""
_MOST: Final = 1000
"""So many pieces are taken at once: the memory that they need is bounded."""
_FIRST: Final = 32
"""So many periods are tried at first; twice as many each time, until something ends them."""
_PAUSE: Final = 16
"""Then so many instants are followed step by step."""
_EARLIER: Final = 1e-6
"""What ends at a kink, but for this part of the period, is left to the step that arrives there."""
_MOST_PIECES: Final = 64
"""A period that takes more is followed step by step, whose steps grow once what is fast has gone."""
_TURNED: Final = 4.0
"""A polynomial of degree 16 is an exponential to rounding as long as the fastest mode turns or decays by no more, rad."""
_TOGETHER: Final = 1e-9
"""Instants closer than this part of the common period are one."""


class Periods:
    """What a system does in each common period of its samplers, which are all that is not linear in it, and without their limits.

    Parameters
    ----------
    system : NonlinearSystem
    sampled : SampledSystem
        With the states of the system that it was made of, in their order.
    events : sequence of Event
        Of one common period, in their order.
    """

    def __init__(self, system: NonlinearSystem, sampled: SampledSystem, events: Sequence[Event]) -> None:
        self._system, self._sampled = system, sampled
        self.length = sampled.period
        instants = np.array([float(event.time[0].real) for event in events])
        grain = _TOGETHER * float(self.length[0].real)
        begins = np.flatnonzero(np.diff(instants, prepend=-np.inf) > grain).tolist()
        self._most, self._pause = _FIRST, 0
        samplers = [(law.element, law.states, law.real) for law in system.laws if issubclass(law.element, Sampler)]
        self._limited = [own for own in samplers if not own[0].linear(own[2])]
        self._groups = [list(events[a:b]) for a, b in zip(begins, [*begins[1:], len(events)], strict=True)]
        times = [group[0].time for group in self._groups]
        gaps = np.diff(np.array([*times, times[0] + self.length])[:, 0].real)
        fastest = float(np.abs(np.linalg.eigvals(sampled.flow[0].real)).max())
        self._parts = np.maximum(1, np.ceil(fastest * gaps / _TURNED)).astype(int)

    @classmethod
    def of(cls, system: NonlinearSystem) -> Periods | None:
        """Return the periods of a system; None where something else than samplers acts in it, or nothing repeats soon."""
        laws = system.laws
        if not laws or system.delays.shape[-1] or not system.states:
            return None
        if not all(issubclass(law.element, Sampler) for law in laws):
            return None
        try:
            sampled = sampled_system(system)
            events = sampled.events()
        except EngineError:
            return None
        if sampled.n != system.states or len(events) > _MOST_PIECES:
            return None
        made = cls(system, sampled, events)
        return made if made.pieces <= _MOST_PIECES else None

    @property
    def pieces(self) -> int:
        """How many polynomials a period takes."""
        return int(self._parts.sum())

    def count(self, t: Array, until: float) -> int:
        """Return how many whole periods to try from ``t`` (lanes,) to before ``until`` (s); 0 if ``t`` is no instant of the period."""
        if self._pause > 0:
            self._pause -= 1
            return 0
        fitting = math.ceil((until - float(t[0].real)) / float(self.length[0].real) - _EARLIER) - 1
        return min(self._most, fitting) if fitting >= _FEWEST and self._instant(t) is not None else 0

    def _instant(self, t: Array) -> int | None:
        """Return which instant of the period ``t`` is, its infinitesimals included; None for none."""
        begins = np.array([group[0].time for group in self._groups])
        turns = np.round((t - begins)[:, :1].real / self.length[0].real)
        apart = t - begins - turns * self.length
        grain = _TOGETHER * np.abs(self.length)
        nearest = int(np.argmin(np.abs(apart[:, 0].real)))
        moved = np.abs(apart[nearest].imag) <= _TOGETHER * (np.abs(t.imag) + np.abs(begins[nearest].imag))
        return nearest if abs(apart[nearest, 0].real) <= grain[0] and moved.all() else None

    def follow(self, count: int, t: Array, x: Array, modes: Sequence[Mode], lines: Lines) -> Chain | None:
        """Return ``count`` periods from an instant ``t`` (lanes,) on whose jump has been; None where the numbers end.

        ``x`` (lanes, n) is the state there; ``lines`` are the commands from there to the end.
        """
        first = self._instant(t)
        assert first is not None
        lanes, n = x.shape
        u, rise = lines.first[0], (lines.last[0] - lines.first[0]) / lines.widths[0]
        until, nodes, sides = self._maps(first, u, rise)
        whole = sides[-1][1]
        since = 1j * t.imag[:, None] if np.iscomplexobj(t) else np.zeros((lanes, 1))
        starts = np.empty((count + 1, lanes, n + 2), dtype=np.result_type(whole, x, since))
        starts[0] = np.concatenate([x, since, np.ones((lanes, 1))], axis=1)
        for k in range(count):
            starts[k + 1] = (whole @ starts[k, :, :, None])[..., 0]
        good = self._followed(starts[:, 0].real, sides)
        if not good.all():  # what ends it is seen step by step
            count = int(np.argmin(good))
            starts = starts[: count + 1]
        self._most = min(2 * self._most, max(_FEWEST, _MOST // self.pieces)) if good.all() else _FIRST
        self._pause = 0 if good.all() else _PAUSE
        if count < _FEWEST:
            return None
        path = np.einsum("qjlab,klb->lkqja", nodes, starts[:-1], optimize=True).reshape(lanes, -1, n)
        edges = (t + np.arange(count)[:, None, None] * self.length + until).reshape(-1, lanes)
        begins = np.concatenate([t[None], edges[:-1]])
        times = (begins[:, None] + (edges - begins)[:, None] * NODES[:, None]).reshape(-1, lanes).T
        at = Instants(
            t=times, x=path, u=u + rise * (times - lines.times[0])[:, :, None],
            du=np.broadcast_to(rise, (*times.shape, len(rise))), w=np.zeros((*times.shape, 0)), modes=modes,
        )  # fmt: skip
        flow = self._system.flow(at)
        y, _ = self._system.read(at, flow.v)
        recorded = {
            name: part.reshape(lanes, len(edges), len(NODES), -1)
            for name, part in (("u", at.u), ("y", y), ("e", flow.e), ("v", flow.v))
        }
        real = path[0].real.reshape(len(edges), len(NODES), n)
        return Chain(edges=edges, x=real, error=0.0, end=starts[-1, :, :n], **recorded)

    def _followed(self, starts: Array, sides: Sequence[tuple[Array, Array]]) -> npt.NDArray[np.bool_]:
        """Return in which of K periods the numbers do not end and no limit acts, (K,).

        ``starts`` (K + 1, n + 2) are the begins of the periods, ``sides`` what they become before and after each instant.
        """
        good = np.asarray(np.abs(starts[1:, : self._sampled.n]).max(axis=1) <= LARGEST)
        for element, states, values in self._limited:
            for sides_here in sides:
                before, after = (side[0, states].real @ starts[:-1].T for side in sides_here)
                good &= element.free(before, after, values)
        return good

    def _maps(self, first: int, u: Array, rise: Array) -> tuple[Array, Array, list[tuple[Array, Array]]]:
        """Return what (x, s, 1) at the begin of a period becomes in each of its pieces.

        When it ends (q, lanes) after the begin, its states (q, 17, lanes, n, n + 2), and before and after each instant all of it,
        (lanes, n + 2, n + 2): the last is Ψ.
        """
        n, groups = self._sampled.n, self._groups
        flow = self._driven(u, rise)
        whole: Array = np.zeros_like(flow) + np.eye(n + 2)
        since, until, nodes, sides = groups[first][0].time, [], [], []
        for number in range(first, first + len(groups)):
            turns, k = divmod(number + 1, len(groups))
            parts = int(self._parts[number % len(groups)])
            width = (groups[k][0].time + turns * self.length - since) / parts
            on = exponentials(flow * (NODES[:, None] * width)[:, :, None, None])
            for part in range(1, parts + 1):
                until.append(since + part * width)
                nodes.append((on @ whole)[:, :, :n])
                whole = on[-1] @ whole
            sides.append((whole, self._jump(k, u, rise) @ whole))
            whole, since = sides[-1][1], until[-1]
        return np.stack(until) - groups[first][0].time, np.stack(nodes), sides

    def _driven(self, u: Array, rise: Array) -> Array:
        """Return the rates of (x, s, 1) between the instants, (lanes, n + 2, n + 2)."""
        m = self._sampled
        flow = np.zeros((m.lanes, m.n + 2, m.n + 2), dtype=np.result_type(m.flow, m.driven))
        flow[:, : m.n, : m.n], flow[:, : m.n, m.n], flow[:, : m.n, m.n + 1] = m.flow, m.driven @ rise, m.driven @ u
        flow[:, m.n, m.n + 1] = 1.0
        return flow

    def _jump(self, group: int, u: Array, rise: Array) -> Array:
        """Return what happens to (x, s, 1) at an instant, (lanes, n + 2, n + 2)."""
        n = self._sampled.n
        found: Array = np.eye(n + 2)
        for event in self._groups[group]:
            jump = np.zeros((len(event.jump), n + 2, n + 2), dtype=np.result_type(event.jump, event.entering)) + np.eye(
                n + 2
            )
            jump[:, :n, :n], jump[:, :n, n], jump[:, :n, n + 1] = event.jump, event.entering @ rise, event.entering @ u
            found = jump @ found
        return found
