"""The system document as a diagram of the core."""

from __future__ import annotations

from typing import Any

from api.convert.values import free_unit, nested_si, optional_si, si
from api.problems.documents import at, invalid
from api.problems.pointers import Place
from api.schemas.systems import ParameterDocument, SubsystemBlock, SystemDocument
from api.units.conversion import to_si
from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.elements import catalogue


def system_from_wire(document: SystemDocument, *, place: Place = ()) -> System:
    """Return the system of the core, every quantity in SI.

    Parameters
    ----------
    document : SystemDocument
    place : tuple
        Where the document stands in the request body.

    Raises
    ------
    Problem
        422 with the place of every unit that does not fit.
    """
    return System(
        name=document.name,
        parameters={
            name: _parameter(name, parameter, (*place, "parameters", name))
            for name, parameter in document.parameters.items()
        },
        blocks={name: _block(block, (*place, "blocks", name)) for name, block in document.blocks.items()},
        connections=tuple(Connection(source=wire.source, target=wire.target) for wire in document.connections),
        outputs=dict(document.outputs),
    )


def diagram_from_wire(document: SystemDocument, *, place: Place = ()) -> Diagram:
    """Return the checked diagram.

    Raises
    ------
    Problem
        422 with the place of what is wrong, counted from the root of the request body.
    """
    system = system_from_wire(document, place=place)
    with at(*place):
        return compile_system(system)


def _parameter(name: str, document: ParameterDocument, place: Place) -> Parameter:
    unit = free_unit(document.value, document.unit, name=name, place=(*place, "unit" if document.unit else "value"))
    return Parameter(
        value=_own_value(name, document, unit, place),
        unit=unit,
        lower=optional_si(document.lower, unit, name=f"lower of {name}", place=(*place, "lower")),
        upper=optional_si(document.upper, unit, name=f"upper of {name}", place=(*place, "upper")),
        scale=document.scale,
        doc=document.doc,
    )


def _own_value(name: str, document: ParameterDocument, unit: str, place: Place) -> float | str:
    value = document.value
    if isinstance(value, str):
        if document.unit and to_si(1.0, document.unit, unit) != 1:
            raise invalid(
                f"unit of {name} must be {unit} where an expression gives the value (expressions are in SI), "
                f"got {document.unit!r}",
                *place,
                "unit",
            )
        return value
    if document.unit and not isinstance(value, dict):
        return si({"value": value, "unit": document.unit}, unit, name=name, place=(*place, "value"))
    return si(value, unit, name=name, place=(*place, "value"))


def _block(document: Any, place: Place) -> Block:
    if isinstance(document, SubsystemBlock):
        return Block(kind="subsystem", values={}, system=system_from_wire(document.system, place=(*place, "system")))
    units = {param.name: param.unit for param in catalogue()[document.kind].parameters}
    given = document.model_dump(exclude_unset=True, exclude={"kind"})
    return Block(
        kind=document.kind,
        values={name: nested_si(value, units[name], name=name, place=(*place, name)) for name, value in given.items()},
    )
