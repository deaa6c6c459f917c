"""Formulas of signals that a user writes, such as ``sin(u1)*abs(u2)``: the grammar of parameter expressions with more functions.

What is not smooth (abs, sign, min, max, atan2) is a switch: the sign s of an argument a. A mode fixes all signs, so that every
formula is analytic inside it, and a guard -s a ends it: abs(a) = s a, sign(a) = s, max(a, b) = a where a - b >= 0 else b.
A table has a switch at each of its points, and is a straight line between two of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Final

import numpy as np

from engine.elements._nonlinear import Mode, first
from engine.model.errors import DiagramError
from engine.model.expressions import FUNCTIONS, OPERATORS, Compute, Operators, Parser, elementary
from engine.model.parameters import Param
from engine.model.traced import Op, Traced, UnsuitableError

MAX_SWITCHES: Final = 64

CONSTANTS = (
    Param(name="constants", symbol="c", shape="names", required=False, doc="names of numbers that the formulas use"),
    Param(name="values", symbol="c_i", shape="list", required=False, doc="their values, one for each name"),
    Param(
        name="tables", symbol="T", shape="names", required=False,
        doc="names of tables that the formulas use as functions of one argument, name(u)",
    ),
    Param(
        name="table_points", symbol="T_u", shape="lists", required=False,
        doc="for each table the arguments that it knows, increasing, two at least",
    ),
    Param(
        name="table_values", symbol="T_y", shape="lists", required=False,
        doc="for each table what it is there; in between it is linear, beyond its ends it holds the last value",
    ),
)  # fmt: skip


def _with_slope(
    name: str, function: Callable[[Any], Any], slope: Callable[[Any], Any], *, largest: float = np.inf
) -> Callable[[Any], Any]:
    """Return a real function that carries an infinitesimal by its slope, NaN for arguments larger than ``largest``."""

    def apply(value: Any) -> Any:
        if isinstance(value, Traced):
            raise UnsuitableError(f"it needs {name} of a signal")
        real = np.where(np.abs(np.real(value)) <= largest, np.real(value), np.nan)
        found = function(real)
        return found + 1j * slope(real) * np.imag(value) if np.iscomplexobj(value) else found

    return apply


def _tan(value: Any) -> Any:
    return FUNCTIONS["sin"](value) / FUNCTIONS["cos"](value)


_ANALYTIC: Final[Mapping[str, Callable[[Any], Any]]] = {
    **FUNCTIONS,
    "tan": _tan,
    "tanh": elementary(Op.TANH, np.tanh, np.tanh, np.tanh),
    "atan": _with_slope("atan", np.arctan, lambda a: 1 / (1 + a * a)),
    "asin": _with_slope("asin", np.arcsin, lambda a: 1 / np.sqrt(1 - a * a), largest=1.0),
    "acos": _with_slope("acos", np.arccos, lambda a: -1 / np.sqrt(1 - a * a), largest=1.0),
}


_FUNCTIONS: Final[Mapping[str, int]] = {
    **dict.fromkeys(_ANALYTIC, 1), "abs": 1, "sign": 1, "min": 2, "max": 2, "atan2": 2,
}  # fmt: skip
"""How many arguments each has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Formula:
    """A formula that has been read, and the names that it uses."""

    compute: Compute
    uses: frozenset[str]


def _divide(dividend: Any, divisor: Any) -> Any:
    """Return a quotient; one by 0 is no number, which is found where it matters."""
    return np.nan * dividend if isinstance(divisor, float) and divisor == 0 else dividend / divisor


