"""The realised system as named matrices: what every export is made of.

x' = A x + B1 u + B2 w,   y = C1 x + D11 u + D12 w,   z = C2 x + D21 u + D22 w,   w_i(t) = z_i(t - delay_i)

Without delays that is x' = A x + B u, y = C x + D u. With them it is the form that MATLAB's `setDelayModel` takes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.diagram.connections import Opening
from engine.diagram.diagram import Diagram
from engine.exact.frequency.path import merged
from engine.exact.frequency.poles import poles
from engine.model.linear_system import LaneSystem, LinearSystem

Array = npt.NDArray[np.float64]

_PLAIN: Final = {"A": "a", "B": "b1", "C": "c1", "D": "d11"}
_DELAYED: Final = {
    "A": "a", "B1": "b1", "B2": "b2", "C1": "c1", "C2": "c2", "D11": "d11", "D12": "d12", "D21": "d21", "D22": "d22",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Matrices:
    """A linear system with the names of its states and delay channels, and the units of its outputs.

    Attributes
    ----------
    system : LinearSystem
        n states, m delay channels, all numbers in SI.
    states : tuple of str
        Block and number of each state: ``controller.x1``.
    channels : tuple of str
        Block and number of each delay channel: ``line.w1``.
    output_units : tuple of str
        SI unit of each output, "" where it is not known.
    """

    system: LinearSystem
    states: tuple[str, ...]
    channels: tuple[str, ...]
    output_units: tuple[str, ...]

    @property
    def poles(self) -> npt.NDArray[np.complex128]:
        """The poles, rad/s, by falling real part; with delays the rightmost ones."""
        return poles(merged(LaneSystem.of([self.system]).balanced())).values

    @property
    def delayed(self) -> bool:
        """Whether the system has delay channels."""
        return bool(self.channels)

    @property
    def arrays(self) -> dict[str, Array]:
        """The matrices by name: A, B, C, D, or with delays A, B1, B2, C1, C2, D11, D12, D21, D22 and ``delays`` in s."""
        names = _DELAYED if self.delayed else _PLAIN
        found = {name: getattr(self.system, attribute) for name, attribute in names.items()}
        return {**found, "delays": self.system.delays, "x0": self.system.x0}

    def document(self) -> dict[str, Any]:
        """Return names, units and matrices (rows as lists) as JSON values."""
        return {
            "states": list(self.states),
            "inputs": list(self.system.inputs),
            "outputs": list(self.system.outputs),
            "output_units": list(self.output_units),
            "channels": list(self.channels),
            **{name: array.tolist() for name, array in self.arrays.items()},
        }


def realized(
    diagram: Diagram, *, overrides: Mapping[str, float] | None = None, open_at: Opening | None = None
) -> Matrices:
    """Return the state space of a diagram with its names.

    Parameters
    ----------
    diagram : Diagram
    overrides : mapping, optional
        Parameter values (SI) that replace those of the document.
    open_at : str or tuple of str, optional
        Endpoint where the loop is cut: the last input and the last output, ``loop``, are then its two ends.

    Raises
    ------
    DiagramError
        If the endpoint does not exist.
    """
    system = diagram.realize(overrides, open_at)
    traced = diagram.trace(())
    blocks = list(zip(traced.interconnection.blocks, traced.realizations, strict=True))
    return Matrices(
        system=system,
        states=tuple(f"{block.path}.x{k + 1}" for block, own in blocks for k in range(own.a.shape[-1])),
        channels=tuple(f"{block.path}.w{k + 1}" for block, own in blocks for k in range(own.delays.shape[-1])),
        output_units=tuple(diagram.output_units.get(name, "") for name in system.outputs),
    )


def numbered(system: LinearSystem) -> Matrices:
    """Return a linear system without a diagram: its states are x1, x2, ..., its delay channels w1, w2, ..."""
    return Matrices(
        system=system,
        states=tuple(f"x{k + 1}" for k in range(system.states)),
        channels=tuple(f"w{k + 1}" for k in range(len(system.delays))),
        output_units=("",) * len(system.outputs),
    )
