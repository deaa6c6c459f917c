"""Nonlinear laws as linear blocks: their exact slopes at the operating point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.elements import Realization
from engine.elements._nonlinear import Moment, linearized
from engine.exact.nonlinear.operating_point import OperatingPoint, operating_point

if TYPE_CHECKING:
    from engine.exact.laws.laws import Law
    from engine.exact.laws.system import NonlinearSystem


def small_signal(system: NonlinearSystem, point: OperatingPoint | None = None) -> list[Realization]:
    """Return a linear block for each law of ``system``, with a batch axis where the system has several lanes.

    Parameters
    ----------
    system : NonlinearSystem
    point : OperatingPoint, optional
        Where the slopes are taken; by default where the system rests with all inputs 0.
    """
    point = operating_point(system) if point is None else point
    t = np.zeros((system.lanes, 1))
    return [
        linearized(law.element, system.moment(law, t, point.x[:, None], point.e[:, None]), mode, law.values)
        for law, mode in zip(system.laws, point.modes, strict=True)
    ]


def joined(members: Sequence[Realization | None], *, like: Realization, law: Law) -> Realization:
    """Return one realisation with a batch axis; a member that does not exist (None) is 0.

    ``like`` has the shapes where there is no member: it may have a batch axis itself. ``law`` has the values of all members.
    """
    first = next((member for member in members if member is not None), None)
    if first is None:
        return like
    if any(member is not None and member.a.shape[-1] != first.a.shape[-1] for member in members):
        # Of some members a state falls away (ki = 0): a law that has them tells its slopes without being asked where.
        nowhere = Moment(t=np.zeros((len(members), 1)), x=[], z=[])
        return linearized(law.element, nowhere, 0, law.values)
    arrays: dict[str, Any] = {}
    for entry in fields(Realization):
        if entry.name == "reading":  # a law is linearised into its matrices alone
            continue
        own = [None if member is None else getattr(member, entry.name) for member in members]
        pattern = getattr(first, entry.name)
        if pattern is None:
            arrays[entry.name] = None
            continue
        axes = 1 if entry.name in {"delays", "initial"} else 2
        shape = pattern.shape[pattern.ndim - axes :]
        arrays[entry.name] = np.stack([np.zeros(shape) if a is None else a.reshape(shape) for a in own])
    return Realization(**arrays)
