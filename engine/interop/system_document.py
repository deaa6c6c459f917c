"""A system as the JSON document that the service takes: all numbers are in SI."""

from __future__ import annotations

from typing import Any

from engine.model.document import Block, Parameter, System


def system_document(system: System) -> dict[str, Any]:
    """Return the document of a system, subsystems included; what has no value is left out."""
    return {
        "name": system.name,
        "parameters": {name: _parameter(parameter) for name, parameter in system.parameters.items()},
        "blocks": {name: _block(block) for name, block in system.blocks.items()},
        "connections": [{"from": wire.source, "to": wire.target} for wire in system.connections],
        "outputs": dict(system.outputs),
    }


def _parameter(parameter: Parameter) -> dict[str, Any]:
    fields = {
        "value": parameter.value,
        "unit": parameter.unit or None,
        "lower": parameter.lower,
        "upper": parameter.upper,
        "scale": parameter.scale,
        "doc": parameter.doc or None,
    }
    return {name: value for name, value in fields.items() if value is not None}


def _block(block: Block) -> dict[str, Any]:
    if block.system is not None:
        return {"kind": block.kind, "system": system_document(block.system)}
    return {"kind": block.kind, **{name: value for name, value in block.values.items() if value is not None}}
