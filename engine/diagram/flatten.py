"""From a document to flat lists: subsystems opened, names, kinds and ports checked, every number given a slot."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from engine.diagram.numbers import Numbers, Reader
from engine.diagram.realize import FlatBlock
from engine.diagram.scopes import Entry, Scope
from engine.elements import Element, Ports, catalogue
from engine.model.document import Block, Remark, System
from engine.model.errors import DiagramError, EngineError
from engine.model.names import check_distinct, check_name

MAX_BLOCKS: Final = 500
MAX_PORTS: Final = 5000
MAX_DEPTH: Final = 32


@dataclass(kw_only=True, eq=False)
class Flat:
    """The flattened document: ``blocks``, their ``elements`` and ``numbers.bindings.blocks`` belong together by index."""

    root: Scope
    scopes: list[Scope] = field(default_factory=list)
    blocks: list[FlatBlock] = field(default_factory=list)
    elements: list[type[Element]] = field(default_factory=list)
    numbers: Numbers = field(default_factory=Numbers)
    warnings: list[Remark] = field(default_factory=list)


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
    slots = flat.numbers.bindings.slots
    used = {operand for slot in slots for operand in slot.operands}
    flat.warnings.extend(
        Remark(at=slots[index].at[:-1], detail=f"parameter {slots[index].label} is not used")
        for index in flat.numbers.declared
        if index not in used
    )
    return flat


def _open(flat: Flat, scope: Scope, system: System) -> None:
    if len(scope.path) > MAX_DEPTH:
        raise DiagramError(f"subsystems must be nested at most {MAX_DEPTH} deep, got more", at=scope.at)
    flat.scopes.append(scope)
    for section in ("parameters", "blocks", "outputs"):
        named = [(name, (*scope.at, section, name)) for name in getattr(system, section)]
        for name, at in named:
            check_name(name, at=at)
        check_distinct(named)
    reader = flat.numbers.read_parameters(scope.path, system.parameters, (*scope.at, "parameters"))
    for name, block in system.blocks.items():
        at = (*scope.at, "blocks", name)
        scope.entries[name] = (
            _subsystem(flat, scope, name, block)
            if block.kind == "subsystem"
            else _block(flat, scope, name, block, reader)
        )
        if sum(len(opened.entries) for opened in flat.scopes) > MAX_BLOCKS:
            raise DiagramError(f"blocks must be at most {MAX_BLOCKS}, got more", at=at[:-1])
    scope.connect(system.connections)
    for name, endpoint in system.outputs.items():
        scope.outputs[name] = scope.find_output(endpoint, at=(*scope.at, "outputs", name))


def _block(flat: Flat, scope: Scope, name: str, block: Block, reader: Reader) -> Entry:
    at, path = (*scope.at, "blocks", name), scope.label(name)
    kinds = catalogue()
    if block.kind not in kinds:
        known = ", ".join((*kinds, "subsystem"))
        raise DiagramError(f"kind of {path} must be one of {known}, got '{block.kind}'", at=(*at, "kind"))
    if block.system is not None:
        raise DiagramError(f"system of {path} must be absent: only a subsystem has one", at=(*at, "system"))
    element = kinds[block.kind]
    values = reader.read_block(element, path, block.values, at)
    given = frozenset(key for key, value in block.values.items() if value is not None)
    element = element.law(given)
    flat.warnings.extend(
        Remark(at=(*at, name), detail=f"{name} of {path} {text}") for name, text in element.assumed(given).items()
    )
    flat.numbers.bindings.check_written(values.slots)
    try:
        # Ports and completeness follow from what is present; the numbers come later.
        sketch = values.fill({index: flat.numbers.bindings.slots[index].value for index in values.slots})
        element.check(given, sketch)
        ports = element.ports(sketch)
    except EngineError as error:
        raise error.of(path).within(*at) from None
    if block.kind == "input":
        return Entry(ports=ports, role=sketch["role"], role_given="role" in given)
    flat.blocks.append(FlatBlock.after(flat.blocks[-1] if flat.blocks else None, path=path, at=at, ports=ports))
    if flat.blocks[-1].first_output + len(ports.outputs) > MAX_PORTS:
        raise DiagramError(f"output ports of all blocks together must be at most {MAX_PORTS}, got more", at=at)
    flat.elements.append(element)
    flat.numbers.bindings.blocks.append(values)
    return Entry(ports=ports, number=len(flat.blocks) - 1)


def _subsystem(flat: Flat, scope: Scope, name: str, block: Block) -> Entry:
    at = (*scope.at, "blocks", name)
    if block.system is None:
        raise DiagramError(f"system of {scope.label(name)} must be given", at=(*at, "system"))
    if block.values:
        key = next(iter(block.values))
        raise DiagramError(f"{key} of {scope.label(name)} must be absent: a subsystem keeps its parameters inside",
                           at=(*at, key))  # fmt: skip
    inner = Scope(name=name, path=(*scope.path, name), at=(*at, "system"), parent=scope)
    _open(flat, inner, block.system)
    ports = Ports(
        inputs=tuple(key for key, entry in inner.entries.items() if entry.role is not None),
        outputs=tuple(inner.outputs),
        output_units=tuple(where.unit_of(block, port) for where, block, port in inner.outputs.values()),
    )
    return Entry(ports=ports, inner=inner)
