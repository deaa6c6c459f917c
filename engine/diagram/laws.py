"""The blocks of a diagram that are no linear systems: cut out as laws, or with their slopes where the diagram rests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from engine.diagram.blocks import Blocks
from engine.diagram.channels import Channels
from engine.diagram.realize import Interconnection, Wiring
from engine.elements import Realization
from engine.exact.laws.system import NonlinearSystem
from engine.exact.nonlinear.linearize import joined, small_signal
from engine.exact.nonlinear.operating_point import operating_point
from engine.model.errors import EngineError
from engine.model.parameters import Scalar

Flags = npt.NDArray[np.bool_]

_REMEMBERED: Final = 8
"""So many sets of values are known again."""


class Laws:
    """The nonlinear blocks of a diagram.

    Parameters
    ----------
    blocks : Blocks
        All blocks of the diagram.
    channels : Channels
        Those whose laws are meant.
    interconnection : Interconnection
    constants : mapping of input name to float
        Constant inputs of the operating point, SI; 0 where left out.
    """

    def __init__(
        self, blocks: Blocks, channels: Channels, interconnection: Interconnection, constants: Mapping[str, float]
    ) -> None:
        self._blocks = blocks
        self._channels = channels
        self._interconnection = interconnection
        self._constants = constants
        self._known: dict[bytes, _Linearized] = {}

    def cut_out(
        self,
        channels: Channels,
        realizations: list[Realization],
        values: list[Scalar],
        closed: Wiring,
        admitted: Flags | None = None,
    ) -> NonlinearSystem:
        """Return the system with the laws of the blocks of some channels, all others as they are realised.

        A member of a batch for which there is none is no longer ``admitted``, which is overwritten.
        """
        wiring = channels.wiring(closed, self._interconnection.outputs)
        assembled = self._interconnection.assemble(channels.without(realizations), wiring, admitted=admitted)
        if admitted is not None:
            admitted &= assembled.valid
        own = {number: self._blocks.of(number, values) for number in channels.numbers}
        return channels.system(assembled.matrices, closed, own)

    def system(
        self, realizations: list[Realization], values: list[Scalar], closed: Wiring, admitted: Flags | None = None
    ) -> NonlinearSystem:
        """Return the system with the laws of all nonlinear blocks."""
        return self.cut_out(self._channels, realizations, values, closed, admitted)

    def linearized(self, realizations: list[Realization], values: list[Scalar], closed: Wiring) -> list[Realization]:
        """Return the realisations with the slopes of the nonlinear blocks at the operating point."""
        key = _key(values)
        known = self._known.get(key)
        if known is None:
            own = self._slopes(self.system(realizations, values, closed))
            known = self._remember(key, _Linearized(own=own, exist=np.ones(1, dtype=bool)))
        return self._with(realizations, known)

    def linearized_members(
        self, realizations: list[Realization], values: list[Scalar], closed: Wiring, admitted: Flags
    ) -> list[Realization]:
        """Return the realisations of a batch, each member's nonlinear blocks linearised at its own operating point.

        A member that has none is no longer ``admitted``, which is overwritten.
        """
        key = _key([*values, admitted])
        known = self._known.get(key)
        if known is None:
            here = admitted.copy()
            system = self.system(realizations, values, closed, here)
            members: list[list[Realization] | None] = []
            for index in range(len(here)):
                try:
                    members.append(self._slopes(system.member(index)) if here[index] else None)
                except EngineError:  # a loop through nonlinear blocks has no solution for this member
                    members.append(None)
            own = [
                joined(
                    [None if member is None else member[place] for member in members],
                    like=realizations[number],
                    law=law,
                )
                for place, (number, law) in enumerate(zip(self._channels.numbers, system.laws, strict=True))
            ]
            exist = np.array([member is not None for member in members], dtype=bool)
            known = self._remember(key, _Linearized(own=own, exist=exist))
        admitted &= known.exist
        return self._with(realizations, known)

    def _with(self, realizations: list[Realization], known: _Linearized) -> list[Realization]:
        found = list(realizations)
        for number, realization in zip(self._channels.numbers, known.own, strict=True):
            found[number] = realization
        return found

    def _remember(self, key: bytes, found: _Linearized) -> _Linearized:
        if len(self._known) >= _REMEMBERED:
            self._known.clear()
        self._known[key] = found
        return found

    def _slopes(self, system: NonlinearSystem) -> list[Realization]:
        return small_signal(system, operating_point(system, self._constants))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Linearized:
    """The nonlinear blocks of some members as linear ones, and which members have an operating point."""

    own: list[Realization]
    exist: Flags


def _key(values: Sequence[Scalar | Flags]) -> bytes:
    """Return the bits of all values, by which they are known again: loops are opened at several places, with the same slopes."""
    arrays = [np.asarray(value) for value in values]
    shapes = repr([(array.dtype.char, array.shape) for array in arrays]).encode()
    return shapes + b"".join(array.tobytes() for array in arrays)
