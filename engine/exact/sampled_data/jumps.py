"""The jumps of a sampled system: samples, what follows them, and what is under way in pure delays."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.elements._nonlinear import Moment, stacked
from engine.elements._sampler import Sampler
from engine.exact.sampled_data.system import Limit, Sampling

if TYPE_CHECKING:
    from engine.elements._limiting import Limiting
    from engine.exact.laws.laws import Law
    from engine.exact.sampled_data import pieces, transport
    from engine.exact.sampled_data.followers import Turn
    from engine.model.linear_system import Array


def moving_on(line: transport.Line, row: Array, entering: Array, *, number: int) -> list[Sampling]:
    """Return the events of a line: a value begins its way, the one before it goes on, and the oldest arrives."""
    lanes, total = row.shape
    own = _beginning(line.begins, line.states, row, entering, number=number)
    if line.arrives is None:
        return [own]
    arriving = np.zeros((lanes, total, total)) + np.eye(total)
    arriving[:, line.end] = np.eye(total)[line.end - 1]
    return [
        own, replace(own, offset=line.arrives.first, taken=arriving, entering=np.zeros_like(own.entering), turn=0),
    ]  # fmt: skip


def _beginning(clock: transport.Clock, states: range, row: Array, entering: Array, *, number: int) -> Sampling:
    """Return the event at which values move on by one in their ``states`` and the first takes a new one."""
    lanes, total = row.shape
    taken = np.zeros((lanes, total, total), dtype=np.result_type(row, float)) + np.eye(total)
    for state in states:
        taken[:, state] = np.eye(total)[state - 1]
    taken[:, states.start] = row
    begun = np.zeros((lanes, total, entering.shape[-1]), dtype=np.result_type(entering, float))
    begun[:, states.start] = entering
    return Sampling(
        label=clock.label, number=number, period=clock.period, delay=np.zeros(lanes), offset=clock.first, taken=taken,
        entering=begun, turn=2, sampler=False,
    )  # fmt: skip


def passing(course: pieces.Course, row: Array, entering: Array, *, number: int) -> list[Sampling]:
    """Return the events of a channel that flows: its values are taken, and polynomials through them begin."""
    lanes, total = row.shape
    found: list[Sampling] = []
    for value in course.values:
        taken = _beginning(value.begins, value.states, row, entering, number=number + len(found))
        found.append(replace(taken, piece=True))
    for load in course.loads:
        loaded = np.zeros((lanes, total, total), dtype=np.result_type(load.matrix, float)) + np.eye(total)
        loaded[:, course.chain] = 0.0
        loaded[:, np.array(course.chain)[:, None], load.taken] = load.matrix
        nothing = np.zeros((lanes, total, entering.shape[-1]))
        own = Sampling(
            label=load.at.label, number=number + len(found), period=load.at.period, delay=np.zeros(lanes), offset=load.at.first,
            taken=loaded, entering=nothing, turn=0, sampler=False,
            piece=True,
        )  # fmt: skip
        found.append(own)
    return found


def sampling(law: Law, number: int, lanes: int, sees: Array, follows: Array) -> Sampling:
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
    delay = times(element.latency(law.values), lanes)
    updated = None
    if np.any(delay):
        after = np.stack([stacked(element.update(m, 0, values), (lanes, 1))[:, 0] for m in columns[:count]], axis=-1)
        updated = np.zeros((lanes, total, total), dtype=kind) + np.eye(total)
        updated[:, rows, rows] = after
    period = element.period(law.values)
    assert period is not None
    return Sampling(
        label=law.label, number=number, period=times(period, lanes), delay=delay,
        offset=times(element.offset(law.values), lanes), taken=taken, entering=entering, updated=updated,
        limit=_limit(law, lanes),
    )  # fmt: skip


def _limit(law: Law, lanes: int) -> Limit | None:
    """Return what limits a sampler in its place."""
    assert issubclass(law.element, Sampler)
    own = law.element.limiting(law.values)
    if own is None:
        return None
    first = law.states.start
    late = np.any(times(law.element.latency(law.values), lanes))
    return _placed(own, lanes, computed=first + 1, output=None if late else first, states=first)


def _placed(own: Limiting, lanes: int, *, computed: int, output: int | None, states: int) -> Limit:
    return Limit(
        computed=computed, output=output, integral=None if own.integral is None else states + own.integral,
        lower=times(own.lower, lanes), upper=times(own.upper, lanes), reach=times(own.reach, lanes),
        share=times(own.share, lanes), shape=own.shape,
    )  # fmt: skip


def following(law: Law, turn: Turn, lanes: int, sees: Array, follows: Array) -> Sampling:
    """Return a law without memory in its place, whose only state is its output; what it sees is ``sees`` ξ + ``follows`` u."""
    own = law.element.limiting(law.values)
    assert own is not None
    row, total, kind = law.states.start, sees.shape[-1], np.result_type(sees, follows)
    taken = np.zeros((lanes, total, total), dtype=kind) + np.eye(total)
    taken[:, row] = sees[:, law.inputs.start]
    entering = np.zeros((lanes, total, follows.shape[-1]), dtype=kind)
    entering[:, row] = follows[:, law.inputs.start]
    return Sampling(
        label=law.label, number=turn.number, period=turn.clock.period, delay=np.zeros(lanes), offset=turn.clock.first, taken=taken,
        entering=entering, turn=turn.turn, limit=_placed(own, lanes, computed=row, output=None, states=row),
    )  # fmt: skip


def times(value: Any, lanes: int) -> Array:
    """Return a time (lanes,)."""
    return np.array(np.broadcast_to(np.ravel(value), (lanes,)))
