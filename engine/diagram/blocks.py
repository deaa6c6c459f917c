"""The blocks of a diagram and their values: new values of some parameters in, realisations of all blocks out.

Only what a change concerns is computed again: `changed` for one set of values, `changed_members` for many, of which some
may not exist, `changed_lanes` for one with several infinitesimals, `traced` for formulas.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.diagram.flatten import Flat
from engine.elements import Realization
from engine.model.bindings import Change
from engine.model.errors import DiagramError, EngineError
from engine.model.names import no_parameter
from engine.model.parameters import Param, ParameterInfo, Scalar
from engine.model.traced import Graph, Traced

MAX_STATES: Final = 200
MAX_DELAYS: Final = 50


class Blocks:
    """All blocks of a flattened diagram, realised at the document's values and at others.

    Parameters
    ----------
    flat : Flat
        With its numbers settled.
    parameters : mapping of str to ParameterInfo
        Every scalar by its path.

    Attributes
    ----------
    base : list of Realization
        At the document's values.
    """

    def __init__(self, flat: Flat, parameters: Mapping[str, ParameterInfo]) -> None:
        self._flat = flat
        self._bindings = flat.numbers.bindings
        self._parameters = parameters
        self.base = self._realized_base()

    def value(self, path: str) -> float:
        """Return the document's value of a parameter."""
        return float(self._bindings.base[self._slot(path)].real)

    def of(self, number: int, values: Sequence[Scalar]) -> dict[str, Any]:
        """Return the values of one block by name."""
        return self._bindings.blocks[number].fill(values)

    def changed(self, overrides: Mapping[str, float | complex]) -> tuple[list[Realization], list[Scalar]]:
        """Return all realisations and all values after ``overrides``."""
        slots = {self._slot(path): _single(path, value) for path, value in overrides.items()}
        change = self._bindings.change(frozenset(slots))
        values = self._bindings.override(slots, change)
        return self._realized(change, values), values

    def changed_members(
        self, batch: Mapping[str, npt.NDArray[Any]], count: int
    ) -> tuple[list[Realization], list[Scalar], npt.NDArray[np.bool_]]:
        """Return realisations and values of ``count`` members, and which of them exist; a member that does not is no error."""
        with np.errstate(all="ignore"):
            values, change, admitted = self._values_of_members(batch, count)
            realizations = list(self.base)
            for number in change.blocks:
                try:
                    realizations[number] = self._realize(number, values)
                except (
                    EngineError
                ):  # the block exists for no member at all; its realisation at the document's values stays
                    admitted[:] = False
        return realizations, values, admitted

    def admitted(self, batch: Mapping[str, npt.NDArray[Any]], count: int) -> npt.NDArray[np.bool_]:
        """Return which of ``count`` members have all their values, each within its bounds."""
        with np.errstate(all="ignore"):
            return self._values_of_members(batch, count)[2]

    def _values_of_members(
        self, batch: Mapping[str, npt.NDArray[Any]], count: int
    ) -> tuple[list[Scalar], Change, npt.NDArray[np.bool_]]:
        slots: dict[int, Scalar] = {self._slot(path): value * 1.0 for path, value in batch.items()}
        change = self._bindings.change(frozenset(slots))
        values = self._bindings.override_many(slots, change)
        return values, change, self._bindings.admitted(values, change, count)

    def changed_lanes(
        self, steps: Mapping[str, float], overrides: Mapping[str, float]
    ) -> tuple[list[Realization], list[Scalar]]:
        """Return realisations and values with a lane for each parameter of ``steps``."""
        lanes = self.lanes(steps, overrides)
        slots: dict[int, Scalar] = {self._slot(path): value for path, value in lanes.items()}
        change = self._bindings.change(frozenset(slots))
        with np.errstate(all="ignore"):
            values = self._bindings.override_many(slots, change)
            return self._realized(change, values), values

    def traced(
        self, varied: Sequence[str], graph: Graph, besides: Collection[int]
    ) -> tuple[list[Realization], list[Scalar], tuple[tuple[Param, Traced], ...]]:
        """Return realisations and values as formulas of ``varied``, and the values that have bounds.

        Blocks ``besides`` stay as they are at the document's values.
        """
        slots: dict[int, Scalar] = {self._slot(path): graph.parameter(self.value(path)) for path in varied}
        change = self._bindings.change(frozenset(slots))
        values = self._bindings.override_many(slots, change)
        realizations = self._realized(change, values, besides)
        bounds = [(self._bindings.slots[index].param, values[index]) for index in change.checked]
        checked = tuple((param, value) for param, value in bounds if param is not None and isinstance(value, Traced))
        return realizations, values, checked

    def formulas(
        self, overrides: Mapping[str, float], moved: Sequence[str], graph: Graph
    ) -> tuple[list[Realization], list[float], dict[int, int]]:
        """Return all realisations as formulas of every number of the document, the numbers, and the lanes of those ``moved``.

        A number that is 0 and does not move is none: it decides, as elsewhere, what a block does not need.
        """
        given = {self._slot(path): value for path, value in overrides.items()}
        lane_of = {self._slot(path): lane for lane, path in enumerate(moved)}
        values = list(self._bindings.base)
        numbers: list[float] = []
        lanes: dict[int, int] = {}
        for index, slot in enumerate(self._bindings.slots):
            if slot.expression is None:
                number = float(given.get(index, values[index]).real)
                values[index] = number
                if number or index in lane_of:
                    if index in lane_of:
                        lanes[len(numbers)] = lane_of[index]
                    values[index] = graph.parameter(number)
                    numbers.append(number)
        for index in self._bindings.order:
            values[index] = self._bindings.value_of(index, values)
        return [self._realize(number, values) for number in range(len(self._flat.blocks))], numbers, lanes

    def lanes(self, steps: Mapping[str, float], overrides: Mapping[str, float]) -> dict[str, npt.NDArray[Any]]:
        """Return values by path, (lanes,), lane k carrying the infinitesimal of parameter k."""
        values = {**{path: self.value(path) for path in steps}, **overrides}
        lanes = {path: np.full(len(steps), value, dtype=complex) for path, value in values.items()}
        for lane, (path, step) in enumerate(steps.items()):
            lanes[path][lane] += 1j * step
        return lanes

    def _realized(self, change: Change, values: list[Scalar], besides: Collection[int] = ()) -> list[Realization]:
        realizations = list(self.base)
        for number in change.blocks:
            if number not in besides:
                realizations[number] = self._realize(number, values)
        return realizations

    def _realized_base(self) -> list[Realization]:
        """Return all blocks at the document's values, refusing what is too large before anything is built of it."""
        realizations: list[Realization] = []
        states = delays = 0
        for number in range(len(self._flat.blocks)):
            realization = self._realize(number, self._bindings.base)
            states, delays = states + realization.a.shape[-1], delays + realization.delays.shape[-1]
            for name, count, limit in (("states", states, MAX_STATES), ("delays", delays, MAX_DELAYS)):
                if count > limit:
                    raise DiagramError(f"{name} must be at most {limit}, got {count} or more", at=("blocks",))
            realizations.append(realization)
        return realizations

    def _realize(self, number: int, values: list[Scalar]) -> Realization:
        try:
            return self._flat.elements[number].realize(self._bindings.blocks[number].fill(values))
        except EngineError as error:
            block = self._flat.blocks[number]
            raise error.of(block.path).within(*block.at) from None
        except (ZeroDivisionError, OverflowError):
            block = self._flat.blocks[number]
            raise DiagramError(f"{block.path} must have finite coefficients, but they overflow", at=block.at) from None

    def _slot(self, path: str) -> int:
        index = self._flat.numbers.paths.get(path)
        if index is None:
            raise DiagramError(no_parameter(path, self._parameters), at=(path,))
        if self._parameters[path].bound:
            expression = self._bindings.slots[index].expression
            given = "" if expression is None else expression.text
            raise DiagramError(f"{path} must not be varied: the expression '{given}' gives its value", at=(path,))
        return index


def _single(path: str, value: complex) -> Scalar:
    number = complex(value) if np.iscomplexobj(value) else float(value.real)
    if not math.isfinite(number.real):
        raise DiagramError(f"{path} must be finite, got {number.real}", at=(path,))
    return number
