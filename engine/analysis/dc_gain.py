"""Gains at rest of one diagram at one set of values: in many digits, and in double precision where those cannot be had."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from engine.exact.frequency.dc_gain import known_gain
from engine.model.errors import EngineError, UnresolvedError

if TYPE_CHECKING:
    from engine.diagram.connections import Opening
    from engine.diagram.diagram import Diagram
    from engine.diagram.precise_dc_gain import ExactRest
    from engine.exact.frequency.poles import Poles
    from engine.model.linear_system import Array, LaneSystem

_LOST: Final = 1e-6
"""A gain that double precision does not even know to this part of itself is not told."""
_ROUNDED: Final = 1e-11
"""What changes by its own size where every number changes by this part of its own is their rounding."""


class Resting:
    """Gains at rest, with the infinitesimals of some parameters.

    Parameters
    ----------
    diagram : Diagram
    overrides : mapping
        Parameter values (SI) by path that replace the document's.
    steps : mapping of str to float
        Size of the infinitesimal by parameter path; each is a lane.
    open_at : str or tuple of str, optional
        Where a loop is cut.
    """

    def __init__(
        self,
        diagram: Diagram,
        overrides: Mapping[str, float],
        steps: Mapping[str, float],
        open_at: Opening | None = None,
    ) -> None:
        self._diagram, self._overrides, self._steps, self._open_at = diagram, overrides, steps, open_at

    def gains(self, part: LaneSystem, inputs: Sequence[int], outputs: Sequence[int]) -> Array:
        """Return the gains of a part without a pole at s = 0, shape (lanes, outputs, inputs).

        Parameters
        ----------
        part : LaneSystem
            From these inputs of the diagram to these outputs.
        inputs, outputs : sequence of int
            Their numbers in the diagram.

        Raises
        ------
        UnresolvedError
            When rounding leaves them no digits.
        """
        found = self._entries(inputs, outputs)
        if found is None:
            return _in_double(part)
        if any(entry is None for row in found for entry in row):
            raise without_digits()
        return np.moveaxis(np.array(found), -1, 0)

    def gain(self, part: LaneSystem, own: Poles, source: int, read: int) -> Array | None:
        """Return the gain of a path with the poles ``own``, shape (lanes,); None where an integral makes it grow for ever.

        The poles do not always tell that: rounding makes them see an integral that the path does not, or miss a weak one.

        Raises
        ------
        UnresolvedError
            When rounding leaves it no digits.
        """
        if not np.any(own.at_zero):
            found = self._entries([source], [read])
            return np.asarray(_in_double(part)[:, 0, 0]) if found is None else found[0][0]
        exact = self._in_many_digits
        try:
            return None if exact is None else self._exactly(exact, source, read)
        except UnresolvedError:  # a parameter is about to bring the integral in
            return None

    def _entries(self, inputs: Sequence[int], outputs: Sequence[int]) -> list[list[Array | None]] | None:
        """Return the gains in many digits, None where an integral is seen; None at all where double precision tells them."""
        exact = self._in_many_digits
        if exact is None:
            return None
        try:
            found = [[self._exactly(exact, source, read) for source in inputs] for read in outputs]
        except UnresolvedError:
            return None
        grows = [
            (source, read)
            for read, row in zip(outputs, found, strict=True)
            for source, entry in zip(inputs, row, strict=True)
            if entry is None
        ]
        return None if grows and not any(self._sees(source, read) for source, read in grows) else found

    def _exactly(self, exact: ExactRest, source: int, read: int) -> Array | None:
        """Return a gain in many digits, shape (lanes,); None where it grows."""
        found = exact.gain(source, read)
        if found is None or not self._steps:
            return None if found is None else np.array(found[:1])
        value, slopes = found
        return np.asarray(value + 1j * slopes * np.array(list(self._steps.values())))

    def _sees(self, source: int, read: int) -> bool:
        """Return whether a path sees an integral for more than the rounding of the document's numbers."""
        exact = self._diagram.exact_rest(self._overrides, None, self._open_at)
        return exact.sensitivity(source, read) * _ROUNDED < 1.0

    @cached_property
    def _in_many_digits(self) -> ExactRest | None:
        """The equations of the diagram in many digits; None where they cannot be had."""
        if self._diagram.nonlinear:
            return None
        try:
            return self._diagram.exact_rest(self._overrides, tuple(self._steps), self._open_at)
        except EngineError:
            return None


def _in_double(part: LaneSystem) -> Array:
    """Return the gains in double precision, where that leaves them digits."""
    try:
        gains, error = known_gain(part)
    except np.linalg.LinAlgError:
        raise without_digits() from None
    size = np.abs(gains[0].real)
    if np.any((error > _LOST * size) & (error < size)):  # what is smaller than its error may be 0
        raise without_digits()
    return gains


def without_digits() -> UnresolvedError:
    """Return what is raised where rounding leaves what lasts no digits."""
    return UnresolvedError(
        "what lasts must have digits left, but rounding makes the equations at rest singular: "
        "the system's coefficients lie too far apart"
    )
