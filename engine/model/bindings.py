"""The values of all parameters of a diagram, in an order in which every expression finds its operands ready.

Every number of the document, named or inside a list, has one slot; overriding some of them recomputes only what depends
on them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from engine.model.errors import DiagramError, ExpressionError, Path
from engine.model.expressions import Expression
from engine.model.parameters import Param, Scalar

_REMEMBERED: Final = 256


@dataclass(slots=True, kw_only=True)
class Slot:
    """One number: a constant, or an expression over other slots."""

    label: str
    at: Path
    value: Scalar
    param: Param | None = None
    expression: Expression | None = None
    operands: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Whole:
    """An integer that decides the structure, as an order does: it has no slot and stays what it is."""

    value: int


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockValues:
    """The values of one block, nested as in the document: slot numbers in place of numbers; texts and None as they are."""

    template: Mapping[str, Any]
    slots: frozenset[int]

    def fill(self, values: Sequence[Scalar] | Mapping[int, Scalar]) -> dict[str, Any]:
        """Return the block's values by name, ``values`` being those of all slots or at least of this block's."""
        return {name: _filled(entry, values) for name, entry in self.template.items()}


def _filled(entry: Any, values: Sequence[Scalar] | Mapping[int, Scalar]) -> Any:
    if isinstance(entry, int):
        return values[entry]
    if isinstance(entry, tuple):
        return [_filled(item, values) for item in entry]
    return entry.value if isinstance(entry, Whole) else entry


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """What follows from new values of some slots: the slots to recompute, in order, and the blocks concerned."""

    recompute: tuple[int, ...]
    checked: tuple[int, ...]
    blocks: tuple[int, ...]


@dataclass(kw_only=True, eq=False)
class Bindings:
    """All slots of a diagram and how they depend on each other."""

    slots: list[Slot] = field(default_factory=list)
    blocks: list[BlockValues] = field(default_factory=list)
    order: tuple[int, ...] = ()
    base: list[Scalar] = field(default_factory=list)
    _changes: dict[frozenset[int], Change] = field(default_factory=dict)

    def settle(self) -> None:
        """Order the slots and compute their base values.

        Raises
        ------
        ExpressionError
            If expressions need each other in a circle (named in full) or have no value.
        DiagramError
            If a value is outside its bounds.
        """
        self.order = self._sorted()
        self.base = [slot.value for slot in self.slots]
        self._compute(self.base, self.order)
        for index in range(len(self.slots)):
            self._check(index, self.base[index])

    def check_written(self, indices: Iterable[int]) -> None:
        """Raise as `settle` for those of some slots that are written as numbers; what expressions give is not known yet."""
        for index in sorted(indices):
            if self.slots[index].expression is None:
                self._check(index, self.slots[index].value)

    def override(self, values: Mapping[int, Scalar], change: Change) -> list[Scalar]:
        """Return all values after ``values`` replace those of some slots; raises as `settle` does."""
        result = list(self.base)
        for index, value in values.items():
            result[index] = value
        self._compute(result, change.recompute)
        for index in change.checked:
            self._check(index, result[index])
        return result

    def admitted(self, values: Sequence[Any], change: Change, members: int) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """Tell for every member of a batch whether all its values exist and are within their bounds."""
        valid = np.ones(members, dtype=bool)
        for index in change.checked:
            param = self.slots[index].param
            valid &= np.isfinite(np.asarray(values[index])) if param is None else param.admits(values[index])
        return valid

    def override_many(self, values: Mapping[int, Scalar], change: Change) -> list[Scalar]:
        """Return all values for a batch; what does not exist is NaN."""
        result = list(self.base)
        for index, value in values.items():
            result[index] = value
        for index in change.recompute:
            result[index] = self.value_of(index, result)
        return result

    def value_of(self, index: int, values: Sequence[Scalar]) -> Scalar:
        """Return the value of a slot with an expression from those of its operands."""
        slot = self.slots[index]
        assert slot.expression is not None  # only expressions are recomputed
        return slot.expression.evaluate([values[operand] for operand in slot.operands])

    def _compute(self, values: list[Scalar], indices: Sequence[int]) -> None:
        for index in indices:
            try:
                values[index] = self.value_of(index, values)
            except ExpressionError as error:
                error.at = self.slots[index].at
                raise

    def _check(self, index: int, value: Scalar) -> None:
        slot = self.slots[index]
        if slot.param is not None and not slot.param.admits(value):
            raise DiagramError(
                f"{slot.label} must be {slot.param.rule(float(value.real))}, got {value.real:g}", at=slot.at
            )

    def change(self, varied: frozenset[int]) -> Change:
        """Return what follows from new values of the slots ``varied``."""
        known = self._changes.get(varied)
        if known is None:
            if len(self._changes) >= _REMEMBERED:
                self._changes.clear()
            known = self._changes[varied] = self._follow(varied)
        return known

    def _follow(self, varied: frozenset[int]) -> Change:
        touched = set(varied)
        recompute = []
        for index in self.order:
            if touched.intersection(self.slots[index].operands):
                touched.add(index)
                recompute.append(index)
        return Change(
            recompute=tuple(recompute),
            checked=tuple(sorted(touched)),
            blocks=tuple(number for number, block in enumerate(self.blocks) if touched & block.slots),
        )

    def _sorted(self) -> tuple[int, ...]:
        """Return the expressions, operands first, by depth-first search without recursion."""
        done: set[int] = set()
        order: list[int] = []
        for root in range(len(self.slots)):
            trail = [root]
            while trail:
                index = trail[-1]
                pending = next((o for o in self.slots[index].operands if o not in done), None)
                if pending is None:
                    trail.pop()
                    if index not in done:
                        done.add(index)
                        if self.slots[index].expression is not None:
                            order.append(index)
                elif pending in trail:
                    circle = [*trail[trail.index(pending) :], pending]
                    names = " -> ".join(self.slots[i].label for i in circle)
                    raise ExpressionError(f"parameters must not depend on themselves, got {names}",
                                          at=self.slots[pending].at)  # fmt: skip
                else:
                    trail.append(pending)
        return tuple(order)
