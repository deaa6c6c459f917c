"""What impulses leave behind: with u = J δ(t), x' = A x + B u makes x(0+) = x(0) + B J.

Through a direct gain an impulse would go on to an output, a delay or a nonlinear law as an impulse, which no curve can show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from engine.model.errors import SignalError

if TYPE_CHECKING:
    from engine.model.linear_system import Array, LaneSystem
    from engine.signals import Signal


def struck(system: LaneSystem, signals: Sequence[Signal]) -> LaneSystem:
    """Return a system with the states right after the impulses among its commands; itself where there are none.

    Parameters
    ----------
    system : LaneSystem
    signals : sequence of Signal
        One for each input, in order.

    Raises
    ------
    SignalError
        If an impulse goes straight to an output or into a delay.
    """
    areas = areas_of(signals)
    if areas is None:
        return system
    for k in np.flatnonzero(areas):
        refuse_straight(system.d11[0, :, k], system.inputs[k], system.outputs)
        refuse_straight(system.d21[0, :, k], system.inputs[k], ["a delay"] * system.m)
    return replace(system, x0=system.x0 + system.b1 @ areas)


def areas_of(signals: Sequence[Signal | None]) -> Array | None:
    """Return the integral of each impulse, 0 for other commands; None where there are none."""
    found = [0.0 if signal is None else signal.impulse() for signal in signals]
    return np.array(found) if any(found) else None


def refuse_straight(gains: npt.NDArray[Any], source: str, targets: Sequence[str]) -> None:
    """Refuse an impulse that goes straight to one of these targets."""
    reached = [target for gain, target in zip(gains, targets, strict=True) if gain != 0]
    if reached:
        raise SignalError(
            f"an impulse at {source} must not go straight to {reached[0]} (there is a direct gain): "
            "ask for other outputs, put a lag in between, or give a short pulse",
            at=("input",),
        )
