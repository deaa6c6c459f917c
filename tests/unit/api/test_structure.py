"""Documents on the wire that decide a structure: nesting, orders, port names."""

from __future__ import annotations

import json
from typing import Any

import pytest
from pydantic import ValidationError

from api.convert.systems import diagram_from_wire
from api.http.bodies import parse
from api.problems.documents import Problem
from api.schemas.systems import SystemDocument


def nested(depth: int) -> dict[str, Any]:
    """Return a lag inside ``depth`` subsystems."""
    inner: dict[str, Any] = {
        "blocks": {"u": {"kind": "input"}, "lag": {"kind": "first_order_sensor", "time_constant": 0.1}},
        "connections": [{"from": "u", "to": "lag"}],
        "outputs": {"y": "lag"},
    }
    for _ in range(depth):
        inner = {
            "blocks": {"u": {"kind": "input"}, "inner": {"kind": "subsystem", "system": inner}},
            "connections": [{"from": "u", "to": "inner"}],
            "outputs": {"y": "inner"},
        }
    return inner


@pytest.mark.parametrize("depth", [20, 32])
def test_a_deep_document_passes_all_doors(depth: int) -> None:
    # As the body of a simulation has it, one level further down.
    body = parse(json.dumps({"system": nested(depth)}).encode())
    document = SystemDocument.model_validate(body["system"])
    diagram = diagram_from_wire(document)
    assert list(diagram.parameters)[-1] == "inner." * depth + "lag.time_constant"
    assert SystemDocument.model_validate(document.model_dump(by_alias=True, exclude_unset=True)) == document


def test_what_is_too_deep_is_refused_with_the_limit() -> None:
    # The body is still read: it is the diagram that says how deep systems may be nested.
    body = parse(json.dumps({"system": nested(33)}).encode())
    with pytest.raises(Problem, match="nested at most 32 deep"):
        diagram_from_wire(SystemDocument.model_validate(body["system"]))


def alone(**block: Any) -> dict[str, Any]:
    return {"blocks": {"part": block}, "outputs": {"y": "part"}}


def test_an_order_is_a_whole_number() -> None:
    document = SystemDocument.model_validate(alone(kind="low_pass", frequency=10, order=3))
    assert diagram_from_wire(document).realize().states == 3
    for wrong in (2.5, "3", "=n", True, {"value": 3, "unit": "1"}):
        with pytest.raises(ValidationError, match="valid integer"):
            SystemDocument.model_validate(alone(kind="low_pass", frequency=10, order=wrong))


def test_ports_of_a_state_space_have_names() -> None:
    block = {"kind": "state_space", "A": [], "B": [], "C": [], "D": [[1, 2], [3, 4]], "inputs": ["a", "b"]}
    system = {
        "blocks": {"u": {"kind": "input"}, "part": block},
        "connections": [{"from": "u", "to": "part.b"}],
        "outputs": {"first": "part.out1", "second": "part.out2"},
    }
    diagram = diagram_from_wire(SystemDocument.model_validate(system))
    assert diagram.realize().d11.ravel().tolist() == [2.0, 4.0]
    with pytest.raises(ValidationError, match="pattern"):
        SystemDocument.model_validate(alone(**block | {"inputs": ["a", "1b"]}))


def test_components_of_a_network_have_units() -> None:
    block = {
        "kind": "rc_network", "network": "low_pass",
        "r1": {"value": 47, "unit": "kohm"}, "c2": {"value": 100, "unit": "nF"},
    }  # fmt: skip
    diagram = diagram_from_wire(SystemDocument.model_validate(alone(**block)))
    assert diagram.parameters["part.r1"].value == pytest.approx(47e3, rel=1e-15)
    assert diagram.parameters["part.c2"].value == pytest.approx(100e-9, rel=1e-15)
