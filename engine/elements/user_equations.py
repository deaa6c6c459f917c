"""Equations that a user writes: states with their rates, outputs, and events that reset states.

x' = f(x, u),   y = g(x, u),   when h(x, u) > 0: x := r(x, u)
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np

from engine.elements._base import Ports, Values
from engine.elements._formulas import CONSTANTS, Formulas, check_constants, check_names, constants, table_sizes
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Pattern, Signals
from engine.model.errors import DiagramError, EngineError
from engine.model.parameters import Param

MAX_LENGTH: Final = 8000
MAX_STATES: Final = 32
MAX_EVENTS: Final = 16

_STATEMENT = re.compile(r"(?P<name>[A-Za-z]\w*)\s*(?P<form>'|\(\s*0\s*\))?\s*=(?P<text>[^=].*)", re.DOTALL)
_EVENT = re.compile(r"when\s(?P<left>[^<>:]+)(?P<order>[<>])(?P<right>[^<>:]+):(?P<resets>.+)", re.DOTALL)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Event:
    """Numbers of the formulas of an event: its condition, and what states become."""

    condition: int
    resets: dict[str, int]


class Equations:
    """The statements of a text, read.

    Attributes
    ----------
    states : list of str
        In the order of their rates.
    formulas : Formulas
    rates, initial, defined : dict of str to int
        Name -> number of its formula.
    events : list of _Event

    Raises
    ------
    EngineError
        With the statement that cannot be read.
    """

    def __init__(self, text: str, tables: Mapping[str, int]) -> None:
        self._texts: list[tuple[str, str]] = []
        self.rates: dict[str, int] = {}
        self.initial: dict[str, int] = {}
        self.defined: dict[str, int] = {}
        self.events: list[_Event] = []
        for statement in filter(None, (part.strip() for part in re.split(r"[;\n]", text))):
            if statement.split(maxsplit=1)[0] == "when":
                self._read_event(statement)
            else:
                self._read(statement)
        self.states = list(self.rates)
        self.formulas = Formulas(self._texts, tables)
        for name in self.initial:
            if name not in self.rates:
                raise _wrong(f"{name}(0) has no rate {name}' =", name)
        for event in self.events:
            for name in event.resets:
                if name not in self.rates:
                    raise _wrong(f"an event resets '{name}', which is no state", name)

    def _add(self, text: str, name: str = "") -> int:
        self._texts.append((name, text))
        return len(self._texts) - 1

    def _read(self, statement: str) -> None:
        match = _STATEMENT.fullmatch(statement)
        if match is None:
            raise _wrong("a statement must be x' = ..., x(0) = ..., y = ... or when a > b: x = ...", statement)
        name, form = match["name"], match["form"]
        known = self.rates if form == "'" else self.initial if form else self.defined
        if name in known or (not form and name in self.rates) or (form == "'" and name in self.defined):
            raise _wrong(f"'{name}' has more than one equation", statement)
        known[name] = self._add(match["text"], "" if form else name)

    def _read_event(self, statement: str) -> None:
        match = _EVENT.fullmatch(statement)
        if match is None:
            raise _wrong("an event must be when a > b: x = ..., v = ...", statement)
        left, right = (match["left"], match["right"]) if match["order"] == ">" else (match["right"], match["left"])
        condition = self._add(f"({left}) - ({right})")
        resets: dict[str, int] = {}
        for reset in _separated(match["resets"]):
            parts = _STATEMENT.fullmatch(reset.strip())
            if parts is None or parts["form"]:
                raise _wrong("an event must reset states, x = ...", reset)
            resets[parts["name"]] = self._add(parts["text"])
        self.events.append(_Event(condition=condition, resets=resets))
        if len(self.events) > MAX_EVENTS:
            raise _wrong(f"events must be at most {MAX_EVENTS}", statement)


def _separated(text: str) -> list[str]:
    """Return the parts between commas that are in no parentheses."""
    parts, depth = [""], 0
    for character in text:
        depth += {"(": 1, ")": -1}.get(character, 0)
        if character == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return parts


def _wrong(rule: str, got: str) -> DiagramError:
    return DiagramError(f"equations cannot be read: {rule}, got '{got.strip()[:80]}'")


@lru_cache(maxsize=256)
def _read(text: str, tables: tuple[tuple[str, int], ...]) -> Equations:
    return Equations(text, dict(tables))  # asked for at every instant


def _equations(values: Values) -> Equations:
    try:
        return _read(values["equations"], table_sizes(values))
    except EngineError as error:
        raise error.within("equations") from None


class UserEquations(NonlinearElement):
    """A model that has no block of its own: a valve, a tank, a clutch, a controller with states.

    Statements stand on lines of their own or between semicolons. A name defined by y = ... can be used after it. An event
    happens where its condition becomes true, at the exact instant; all its states are reset at once, from what they were.
    """

    kind = "user_equations"
    title = "Equations of the user"
    equation = "x' = f(x, u), y = g(x, u), when h(x, u) > 0: x := r(x, u)"
    source = "Definition."
    note = "equations have the slopes of their formulas at the operating point"
    parameters = (
        Param(
            name="equations", symbol="f", shape="text",
            doc="statements separated by ; or by lines: x' = formula for each state, x(0) = formula of constants (0 where "
            "absent), y = formula, when a > b: x = formula, v = formula; functions as in a function block",
        ),
        Param(name="inputs", symbol="u", shape="names", required=False, doc="names of the inputs; none when absent"),
        Param(name="outputs", symbol="y", shape="names", doc="names of the outputs, each a state or a name that is defined"),
        *CONSTANTS,
    )  # fmt: skip
    example = {
        "equations": "drag = c*v*abs(v); v' = (F - drag)/m; x' = v", "inputs": ["F"], "outputs": ["x", "v"],
        "constants": ["m", "c"], "values": [2.0, 0.5],
    }  # fmt: skip

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse what cannot be read, and names that nothing gives or two things give."""
        if len(values["equations"]) > MAX_LENGTH:
            raise DiagramError(
                f"equations must be at most {MAX_LENGTH} characters long, got {len(values['equations'])}",
                at=("equations",),
            )
        check_constants(values)
        found = _equations(values)
        inputs, fixed = list(values["inputs"] or ()), list(values["constants"] or ())
        for name in inputs:
            if name in found.states or name in found.defined:
                raise DiagramError(f"inputs must have names of their own, got '{name}'", at=("inputs",))
        if len(found.states) > MAX_STATES:
            raise DiagramError(f"states must be at most {MAX_STATES}, got {len(found.states)}", at=("equations",))
        names = found.formulas.names
        check_names(names, [*found.states, *inputs], values, at="equations", taken=list(found.defined))
        for name, number in found.initial.items():
            for used in sorted(found.formulas.formulas[number].uses - set(fixed)):
                raise DiagramError(f"{name}(0) must use constants only, got '{used}'", at=("equations",))
        if not values["outputs"]:
            raise DiagramError("outputs must be one at least, got none", at=("outputs",))
        for name in values["outputs"]:
            if name not in found.states and name not in found.defined:
                known = ", ".join([*found.states, *found.defined])
                raise DiagramError(
                    f"outputs must be among what the equations give ({known}), got '{name}'", at=("outputs",)
                )

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the ports by their names."""
        return Ports(
            inputs=tuple(values["inputs"] or ()),
            outputs=tuple(values["outputs"]),
            output_units=(None,) * len(values["outputs"]),
        )

    @classmethod
    def feed_through(cls, values: Values) -> Pattern:
        """Return the inputs that each output uses."""
        found, inputs = _equations(values), values["inputs"] or ()
        uses = [
            found.formulas.formulas[found.defined[name]].uses if name in found.defined else frozenset()
            for name in values["outputs"]
        ]
        return np.array([[name in used for name in inputs] for used in uses], dtype=bool).reshape(
            len(uses), len(inputs)
        )

    @classmethod
    def initial(cls, values: Values) -> Signals:
        """Return what the equations say, 0 where they say nothing."""
        found = _equations(values)
        given = dict.fromkeys(found.formulas.names, 0.0) | constants(values)
        mode = found.formulas.mode_of(given)
        return [
            found.formulas(found.initial[name], given, mode) if name in found.initial else 0.0 for name in found.states
        ]

    @classmethod
    def _given(cls, m: Moment, values: Values) -> dict[str, Any]:
        inputs = values["inputs"] or ()
        return {
            **constants(values),
            **dict(zip(inputs, m.z, strict=True)),
            **dict(zip(_equations(values).states, m.x, strict=True)),
        }

    @classmethod
    def start(cls, m: Moment, values: Values) -> Mode:
        """Return the sides on which states and inputs are."""
        return _equations(values).formulas.mode_of(cls._given(m, values))

    @classmethod
    def rates(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the rates that the equations give."""
        return cls._evaluated(list(_equations(values).rates.values()), m, mode, values)

    @classmethod
    def _evaluated(cls, numbers: Sequence[int], m: Moment, mode: Mode, values: Values) -> list[Any]:
        found, given = _equations(values), cls._given(m, values)
        return [found.formulas(number, given, mode) for number in numbers]

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return states and defined names."""
        found, given = _equations(values), cls._given(m, values)
        return [
            found.formulas(found.defined[name], given, mode) if name in found.defined else given[name]
            for name in values["outputs"]
        ]

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far arguments of abs, sign, min, max and atan2 have passed 0, and conditions of events are true."""
        found, given = _equations(values), cls._given(m, values)
        conditions = [found.formulas(event.condition, given, mode) for event in found.events]
        return [*found.formulas.guards(given, mode), *conditions]

    @classmethod
    def across(cls, guard: int, mode: Mode, values: Values) -> Mode | None:
        """Return the other side of an argument of sign or atan2."""
        return mode ^ (1 << guard) if guard in _equations(values).formulas.jumps else None

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return to the other side, or the states after an event."""
        found = _equations(values)
        if guard < found.formulas.switches:
            return Change(mode=mode ^ (1 << guard))
        resets, given = found.events[guard - found.formulas.switches].resets, cls._given(m, values)
        return Change(
            mode=mode,
            x=[found.formulas(resets[name], given, mode) if name in resets else given[name] for name in found.states],
        )
