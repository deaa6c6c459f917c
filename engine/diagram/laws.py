"""The blocks of a diagram that are no linear systems: cut out as laws, or with their slopes where the diagram rests."""

from __future__ import annotations

from collections.abc import Mapping

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

    def cut_out(
        self,
        channels: Channels,
        realizations: list[Realization],
        values: list[Scalar],
        closed: Wiring,
        admitted: Flags | None = None,
    ) -> NonlinearSystem:
        """Return the system with the laws of the blocks of some channels, all others as they are realised."""
        wiring = channels.wiring(closed, self._interconnection.outputs)
        assembled = self._interconnection.assemble(channels.without(realizations), wiring, admitted=admitted)
        own = {number: self._blocks.of(number, values) for number in channels.numbers}
        return channels.system(assembled.matrices, closed, own)

    def system(
        self, realizations: list[Realization], values: list[Scalar], closed: Wiring, admitted: Flags | None = None
    ) -> NonlinearSystem:
        """Return the system with the laws of all nonlinear blocks."""
        return self.cut_out(self._channels, realizations, values, closed, admitted)

    def linearized(self, realizations: list[Realization], values: list[Scalar], closed: Wiring) -> list[Realization]:
        """Return the realisations with the slopes of the nonlinear blocks at the operating point."""
        found = list(realizations)
        slopes = self._slopes(self.system(realizations, values, closed))
        for number, realization in zip(self._channels.numbers, slopes, strict=True):
            found[number] = realization
        return found

    def linearized_members(
        self, realizations: list[Realization], values: list[Scalar], closed: Wiring, admitted: Flags
    ) -> list[Realization]:
        """Return the realisations of a batch, each member's nonlinear blocks linearised at its own operating point.

        A member that has none is no longer ``admitted``, which is overwritten.
        """
        system = self.system(realizations, values, closed, admitted)
        found = list(realizations)
        members: list[list[Realization] | None] = []
        for index in range(len(admitted)):
            try:
                members.append(self._slopes(system.member(index)) if admitted[index] else None)
            except EngineError:  # a loop through nonlinear blocks has no solution for this member
                members.append(None)
        for place, number in enumerate(self._channels.numbers):
            own = [None if member is None else member[place] for member in members]
            found[number] = joined(own, like=realizations[number])
        for index, member in enumerate(members):
            admitted[index] &= member is not None
        return found

    def _slopes(self, system: NonlinearSystem) -> list[Realization]:
        return small_signal(system, operating_point(system, self._constants))
