"""A diagram's samplers and pure delays as a system that flows and jumps."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.elements._nonlinear import Moment, stacked
from engine.elements._sampler import Sampler
from engine.exact.sampled_data import transport
from engine.exact.sampled_data.cut import cut_beside_delays
from engine.exact.sampled_data.system import SampledSystem, Sampling

if TYPE_CHECKING:
    from engine.exact.laws.laws import Law
    from engine.exact.laws.system import NonlinearSystem
    from engine.model.linear_system import Array


def sampled_system(system: NonlinearSystem, *, opened: bool = False) -> SampledSystem:
    """Return a system whose only laws are samplers as one that flows and jumps.

    Parameters
    ----------
    system : NonlinearSystem
    opened : bool
        Whether its last input and output are the two ends of a cut.

    Raises
    ------
    UnresolvedError
        If a signal flows through a pure delay into something that is no sampler.
    """
    lanes, n = system.lanes, system.linear_states
    m = transport.merged(cut_beside_delays(system.matrices) if opened else system.matrices)
    samplers = [_in_transport(law, lanes) for law in system.laws]
    under_way = transport.lines(m, samplers, system.states)
    total = under_way.size
    held = np.zeros((m["b3"].shape[-1], total))  # the output of each sampler is its first state
    for law in system.laws:
        for k in range(law.outputs.stop - law.outputs.start):  # its first states are its outputs
            held[law.outputs.start + k, law.states.start + k] = 1.0
    arrived = np.zeros((m["b2"].shape[-1], total))
    for channel, own in under_way.held.items():
        arrived[channel, [line.end for line in own]] = 1.0
    kind = complex if system.complex else float
    flow = np.zeros((lanes, total, total), dtype=kind)
    flow[:, :n, :n] = m["a"]
    flow[:, :n] += m["b2"] @ arrived + m["b3"] @ held
    driven = np.zeros((lanes, total, m["b1"].shape[-1]), dtype=kind)
    driven[:, :n] = m["b1"]
    read, delayed, sees = (
        np.concatenate([m[f"c{k}"], np.zeros((*m[f"c{k}"].shape[:2], total - n))], axis=-1)
        + m[f"d{k}2"] @ arrived
        + m[f"d{k}3"] @ held
        for k in (1, 2, 3)
    )
    late = np.array([channel not in under_way.held for channel in range(len(arrived))], dtype=bool)
    known = ~np.any(m["d12"][:, :, late] != 0, axis=(0, 2))
    for (channel, number), line in under_way.read.items():
        rows = samplers[number].inputs
        sees[:, rows, line.end] += m["d32"][:, rows, channel]
    samplings = [_sampling(law, k, lanes, sees, m["d31"]) for k, law in enumerate(system.laws)]
    for line in under_way.all:
        if line.outputs is not None:
            row = (m["d23"][:, line.channel, None, line.outputs] @ held[line.outputs])[:, 0]
        elif line.before is not None:
            row = m["d22"][:, line.channel, line.before.channel, None] * np.eye(total)[line.before.end]
        else:
            row = delayed[:, line.channel]
        samplings += _moving_on(line, row, m["d21"][:, line.channel], number=len(samplings))
    return SampledSystem(
        flow=flow, driven=driven, read=read, direct=m["d11"], samplings=tuple(samplings), inputs=system.inputs,
        outputs=system.outputs, known=known,
    )  # fmt: skip


def _in_transport(law: Law, lanes: int) -> transport.Sampler:
    period, first = law.element.period(law.values), _times(law.element.offset(law.values), lanes)
    assert period is not None
    takes = transport.Clock(label=law.label, period=_times(period, lanes), first=first)
    gives = takes.moved(_times(law.element.latency(law.values), lanes))
    return transport.Sampler(inputs=law.inputs, outputs=law.outputs, takes=takes, gives=gives)


def _moving_on(line: transport.Line, row: Array, entering: Array, *, number: int) -> list[Sampling]:
    """Return the events of a line: a value begins its way, the one before it goes on, and the oldest arrives."""
    lanes, total = row.shape
    taken = np.zeros((lanes, total, total), dtype=np.result_type(row, float)) + np.eye(total)
    for state in line.states:
        taken[:, state] = np.eye(total)[state - 1]
    taken[:, line.states.start] = row
    begun = np.zeros((lanes, total, entering.shape[-1]), dtype=np.result_type(entering, float))
    begun[:, line.states.start] = entering
    still = np.zeros(lanes)
    own = Sampling(
        label=line.begins.label, number=number, period=line.begins.period, delay=still, offset=line.begins.first,
        taken=taken, entering=begun, turn=2,
    )  # fmt: skip
    if line.arrives is None:
        return [own]
    arriving = np.zeros((lanes, total, total)) + np.eye(total)
    arriving[:, line.end] = np.eye(total)[line.end - 1]
    return [
        own, replace(own, offset=line.arrives.first, taken=arriving, entering=np.zeros_like(begun), turn=0),
    ]  # fmt: skip


def _sampling(law: Law, number: int, lanes: int, sees: Array, follows: Array) -> Sampling:
    """Return a sampler in its place; what it samples is ``sees`` ξ + ``follows`` u."""
    element = law.element
    assert issubclass(element, Sampler)
    values = element.linear_part(law.values)
    count, total = law.states.stop - law.states.start, sees.shape[-1]
    units = np.eye(count + law.inputs.stop - law.inputs.start)
    columns = [Moment(t=0.0, x=list(unit[:count]), z=list(unit[count:])) for unit in units]
    own = np.stack([stacked(element.sample(m, 0, values), (lanes, 1))[:, 0] for m in columns], axis=-1)
    kind = np.result_type(own, sees, follows)
    rows = law.states
    taken = np.zeros((lanes, total, total), dtype=kind) + np.eye(total)
    taken[:, rows] = own[..., count:] @ sees[:, law.inputs]
    taken[:, rows, rows] += own[..., :count]
    entering = np.zeros((lanes, total, follows.shape[-1]), dtype=kind)
    entering[:, rows] = own[..., count:] @ follows[:, law.inputs]
    delay = _times(element.latency(law.values), lanes)
    updated = None
    if np.any(delay):
        after = np.stack([stacked(element.update(m, 0, values), (lanes, 1))[:, 0] for m in columns[:count]], axis=-1)
        updated = np.zeros((lanes, total, total), dtype=kind) + np.eye(total)
        updated[:, rows, rows] = after
    period = element.period(law.values)
    assert period is not None
    return Sampling(
        label=law.label, number=number, period=_times(period, lanes), delay=delay,
        offset=_times(element.offset(law.values), lanes), taken=taken, entering=entering, updated=updated,
    )  # fmt: skip


def _times(value: Any, lanes: int) -> Array:
    return np.array(np.broadcast_to(np.ravel(value), (lanes,)))
