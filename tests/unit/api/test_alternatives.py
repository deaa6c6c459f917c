"""Structures described by their differences."""

from __future__ import annotations

import pytest

from api.convert.alternatives import altered
from api.problems.documents import Problem
from api.schemas.optimizations import AlternativeDocument

SYSTEM = {
    "parameters": {"c": {"value": 1}},
    "blocks": {
        "u": {"kind": "input"},
        "lag": {"kind": "low_pass", "frequency": 1, "order": 1},
        "body": {"kind": "integrator"},
    },
    "connections": [{"from": "u", "to": "lag.in"}, {"from": "lag.out", "to": "body"}],
    "outputs": {"y": "body"},
}


def test_a_block_goes_with_its_connections_and_another_takes_its_place() -> None:
    alternative = AlternativeDocument.model_validate({
        "name": "direct",
        "remove": {"blocks": ["lag"]},
        "add": {"parameters": {"c": {"value": 2}}, "connections": [{"from": "u", "to": "body"}], "outputs": {"x": "u"}},
    })  # fmt: skip
    changed = altered(SYSTEM, alternative, ("alternatives", 0))
    assert set(changed["blocks"]) == {"u", "body"}
    assert changed["connections"] == [{"from": "u", "to": "body"}]
    assert changed["parameters"] == {"c": {"value": 2}}
    assert changed["outputs"] == {"y": "body", "x": "u"}
    assert set(SYSTEM["blocks"]) == {"u", "lag", "body"}  # the request's own system stays as it is


def test_a_connection_alone_can_go() -> None:
    alternative = AlternativeDocument.model_validate(
        {"name": "open", "remove": {"connections": [{"from": "lag.out", "to": "body"}]}}
    )
    assert altered(SYSTEM, alternative, ())["connections"] == [{"from": "u", "to": "lag.in"}]


@pytest.mark.parametrize(
    ("remove", "place"),
    [
        ({"blocks": ["ghost"]}, ("alternatives", 1, "remove", "blocks", 0)),
        ({"connections": [{"from": "u", "to": "body"}]}, ("alternatives", 1, "remove", "connections", 0)),
    ],
)
def test_what_is_not_there_cannot_be_removed(remove, place) -> None:
    alternative = AlternativeDocument.model_validate({"name": "wrong", "remove": remove})
    with pytest.raises(Problem) as caught:
        altered(SYSTEM, alternative, ("alternatives", 1))
    assert caught.value.faults[0].place == place
