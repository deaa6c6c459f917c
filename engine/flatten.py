"""From a document to flat lists: subsystems opened, names and ports checked, every number given a slot."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from engine.bindings import Bindings, BlockValues, Slot
from engine.document import Block, Parameter, System, Warning
from engine.elements import Element, Ports, catalogue
from engine.errors import DiagramError, EngineError, ExpressionError, IllPosedError, Path
from engine.expressions import RESERVED, parse
from engine.parameters import Param
from engine.realize import FlatBlock

MAX_BLOCKS: Final = 500
MAX_DEPTH: Final = 10
MAX_LIST: Final = 201
MAX_NAME: Final = 64
MAX_NUMBERS: Final = 50_000

_NAME = re.compile(r"[a-z][a-z0-9_]*")

Port = tuple[str, ...]
"""Full path of a port: scopes, block, port."""


@dataclass(slots=True, kw_only=True, eq=False)
class Entry:
    """A block in its scope. ``number`` counts flat blocks (None for inputs and subsystems); ``inner`` opens a subsystem."""

    ports: Ports
    role: str | None = None
    number: int | None = None
    inner: Scope | None = None


@dataclass(slots=True, kw_only=True, eq=False)
class Scope:
    """One system document in its place: the root, or a subsystem of ``parent``."""

    name: str
    path: tuple[str, ...]
    at: Path
    parent: Scope | None
    entries: dict[str, Entry] = field(default_factory=dict)
    driven: dict[tuple[str, str], tuple[str, str]] = field(default_factory=dict)
    outputs: dict[str, tuple[Scope, str, str]] = field(default_factory=dict)


@dataclass(kw_only=True, eq=False)
class Flat:
    """The flattened document."""

    root: Scope
    blocks: list[FlatBlock] = field(default_factory=list)
    elements: list[type[Element]] = field(default_factory=list)
    scopes: list[Scope] = field(default_factory=list)
    bindings: Bindings = field(default_factory=Bindings)
    paths: dict[str, int] = field(default_factory=dict)
    declared: dict[int, tuple[Parameter, Param]] = field(default_factory=dict)
    warnings: list[Warning] = field(default_factory=list)


def flatten(system: System) -> Flat:
    """Open all subsystems of ``system`` and check everything that does not need numbers.

    Raises
    ------
    DiagramError
        If a name, kind, port, connection, parameter or size is wrong.
    ExpressionError
        If an expression cannot be read or names an unknown parameter.
    """
    flat = Flat(root=Scope(name="", path=(), at=(), parent=None))
    _open(flat, flat.root, system)
    used = {operand for slot in flat.bindings.slots for operand in slot.operands}
    for index in flat.declared:
        if index not in used:
            slot = flat.bindings.slots[index]
            flat.warnings.append(Warning(at=slot.at[:-1], detail=f"parameter {slot.label} is not used"))
    return flat


def _open(flat: Flat, scope: Scope, system: System) -> None:
    if len(scope.path) > MAX_DEPTH:
        raise DiagramError(f"subsystems must be nested at most {MAX_DEPTH} deep, got more", at=scope.at)
    flat.scopes.append(scope)
    names = _parameters(flat, scope, system.parameters)
    for name, block in system.blocks.items():
        at = (*scope.at, "blocks", name)
        _check_name(name, "block", at)
        scope.entries[name] = _block(flat, scope, name, block, names, at)
        if len(flat.blocks) > MAX_BLOCKS:
            raise DiagramError(f"blocks must be at most {MAX_BLOCKS}, got more", at=(*scope.at, "blocks"))
    _connections(scope, system)
    for name, endpoint in system.outputs.items():
        at = (*scope.at, "outputs", name)
        _check_name(name, "output", at)
        scope.outputs[name] = find_output(scope, endpoint, at=at)


def _check_name(name: str, what: str, at: Path) -> None:
    if not isinstance(name, str) or len(name) > MAX_NAME or _NAME.fullmatch(name) is None:
        raise DiagramError(
            f"{what} name must be a lower-case letter followed by at most {MAX_NAME - 1} letters, digits or _, "
            f"got '{str(name)[: MAX_NAME + 1]}'",
            at=at,
        )


# Parameters and values


def _parameters(flat: Flat, scope: Scope, parameters: Mapping[str, Parameter]) -> dict[str, int]:
    """Give every system parameter a slot, then read the expressions, which may name any of them."""
    names: dict[str, int] = {}
    slots = flat.bindings.slots
    for name, parameter in parameters.items():
        at = (*scope.at, "parameters", name)
        _check_name(name, "parameter", at)
        if name in RESERVED:
            raise DiagramError(f"parameter name must not be one of {', '.join(sorted(RESERVED))}, got '{name}'", at=at)
        names[name] = len(slots)
        label = ".".join((*scope.path, name))
        flat.paths[label] = len(slots)
        flat.declared[len(slots)] = (parameter, _declared(label, parameter, at))
        slots.append(Slot(label=label, at=(*at, "value"), value=math.nan))
    for name, parameter in parameters.items():
        _assign(slots[names[name]], parameter.value, names)
    return names


def _declared(label: str, parameter: Parameter, at: Path) -> Param:
    """Return the parameter's own bounds as a declaration; they hold for the document, not for what is tried later."""
    lower = -math.inf if parameter.lower is None else parameter.lower
    upper = math.inf if parameter.upper is None else parameter.upper
    for name, bound in (("lower", lower), ("upper", upper)):
        if not isinstance(bound, int | float) or isinstance(bound, bool) or math.isnan(bound):
            raise DiagramError(f"{name} of {label} must be a number, got {bound!r}", at=(*at, name))
    if lower > upper:
        raise DiagramError(f"lower of {label} must be <= upper {upper:g}, got {lower:g}", at=(*at, "lower"))
    return Param(name=label, symbol=label, doc=parameter.doc, unit=parameter.unit, lower=lower, upper=upper)


