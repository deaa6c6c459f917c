"""Every number of a document gets a slot: a plain number, or an expression over the parameters of its own system."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from engine.elements import Element
from engine.model.bindings import Bindings, BlockValues, Slot, Whole
from engine.model.document import Parameter
from engine.model.errors import DiagramError, ExpressionError, Path
from engine.model.expressions import RESERVED, parse
from engine.model.names import check_distinct, check_name
from engine.model.parameters import Param

MAX_LIST: Final = 201
MAX_NUMBERS: Final = 50_000
_QUOTED: Final = 80


@dataclass(frozen=True, slots=True, kw_only=True)
class Declared:
    """A system parameter of the document and its own bounds, which hold for the document, not for what is tried later."""

    parameter: Parameter
    bounds: Param


@dataclass(kw_only=True, eq=False)
class Numbers:
    """All numbers of a diagram: their slots, the path of each scalar, and which of them are system parameters."""

    bindings: Bindings = field(default_factory=Bindings)
    paths: dict[str, int] = field(default_factory=dict)
    declared: dict[int, Declared] = field(default_factory=dict)

    def settle(self) -> None:
        """Compute all values and check them against the bounds of elements and of the document itself.

        Raises
        ------
        ExpressionError, DiagramError
            As `Bindings.settle` does, and where a value is outside the document's own bounds.
        """
        self.bindings.settle()
        for index, declared in self.declared.items():
            value = self.bindings.base[index].real
            if not declared.bounds.admits(value):
                slot = self.bindings.slots[index]
                raise DiagramError(
                    f"{slot.label} must be {declared.bounds.rule(float(value))}, got {value:g}", at=slot.at
                )

    def read_parameters(self, path: tuple[str, ...], parameters: Mapping[str, Parameter], at: Path) -> Reader:
        """Give every system parameter a slot and return the reader of everything else in that system.

        Raises
        ------
        DiagramError
            If a name is reserved, or a value or bound is no number.
        ExpressionError
            If an expression cannot be read or names an unknown parameter.
        """
        slots = self.bindings.slots
        names: dict[str, int] = {}
        for name, parameter in parameters.items():
            here = (*at, name)
            if name.lower() in RESERVED:
                reserved = ", ".join(sorted(RESERVED))
                raise DiagramError(
                    f"parameter name must not be one of {reserved}, in whatever case, got '{name}'", at=here
                )
            label = ".".join((*path, name))
            names[name] = self.paths[label] = len(slots)
            self.declared[len(slots)] = Declared(parameter=parameter, bounds=_bounds(label, parameter, here))
            slots.append(Slot(label=label, at=(*here, "value"), value=math.nan))
        reader = Reader(numbers=self, names=names)
        for name, parameter in parameters.items():
            reader.assign(slots[names[name]], parameter.value)
        return reader


def _bounds(label: str, parameter: Parameter, at: Path) -> Param:
    lower = -math.inf if parameter.lower is None else parameter.lower
    upper = math.inf if parameter.upper is None else parameter.upper
    for name, bound in (("lower", lower), ("upper", upper)):
        if isinstance(bound, bool) or not isinstance(bound, int | float) or math.isnan(bound):
            raise DiagramError(f"{name} of {label} must be a number, got {bound!r}", at=(*at, name))
    if lower > upper:
        raise DiagramError(f"lower of {label} must be <= upper {upper:g}, got {lower:g}", at=(*at, "lower"))
    return Param(name=label, symbol=label, doc=parameter.doc, unit=parameter.unit, lower=lower, upper=upper)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Place:
    """What is being read: its path in words, its place in the document and its declaration."""

    label: str
    at: Path
    param: Param

    def entry(self, index: int) -> _Place:
        return _Place(label=f"{self.label}[{index}]", at=(*self.at, index), param=self.param)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reader:
    """Reads the values of one system, whose expressions see that system's parameters only."""

    numbers: Numbers
    names: Mapping[str, int]

    def assign(self, slot: Slot, given: Any) -> None:
        """Put a number or an expression into a slot."""
        if not (isinstance(given, str) and given.startswith("=")):
            slot.value = _number(slot.label, given, slot.at)
            return
        try:
            expression = parse(given)
        except ExpressionError as error:
            error.at = slot.at
            raise
        for name in expression.names:
            if name not in self.names:
                known = ", ".join(self.names) or "none"
                raise ExpressionError(
                    f"expression '{given}' must name parameters of its system ({known}), got '{name}'", at=slot.at
                )
        slot.expression = expression
        slot.operands = tuple(self.names[name] for name in expression.names)

    def read_block(self, element: type[Element], path: str, given: Mapping[str, Any], at: Path) -> BlockValues:
        """Give every number of a block a slot, defaults included.

        Raises
        ------
        DiagramError
            If a parameter is unknown, missing or of the wrong shape.
        ExpressionError
            If an expression cannot be read or names an unknown parameter.
        """
        params = {param.name: param for param in element.parameters}
        for key in given:
            if key not in params:
                known = ", ".join(params) or "none"
                raise DiagramError(
                    f"parameter of {path} ({element.kind}) must be one of {known}, got '{key}'", at=(*at, key)
                )
        slots = self.numbers.bindings.slots
        first = len(slots)
        template: dict[str, Any] = {}
        for name, param in params.items():
            value = given.get(name)
            place = _Place(label=f"{path}.{name}", at=(*at, name), param=param)
            template[name] = self._value(param.default if value is None else value, place)
            if param.shape == "scalar" and template[name] is not None:
                self.numbers.paths[place.label] = template[name]
        if len(slots) > MAX_NUMBERS:
            raise DiagramError(f"numbers in a system must be at most {MAX_NUMBERS}, got more", at=at)
        return BlockValues(template=template, slots=frozenset(range(first, len(slots))))

    def _value(self, value: Any, place: _Place) -> Any:
        """Return slot numbers in the shape of the value; texts and None as they are."""
        param = place.param
        if value is None:
            if param.required:
                raise DiagramError(f"{place.label} must be given: {param.doc}", at=place.at)
            return None
        if param.shape in ("text", "integer", "names"):
            return _structure(value, place)
        return self._slots(value, place)

    def _slots(self, value: Any, place: _Place) -> int | tuple[Any, ...]:
        match place.param.shape:
            case "scalar":
                return self._slot(value, place, place.param)
            case "roots":
                return tuple(
                    self._pair(item, place.entry(i))
                    if isinstance(item, list | tuple)
                    else self._slot(item, place.entry(i))
                    for i, item in enumerate(_sequence(value, place))
                )
            case "lists" | "matrix":
                rows = tuple(self._list(row, place.entry(i)) for i, row in enumerate(_sequence(value, place)))
                for i, row in enumerate(rows):
                    if place.param.shape == "matrix" and len(row) != len(rows[0]):
                        got = f"{len(rows[0])} and {len(row)} entries"
                        raise DiagramError(
                            f"{place.label} must have rows of equal length, got {got}", at=(*place.at, i)
                        )
                return rows
            case _:
                return self._list(value, place, place.param)

    def _slot(self, value: Any, place: _Place, bounds: Param | None = None) -> int:
        slot = Slot(label=place.label, at=place.at, value=math.nan, param=bounds)
        self.assign(slot, value)
        self.numbers.bindings.slots.append(slot)
        return len(self.numbers.bindings.slots) - 1

    def _list(self, value: Any, place: _Place, bounds: Param | None = None) -> tuple[int, ...]:
        return tuple(self._slot(item, place.entry(i), bounds) for i, item in enumerate(_sequence(value, place)))

    def _pair(self, value: Any, place: _Place) -> tuple[int, ...]:
        if len(value) != 2:
            raise DiagramError(f"{place.label} must be a number or [re, im], got {len(value)} numbers", at=place.at)
        return self._list(value, place)