class _SignalParser(Parser):
    """Parses one formula; its switches are numbered on from those of the formulas before it.

    The sides of the switches stand behind the values of the names, the first at the end: that place is known while parsing.
    """

    operators: ClassVar[Operators] = {**OPERATORS, "/": _divide}

    def __init__(
        self,
        text: str,
        names: dict[str, int],
        switches: list[Compute],
        known: Mapping[str, Formula],
        tables: Mapping[str, int],
    ) -> None:
        self._tables = tables
        self.functions = {**_FUNCTIONS, **dict.fromkeys(tables, 1)}
        super().__init__(text)
        self._names = names
        self._switches = switches
        self._known = known
        self.uses: set[str] = set()
        self.jumps: set[int] = set()

    def named(self, name: str) -> Compute:
        """Return the value of a name, or the formula that it stands for."""
        if name in self._known:
            self.uses |= self._known[name].uses
            return self._known[name].compute
        self.uses.add(name)
        return super().named(name)

    def _switch(self, argument: Compute) -> int:
        self._switches.append(argument)
        if len(self._switches) > MAX_SWITCHES:
            raise self._error(
                f"abs, sign, min, max, atan2 and points of tables must be at most {MAX_SWITCHES}, got more, the last"
            )
        return -len(self._switches)

    def call(self, name: str, arguments: Sequence[Callable[[Any], Any]]) -> Compute:
        """Return a function applied to its arguments."""
        if name in _ANALYTIC:
            function, (argument,) = _ANALYTIC[name], arguments
            return lambda values: function(argument(values))
        if name in self._tables:
            return self._table(name, arguments[0])
        a, b = arguments[0], arguments[-1]
        if name in {"min", "max"}:
            side = self._switch(_difference(a, b))
            first_side = 1.0 if name == "max" else -1.0
            return lambda values: a(values) if values[side] == first_side else b(values)
        side = self._switch(a)
        if name != "abs":
            self.jumps.add(len(self._switches) - 1)
        if name == "atan2":
            return lambda values: _angle(a(values), b(values), values[side])
        if name == "abs":
            return lambda values: values[side] * a(values)
        return lambda values: values[side] + 0.0 * a(values)

    def _table(self, name: str, argument: Compute) -> Compute:
        """Return a table at an argument: the mode tells between which points that lies."""
        points, heights = ([Parser.named(self, entry) for entry in of] for of in _entries(name, self._tables[name]))
        sides = [self._switch(_difference(argument, point)) for point in points]

        def compute(values: Sequence[Any]) -> Any:
            k = sum(values[side] > 0 for side in sides) - 1
            if not 0 <= k < len(points) - 1:
                return heights[max(k, 0)](values) + 0.0 * argument(values)
            left, low = points[k](values), heights[k](values)
            rise = (heights[k + 1](values) - low) / (points[k + 1](values) - left)
            return low + rise * (argument(values) - left)

        return compute


def _entries(table: str, count: int) -> tuple[list[str], list[str]]:
    """Return names for the numbers of a table, which no formula can write."""
    return [f"{table} u{k}" for k in range(count)], [f"{table} y{k}" for k in range(count)]


def _difference(first: Compute, second: Compute) -> Compute:
    return lambda values: first(values) - second(values)


def _angle(y: Any, x: Any, side: Any) -> Any:
    """Return the angle of (x, y), rad, which is smooth on either side of y = 0."""
    if isinstance(y, Traced) or isinstance(x, Traced):
        raise UnsuitableError("it needs atan2 of a signal")
    a, b = np.real(y), np.real(x)
    found = np.arctan2(a, b)
    # a little beyond y = 0 the angle goes on as it came
    found = np.where(side * found < -0.5 * np.pi, found + side * 2 * np.pi, found)
    if not (np.iscomplexobj(y) or np.iscomplexobj(x)):
        return found
    return found + 1j * (b * np.imag(y) - a * np.imag(x)) / (a * a + b * b)


