"""A nonlinear block in its place: its values, its states among all states, its channels among all channels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from engine.elements._base import Values
from engine.elements._nonlinear import Mode, Moment, NonlinearElement, Signals, entries
from engine.model.errors import Path

Rows = slice | npt.NDArray[np.intp]
"""Some lanes, or some members of a batch."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Law:
    """One nonlinear block in its place: its states among all states, its channels among all channels.

    ``values`` are the block's values, numbers or arrays (lanes, 1); ``real`` the same without infinitesimals.
    """

    element: type[NonlinearElement]
    label: str
    at: Path
    values: Values
    real: Values
    states: slice
    inputs: slice
    outputs: slice
    resting: bool = False

    def rates(self, m: Moment, mode: Mode) -> Signals:
        """Return the rates of the states; where ``resting``, what is 0 at rest."""
        return (self.element.unrest if self.resting else self.element.rates)(m, mode, self.values)

    def members(self, rows: Rows) -> Law:
        """Return the law of some lanes, or of some members of a batch."""
        values = _members(self.values, rows)
        return replace(self, values=values, real=_real(values))

    @property
    def complex(self) -> bool:
        """Whether a value carries an infinitesimal."""
        return any(np.iscomplexobj(entry) for entry in entries(self.values))


def _members(value: Any, rows: Rows) -> Any:
    if isinstance(value, Mapping):
        return {name: _members(entry, rows) for name, entry in value.items()}
    if isinstance(value, list):
        return [_members(entry, rows) for entry in value]
    return value[rows] if isinstance(value, np.ndarray) and len(value) > 1 else value


def _real(value: Any) -> Any:
    """Return values without infinitesimals, of the first lane."""
    if isinstance(value, Mapping):
        return {name: _real(entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [_real(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return float(np.ravel(value)[0].real)
    return value.real if isinstance(value, complex) else value


def law_values(value: Any) -> tuple[Any, Any]:
    """Return a block's values as a law has them: with an axis for the instants behind that of the lanes, and real."""
    return _lanes(value), _real(value)


def _lanes(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _lanes(entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [_lanes(entry) for entry in value]
    return value[:, None] if isinstance(value, np.ndarray) else value