def _sequence(value: Any, place: _Place) -> list[Any] | tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        raise DiagramError(f"{place.label} must be a list, got {str(value)[:_QUOTED]!r}", at=place.at)
    if len(value) > MAX_LIST:
        raise DiagramError(f"{place.label} must be at most {MAX_LIST} long, got {len(value)}", at=place.at)
    return value


def _structure(value: Any, place: _Place) -> Any:
    """Return what decides the structure and is no number to be varied."""
    match place.param.shape:
        case "integer":
            return _whole(value, place)
        case "names":
            return _names(_sequence(value, place), place)
        case _:
            return _text(value, place)


def _text(value: Any, place: _Place) -> str:
    choices = place.param.choices
    if not isinstance(value, str) or (choices and value not in choices):
        rule = f"one of {', '.join(choices)}" if choices else f"a text ({place.param.doc})"
        raise DiagramError(f"{place.label} must be {rule}, got {str(value)[:_QUOTED]!r}", at=place.at)
    return value


def _whole(value: Any, place: _Place) -> Whole:
    # 2.0 is the same JSON number as 2.
    whole = not isinstance(value, bool) and isinstance(value, int | float) and value == value // 1
    if not whole or not place.param.admits(value):
        raise DiagramError(
            f"{place.label} must be a whole number {place.param.rule()}, got {str(value)[:_QUOTED]}", at=place.at
        )
    return Whole(value=int(value))


def _names(values: Sequence[Any], place: _Place) -> tuple[str, ...]:
    places = [place.entry(i) for i in range(len(values))]
    names = tuple(_name(value, entry) for value, entry in zip(values, places, strict=True))
    check_distinct((name, entry.at) for name, entry in zip(names, places, strict=True))
    return names


def _name(value: Any, place: _Place) -> str:
    if not isinstance(value, str):
        raise DiagramError(f"{place.label} must be a name, got {str(value)[:_QUOTED]!r}", at=place.at)
    check_name(value, at=place.at)
    return value


def _number(label: str, given: Any, at: Path) -> float:
    if isinstance(given, bool) or not isinstance(given, int | float):
        raise DiagramError(f"{label} must be a number or an expression '=...', got {str(given)[:_QUOTED]!r}", at=at)
    try:
        number = float(given)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise DiagramError(f"{label} must be finite, got {number}", at=at)
    return number
