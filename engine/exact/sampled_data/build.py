"""A diagram's samplers and pure delays as a system that flows and jumps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from engine.exact.sampled_data import pieces, transport
from engine.exact.sampled_data.cut import arriving_later, closed_by_any_gain, cut_beside_delays
from engine.exact.sampled_data.jumps import following, moving_on, passing, sampling, times
from engine.exact.sampled_data.system import SampledSystem, Sampling, common_period
from engine.model.errors import UnresolvedError

if TYPE_CHECKING:
    from engine.exact.laws.laws import Law
    from engine.exact.laws.system import NonlinearSystem
    from engine.exact.sampled_data.followers import Turn
    from engine.model.linear_system import Array


def sampled_system(
    system: NonlinearSystem, *, opened: bool = False, later: Array | None = None, others: Mapping[int, Turn] | None = None
) -> SampledSystem:  # fmt: skip
    """Return a system whose only laws are samplers as one that flows and jumps.

    Parameters
    ----------
    system : NonlinearSystem
    opened : bool
        Whether its last input and output are the two ends of a cut.
    later : ndarray, shape (lanes,), optional
        How much later what is fed into an opened loop arrives there, s.
    others : mapping of int to Turn, optional
        When its laws that are no samplers act, by their numbers; each has one state, its output.

    Raises
    ------
    UnresolvedError
        If too much is under way in its pure delays.
    """
    m = system.matrices if later is None else arriving_later(system.matrices, later)
    m = transport.merged(cut_beside_delays(m) if opened else m)
    acting = others or {}
    samplers = [_in_transport(law, system.lanes, acting.get(k)) for k, law in enumerate(system.laws)]
    under_way = transport.lines(m, samplers, system.states)
    flowing, total, pace = _flowing(closed_by_any_gain(m) if opened else m, samplers, under_way)
    known = _Known.of(m, system.laws, under_way, flowing, total)
    lanes, n = system.lanes, system.linear_states
    flow = np.zeros((lanes, total, total), dtype=complex if system.complex else float)
    flow[:, :n, :n] = m["a"]
    flow[:, :n] += m["b2"] @ known.arrived + m["b3"] @ known.held
    for course in flowing:
        flow[:, course.chain[:-1], course.chain[1:]] = 1 / course.unit
    driven = np.zeros((lanes, total, m["b1"].shape[-1]), dtype=flow.dtype)
    driven[:, :n] = m["b1"]
    late = ~np.any(known.arrived, axis=1)
    return SampledSystem(
        flow=flow, driven=driven, read=known.signals(m, 1), direct=m["d11"],
        samplings=tuple(_jumps(m, system, acting, (under_way, flowing), known)), inputs=system.inputs,
        outputs=system.outputs, known=~np.any(m["d12"][:, :, late] != 0, axis=(0, 2)), pace=pace,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class _Known:
    """Which state is the output of each sampler, and of each channel, as far as it is known: (channels, N).

    ``held`` are those of samplers, ``arrived`` those of channels. Samplers read what flows through a delay by lines of their own:
    for them only those of channels that carry what is held count, ``stepping``.
    """

    held: Array
    stepping: Array
    arrived: Array

    @classmethod
    def of(
        cls,
        m: Mapping[str, Array],
        laws: Sequence[Law],
        lines: transport.Lines,
        flowing: Sequence[pieces.Course],
        total: int,
    ) -> _Known:
        held = np.zeros((m["b3"].shape[-1], total))
        for law in laws:
            for k in range(law.outputs.stop - law.outputs.start):  # its first states are its outputs
                held[law.outputs.start + k, law.states.start + k] = 1.0
        stepping = np.zeros((m["b2"].shape[-1], total))
        for channel, own in lines.held.items():
            stepping[channel, [line.end for line in own]] = 1.0
        arrived = stepping.copy()
        for course in flowing:
            arrived[course.channel, course.chain.start] = 1.0
        return cls(held=held, stepping=stepping, arrived=arrived)

    def signals(self, m: Mapping[str, Array], kind: int) -> Array:
        """Return what outputs (1), channels (2) or samplers (3) are of the states, (lanes, signals, N)."""
        c = m[f"c{kind}"]
        own = np.concatenate([c, np.zeros((*c.shape[:2], self.held.shape[1] - c.shape[2]))], axis=2)
        arrived = self.stepping if kind == 3 else self.arrived
        return np.asarray(own + m[f"d{kind}2"] @ arrived + m[f"d{kind}3"] @ self.held)


def _jumps(
    m: Mapping[str, Array],
    system: NonlinearSystem,
    others: Mapping[int, Turn],
    ways: tuple[transport.Lines, Sequence[pieces.Course]],
    known: _Known,
) -> list[Sampling]:
    lanes, total, laws, (under_way, flowing) = len(m["a"]), known.held.shape[1], system.laws, ways
    delayed, sees = known.signals(m, 2), known.signals(m, 3)
    for (channel, number), line in under_way.read.items():
        rows = laws[number].inputs
        sees[:, rows, line.end] += m["d32"][:, rows, channel]
    found = [
        following(law, others[k], lanes, sees, m["d31"]) if k in others else sampling(law, k, lanes, sees, m["d31"])
        for k, law in enumerate(laws)
    ]
    for line in under_way.all:
        if line.outputs is not None:
            row = (m["d23"][:, line.channel, None, line.outputs] @ known.held[line.outputs])[:, 0]
        elif line.before is not None:
            row = m["d22"][:, line.channel, line.before.channel, None] * np.eye(total)[line.before.end]
        else:
            row = delayed[:, line.channel]
        found += moving_on(line, row, m["d21"][:, line.channel], number=len(found))
    for course in flowing:
        found += passing(course, delayed[:, course.channel], m["d21"][:, course.channel], number=len(found))
    return found


def _in_transport(law: Law, lanes: int, turn: Turn | None) -> transport.Sampler:
    if turn is not None:
        return transport.Sampler(inputs=law.inputs, outputs=law.outputs, takes=turn.clock, gives=turn.clock)
    period, first = law.element.period(law.values), times(law.element.offset(law.values), lanes)
    assert period is not None
    takes = transport.Clock(label=law.label, period=times(period, lanes), first=first)
    gives = takes.moved(times(law.element.latency(law.values), lanes))
    return transport.Sampler(inputs=law.inputs, outputs=law.outputs, takes=takes, gives=gives)


def _flowing(
    m: Mapping[str, Array], samplers: Sequence[transport.Sampler], under_way: transport.Lines
) -> tuple[list[pieces.Course], int, float]:
    """Return what is under way in the channels through which signals flow on, the number of all states, and their pace."""
    arrivals = [line.arrives for line in chain.from_iterable(under_way.held.values())]
    jumps = {"b3": [sampler.gives for sampler in samplers], "b2": [clock for clock in arrivals if clock is not None]}

    def followed(channels: list[int]) -> tuple[list[pieces.Course], int, float]:
        if not channels:
            return [], under_way.size, np.inf
        period = common_period([(s.takes.label, s.takes.period) for s in samplers])
        return pieces.courses(m, channels, jumps, period, under_way.size)

    try:
        return followed([*under_way.flowing, *under_way.seen])
    except UnresolvedError:
        if not under_way.seen:
            raise
        return followed(under_way.flowing)  # those outputs are not known