class Formulas:
    """Some formulas, read together.

    Parameters
    ----------
    texts : sequence of (name, text)
        A formula with a name can be used by those after it.
    tables : mapping of str to int, optional
        How many points each table has.

    Attributes
    ----------
    names : list of str
        All names that they use, without those of the formulas themselves.
    jumps : set of int
        The switches at which a value jumps: of sign and atan2.
    formulas : list of Formula

    Raises
    ------
    ExpressionError
        If a text is no formula.
    """

    def __init__(self, texts: Sequence[tuple[str, str]], tables: Mapping[str, int] = MappingProxyType({})) -> None:
        places: dict[str, int] = {}
        known: dict[str, Formula] = {}
        self._switches: list[Compute] = []
        self.formulas: list[Formula] = []
        self.jumps: set[int] = set()
        for name, text in texts:
            parser = _SignalParser(text, places, self._switches, known, tables)
            found = Formula(compute=parser.expression().compute, uses=frozenset(parser.uses))
            self.formulas.append(found)
            self.jumps |= parser.jumps
            if name:
                known[name] = found
        self.names = list(places)

    def __call__(self, number: int, given: Mapping[str, Any], mode: Mode) -> Any:
        """Return the value of a formula, the names being ``given``."""
        return self._value(self.formulas[number].compute, self._values(given, self._sides(mode)))

    def guards(self, given: Mapping[str, Any], mode: Mode) -> list[Any]:
        """Return for each switch how far its argument is on the other side."""
        sides = self._sides(mode)
        values = self._values(given, sides)
        return [-sides[k] * self._value(argument, values) for k, argument in enumerate(self._switches)]

    def mode_of(self, given: Mapping[str, Any]) -> Mode:
        """Return on which side each switch is; bit k of the mode says that the argument of switch k is negative."""
        sides = [1.0] * len(self._switches)
        for k, argument in enumerate(self._switches):  # one inside another comes first
            sides[k] = -1.0 if first(self._value(argument, self._values(given, sides))) < 0 else 1.0
        return sum(1 << k for k, side in enumerate(sides) if side < 0)

    @property
    def switches(self) -> int:
        """How many switches there are."""
        return len(self._switches)

    @staticmethod
    def _value(formula: Compute, values: Sequence[Any]) -> Any:
        """Return a value; where there is none it is NaN, which is found where it matters."""
        try:
            with np.errstate(all="ignore"):
                found = formula(values)
        except (ArithmeticError, ValueError):  # of numbers alone, such as log(0)
            return np.nan
        return found if isinstance(found, Traced) else np.where(np.isfinite(found), found, np.nan)

    def _sides(self, mode: Mode) -> list[float]:
        return [-1.0 if mode >> k & 1 else 1.0 for k in range(len(self._switches))]

    def _values(self, given: Mapping[str, Any], sides: Sequence[float]) -> list[Any]:
        return [*(given[name] for name in self.names), *reversed(sides)]


def table_sizes(values: Mapping[str, Any]) -> tuple[tuple[str, int], ...]:
    """Return the name of each table of a block and how many points it has."""
    names, points = values["tables"] or (), values["table_points"] or ()
    return tuple((name, len(own)) for name, own in zip(names, points, strict=False))


def constants(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a block's constants by name, with the numbers of its tables."""
    found = dict(zip(values["constants"] or (), values["values"] or (), strict=True))
    if values["tables"]:
        for name, points, heights in zip(values["tables"], values["table_points"], values["table_values"], strict=True):
            places, says = _entries(name, len(points))
            found |= dict(zip(places, points, strict=True)) | dict(zip(says, heights, strict=True))
    return found


def check_constants(values: Mapping[str, Any]) -> None:
    """Refuse constants without values, values without names, and tables that are none."""
    names, tables = values["constants"] or (), values["tables"] or ()
    for given, what, wanted in (
        ("values", "constants", names), ("table_points", "tables", tables), ("table_values", "tables", tables),
    ):  # fmt: skip
        if len(values[given] or ()) != len(wanted):
            raise DiagramError(
                f"{given} must be as many as {what} ({len(wanted)}), got {len(values[given] or ())}", at=(given,)
            )
    for k, name in enumerate(tables):
        _check_table(name, values["table_points"][k], values["table_values"][k], k)


def _check_table(name: str, points: Sequence[Any], heights: Sequence[Any], number: int) -> None:
    if len(points) < 2:
        raise DiagramError(f"table_points of {name} must be at least 2, got {len(points)}", at=("table_points", number))
    if len(heights) != len(points):
        msg = f"table_values of {name} must be as many as its points ({len(points)}), got {len(heights)}"
        raise DiagramError(msg, at=("table_values", number))
    for k in range(1, len(points)):
        if points[k].real <= points[k - 1].real:
            msg = f"table_points of {name} must increase, got {points[k].real:g} after {points[k - 1].real:g}"
            raise DiagramError(msg, at=("table_points", number, k))


def check_names(
    names: Sequence[str], known: Sequence[str], values: Mapping[str, Any], *, at: str, taken: Sequence[str] = ()
) -> None:
    """Refuse constants and tables whose names mean something else, and a name that a formula uses and nothing gives.

    ``known`` are the names that mean something without them; those ``taken`` mean something, but not here.
    """
    fixed, tables = values["constants"] or (), values["tables"] or ()
    for what, own, others in (("constants", fixed, (*known, *taken)), ("tables", tables, (*fixed, *known, *taken))):
        for name in own:
            if name in _FUNCTIONS or name == "pi" or name in others:
                raise DiagramError(f"{what} must have names of their own, got '{name}'", at=(what,))
    given = constants(values)
    for name in names:
        if name not in known and name not in given:
            rule = f"{at} must use only {', '.join((*known, *fixed))}, constants and tables"
            raise DiagramError(f"{rule}, got '{name}'", at=(at,))