def _assign(slot: Slot, given: Any, names: Mapping[str, int]) -> None:
    """Put a number or an expression into a slot."""
    if isinstance(given, str) and given.startswith("="):
        try:
            expression = parse(given)
        except ExpressionError as error:
            error.at = slot.at
            raise
        unknown = [name for name in expression.names if name not in names]
        if unknown:
            known = ", ".join(names) or "none"
            raise ExpressionError(
                f"expression '{given}' must name parameters of its system ({known}), got '{unknown[0]}'", at=slot.at
            )
        slot.expression = expression
        slot.operands = tuple(names[name] for name in expression.names)
        return
    slot.value = _number(slot.label, given, slot.at)


def _number(label: str, given: Any, at: Path) -> float:
    if isinstance(given, bool) or not isinstance(given, int | float):
        raise DiagramError(f"{label} must be a number or an expression '=...', got {str(given)[:80]!r}", at=at)
    try:
        number = float(given)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise DiagramError(f"{label} must be finite, got {number}", at=at)
    return number


def _block(flat: Flat, scope: Scope, name: str, block: Block, names: Mapping[str, int], at: Path) -> Entry:
    if block.kind == "subsystem":
        return _subsystem(flat, scope, name, block, at)
    kinds = catalogue()
    if not isinstance(block.kind, str) or block.kind not in kinds:
        known = ", ".join((*kinds, "subsystem"))
        raise DiagramError(f"kind of {name} must be one of {known}, got '{block.kind}'", at=(*at, "kind"))
    if block.system is not None:
        raise DiagramError(f"system of {name} must be absent: only a subsystem has one", at=(*at, "system"))
    element = kinds[block.kind]
    path = ".".join((*scope.path, name))
    values = _values(flat, element, path, block.values, names, at)
    given = frozenset(key for key, value in block.values.items() if value is not None)
    slots = flat.bindings.slots
    try:
        # Ports and completeness follow from what is present; the numbers come later.
        sketch = values.fill([slot.value for slot in slots])
        element.check(given, sketch)
        ports = element.ports(sketch)
    except EngineError as error:
        error.message = f"{path}: {error.message}"
        raise error.within(*at) from None
    if block.kind == "input":
        return Entry(ports=ports, role=sketch["role"])
    before = flat.blocks[-1] if flat.blocks else None
    flat.blocks.append(
        FlatBlock(
            path=path, at=at, ports=ports,
            first_input=before.first_input + len(before.ports.inputs) if before else 0,
            first_output=before.first_output + len(before.ports.outputs) if before else 0,
        )
    )  # fmt: skip
    flat.elements.append(element)
    flat.bindings.blocks.append(values)
    return Entry(ports=ports, number=len(flat.blocks) - 1)


def _subsystem(flat: Flat, scope: Scope, name: str, block: Block, at: Path) -> Entry:
    if block.system is None:
        raise DiagramError(f"system of {name} must be given", at=(*at, "system"))
    for key in block.values:
        raise DiagramError(f"{key} of {name} must be absent: a subsystem keeps its parameters inside", at=(*at, key))
    inner = Scope(name=name, path=(*scope.path, name), at=(*at, "system"), parent=scope)
    _open(flat, inner, block.system)
    ports = Ports(
        inputs=tuple(key for key, entry in inner.entries.items() if entry.role is not None),
        outputs=tuple(inner.outputs),
        output_units=tuple(unit_of(*endpoint) for endpoint in inner.outputs.values()),
    )
    return Entry(ports=ports, inner=inner)


def _values(
    flat: Flat, element: type[Element], path: str, given: Mapping[str, Any], names: Mapping[str, int], at: Path
) -> BlockValues:
    params = {param.name: param for param in element.parameters}
    for key in given:
        if key not in params:
            known = ", ".join(params) or "none"
            raise DiagramError(f"parameter of {path} ({element.kind}) must be one of {known}, got '{key}'", at=(*at, key))
    first = len(flat.bindings.slots)
    template: dict[str, Any] = {}
    for name, param in params.items():
        value = given.get(name)
        value = param.default if value is None else value
        where = (*at, name)
        label = f"{path}.{name}"
        if value is None:
            if param.required:
                raise DiagramError(f"{label} must be given: {param.doc}", at=where)
            template[name] = None
        elif param.shape == "text":
            template[name] = _text(label, value, param, where)
        elif param.shape == "scalar":
            template[name] = _slot(flat, label, value, param, names, where)
            flat.paths[label] = template[name]
        else:
            depth = {"list": 1, "roots": 2, "matrix": 2}[param.shape]
            template[name] = _nested(flat, label, value, param, names, where, depth)
            if param.shape == "matrix":
                _check_rows(label, template[name], where)
    if len(flat.bindings.slots) > MAX_NUMBERS:
        raise DiagramError(f"numbers in a system must be at most {MAX_NUMBERS}, got more", at=at)
    return BlockValues(template=template, slots=frozenset(range(first, len(flat.bindings.slots))))


def _text(label: str, value: Any, param: Param, at: Path) -> str:
    if not isinstance(value, str) or (param.choices and value not in param.choices):
        rule = f"one of {', '.join(param.choices)}" if param.choices else "a text"
        raise DiagramError(f"{label} must be {rule}, got {str(value)[:80]!r}", at=at)
    return value


def _slot(flat: Flat, label: str, value: Any, param: Param | None, names: Mapping[str, int], at: Path) -> int:
    slot = Slot(label=label, at=at, value=math.nan, param=param)
    _assign(slot, value, names)
    flat.bindings.slots.append(slot)
    return len(flat.bindings.slots) - 1


def _nested(
    flat: Flat, label: str, value: Any, param: Param, names: Mapping[str, int], at: Path, depth: int
) -> tuple[Any, ...]:
    """Give every number of a list, or of a list of lists, a slot."""
    if not isinstance(value, list | tuple) or len(value) > MAX_LIST:
        got = f"{len(value)} of them" if isinstance(value, list | tuple) else repr(value)[:80]
        raise DiagramError(f"{label} must be a list of at most {MAX_LIST}, got {got}", at=at)
    items: list[Any] = []
    for i, item in enumerate(value):
        name, where = f"{label}[{i}]", (*at, i)
        if param.shape == "matrix" and depth == 2:
            items.append(_nested(flat, name, item, param, names, where, 1))
        elif depth == 2 and isinstance(item, list | tuple):
            if len(item) != 2:
                raise DiagramError(f"{name} must be a number or [re, im], got {len(item)} numbers", at=where)
            items.append(_nested(flat, name, item, param, names, where, 1))
        else:
            items.append(_slot(flat, name, item, None, names, where))
    return tuple(items)


def _check_rows(label: str, rows: tuple[Any, ...], at: Path) -> None:
    for i, row in enumerate(rows):
        if len(row) != len(rows[0]):
            raise DiagramError(
                f"{label} must have rows of equal length, got {len(rows[0])} and {len(row)} entries", at=(*at, i)
            )


# Connections and endpoints


def _connections(scope: Scope, system: System) -> None:
    first: dict[tuple[str, str], int] = {}
    for i, connection in enumerate(system.connections):
        at = (*scope.at, "connections", i)
        source = _endpoint(scope, connection.source, "outputs", (*at, "from"))
        target = _endpoint(scope, connection.target, "inputs", (*at, "to"))
        if target in scope.driven:
            raise DiagramError(
                f"input {'.'.join(target)} must be driven once, got '{system.connections[first[target]].source}' "
                f"and '{connection.source}' (add them in a sum)",
                at=(*at, "to"),
            )
        first[target] = i
        scope.driven[target] = source


def _endpoint(scope: Scope, endpoint: str, side: str, at: Path) -> tuple[str, str]:
    """Return block and port of an endpoint ``block`` or ``block.port`` in its own scope."""
    name, _, port = endpoint.partition(".")
    entry = scope.entries.get(name)
    if entry is None:
        known = ", ".join(scope.entries) or "none"
        raise DiagramError(f"endpoint must begin with a block ({known[:200]}), got '{endpoint[:80]}'", at=at)
    ports: tuple[str, ...] = getattr(entry.ports, side)
    if port in ports:
        return name, port
    if len(ports) == 1 and port in ("", "in" if side == "inputs" else "out"):
        return name, ports[0]
    known = ", ".join(f"{name}.{p}" for p in ports)
    rule = f"one of the {side} {known}" if ports else f"another block's: {name} has no {side}"
    raise DiagramError(f"endpoint must be {rule}, got '{endpoint[:80]}'", at=at)


def find_output(scope: Scope, endpoint: str, *, at: Path) -> tuple[Scope, str, str]:
    """Return scope, block and port of an output, which may lie inside subsystems: ``inner.motor.position``.

    A port of the subsystem itself goes before a block of the same name inside.
    """
    name, _, rest = str(endpoint).partition(".")
    entry = scope.entries.get(name)
    if entry is not None and entry.inner is not None and rest and rest not in entry.ports.outputs and rest != "out":
        return find_output(entry.inner, rest, at=at)
    block, port = _endpoint(scope, str(endpoint), "outputs", at)
    return scope, block, port


def unit_of(scope: Scope, block: str, port: str) -> str | None:
    """Return the unit of an output port, None where it follows from what is connected."""
    ports = scope.entries[block].ports
    return ports.output_units[ports.outputs.index(port)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Traced:
    """Where a signal is made: ``entry`` is a flat block or an input of the root, None where nothing is connected.

    ``passed`` are the output ports on the way back, the true source last: cutting any of them cuts this consumer.
    """

    passed: tuple[Port, ...]
    entry: Entry | None
    block: str
    port: str


def trace(scope: Scope, block: str, port: str, at: Path) -> Traced:
    """Follow the signal of an output port back through the borders of subsystems.

    Raises
    ------
    IllPosedError
        If it leads back to itself through connections alone.
    """
    passed: list[Port] = []
    while True:
        here = (*scope.path, block, port)
        if here in passed:
            names = tuple(".".join(p) for p in passed[passed.index(here) :])
            raise IllPosedError(
                f"the loop {' -> '.join((*names[::-1], names[-1]))} must contain a block, got only connections",
                at=at,
                ports=names[::-1],
            )
        passed.append(here)
        entry = scope.entries[block]
        if entry.inner is not None:
            scope, block, port = entry.inner.outputs[port]
        elif entry.role is not None and scope.parent is not None:
            source = scope.parent.driven.get((scope.name, block))
            if source is None:
                return Traced(passed=tuple(passed), entry=None, block=block, port=port)
            scope, (block, port) = scope.parent, source
        else:
            return Traced(passed=tuple(passed), entry=entry, block=block, port=port)
