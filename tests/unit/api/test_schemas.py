"""Documents are generated from the catalogues and refuse what does not belong in them."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from api.schemas.control_laws import KINDS as CONTROL_LAWS
from api.schemas.optimizations import OptimizationRequest
from api.schemas.signals import SignalDocument
from api.schemas.systems import BlockDocument, SystemDocument
from engine.elements import catalogue as elements
from engine.signals import catalogue as signals

BLOCK = TypeAdapter(BlockDocument)
SIGNAL = TypeAdapter(SignalDocument)


@pytest.mark.parametrize("kind", elements())
def test_the_example_of_every_element_is_a_block(kind) -> None:
    document = {
        "kind": kind,
        **{k: list(v) if isinstance(v, tuple) else v for k, v in elements()[kind].example.items()},
    }
    assert BLOCK.validate_python(document).model_dump(exclude_unset=True) == document


@pytest.fixture(scope="module")
def blocks_schema() -> dict[str, Any]:
    return BLOCK.json_schema()


@pytest.mark.parametrize("kind", elements())
def test_every_declared_parameter_is_a_field_and_nothing_else_is(kind, blocks_schema) -> None:
    schema = blocks_schema["$defs"][blocks_schema["discriminator"]["mapping"][kind].rpartition("/")[2]]
    others = {"limits"} if kind in CONTROL_LAWS else set()
    assert set(schema["properties"]) - others == {"kind", *(param.name for param in elements()[kind].parameters)}
    assert schema["additionalProperties"] is False


@pytest.mark.parametrize("kind", signals())
def test_the_example_of_every_signal_is_a_signal(kind) -> None:
    document = {"kind": kind, **{k: list(v) if isinstance(v, tuple) else v for k, v in signals()[kind].example.items()}}
    assert SIGNAL.validate_python(document).model_dump(exclude_unset=True) == document


@pytest.mark.parametrize(
    "value",
    [
        True,
        None,
        "5",
        "",
        {"value": 1},
        {"unit": "m"},
        {"value": "1", "unit": "m"},
        {"value": 1, "unit": ""},
        [1],
        {},
        {"value": 1, "unit": "m", "x": 1},
        {"value": True, "unit": "m"},
        float("nan"),
        float("inf"),
        10**400,
    ],
)
def test_what_is_no_value_is_refused(value) -> None:
    with pytest.raises(ValidationError):
        BLOCK.validate_python({"kind": "gain", "gain": value})


@pytest.mark.parametrize("value", [1, -2.5, 0, {"value": 3, "unit": "m"}, "=kp/20"])
def test_a_value_is_a_number_a_quantity_or_an_expression(value) -> None:
    assert BLOCK.validate_python({"kind": "gain", "gain": value}).model_dump()["gain"] == value


def test_a_system_document_comes_back_as_it_was_sent() -> None:
    document = {
        "name": "loop",
        "parameters": {"k": {"value": {"value": 1, "unit": "m"}, "lower": 0}},
        "blocks": {
            "r": {"kind": "input"},
            "inner": {
                "kind": "subsystem",
                "system": {"blocks": {"u": {"kind": "input"}}, "outputs": {"y": "u"}},
            },
        },
        "connections": [{"from": "r", "to": "inner.u"}],
        "outputs": {"y": "inner.y"},
    }
    assert SystemDocument.model_validate(document).model_dump(by_alias=True, exclude_unset=True) == document


def test_a_bare_value_is_a_parameter() -> None:
    given = {"w0": 100, "Kp": "=w0/20", "m": {"value": 0.3, "unit": "kg", "lower": 0.1}}
    document = {"parameters": given, "blocks": {"a": {"kind": "input"}}, "outputs": {"y": "a"}}
    expected = {"w0": {"value": 100}, "Kp": {"value": "=w0/20"}, "m": given["m"]}
    assert SystemDocument.model_validate(document).model_dump(exclude_unset=True)["parameters"] == expected


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ({"limits": {"lower": -1, "upper": "=umax"}}, {"lower": -1, "upper": "=umax"}),
        ({"limits": {"upper": 2}, "anti_windup": "clamping"}, {"upper": 2, "anti_windup": "clamping"}),
        (
            {"upper": 2, "anti_windup": {"kind": "back_calculation", "tracking_time": 0.1}},
            {"upper": 2, "anti_windup": "back_calculation", "tracking_time": 0.1},
        ),
        ({"anti_windup": {"kind": "tracking"}}, {"anti_windup": "tracking"}),
    ],
)
def test_limits_in_one_piece_are_kept_as_plain_parameters(given, kept) -> None:
    block = {"kind": "pi", "kp": 2}
    assert BLOCK.validate_python(block | given).model_dump(exclude_unset=True) == block | kept


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"limits": {"low": 1}}, "limits must be made of lower, upper, got 'low'"),
        ({"limits": {"lower": 1}, "lower": 0}, "lower must be given once"),
        ({"limits": 3}, "dictionary"),
        ({"anti_windup": {"kind": "hope"}}, "'none', 'clamping', 'back_calculation' or 'tracking'"),
        ({"anti_windup": {"kind": "tracking", "time": 1}}, "anti_windup must be made of tracking_time, got 'time'"),
    ],
)
def test_wrong_limits_are_refused(given, says) -> None:
    with pytest.raises(ValidationError, match=says):
        BLOCK.validate_python({"kind": "pi", "kp": 2, **given})


@pytest.mark.parametrize(
    "change",
    [
        {"blocks": {}},
        {"outputs": {}},
        {"blocks": {"_a": {"kind": "input"}}},
        {"blocks": {"1a": {"kind": "input"}}},
        {"blocks": {"a b": {"kind": "input"}}},
        {"connections": [{"from": "a"}]},
        {"connections": [{"source": "a", "target": "b"}]},
        {"connections": {"from": "a", "to": "b"}},
        {"extra": 1},
        {"name": 5},
        {"parameters": {"k": "5"}},
        {"parameters": {"k": [5]}},
    ],
)
def test_a_wrong_system_document_is_refused(change) -> None:
    good = {"blocks": {"a": {"kind": "input"}}, "outputs": {"y": "a"}}
    SystemDocument.model_validate(good)
    with pytest.raises(ValidationError):
        SystemDocument.model_validate(good | change)


@pytest.mark.parametrize(
    "signal",
    [
        {"kind": "sampled"},
        {"kind": "sampled", "time": [0, 1]},
        {"kind": "sampled", "time": [0, 1], "values": [0, 1], "dataset": "ds_1"},
        {"kind": "sampled", "dataset": "ds_1"},
        {"kind": "step", "amplitude": "=k"},
    ],
)
def test_a_wrong_signal_is_refused(signal) -> None:
    with pytest.raises(ValidationError):
        SIGNAL.validate_python(signal)


def test_goals_name_from_and_to_as_the_contract_does() -> None:
    request = OptimizationRequest.model_validate(
        {
            "system": "sys_1",
            "variables": [{"parameter": "kp"}],
            "goals": [{"metric": "bandwidth", "from": "reference", "to": "position", "sense": "maximize"}],
            "method": {"kind": "gradient", "starts": 3},
        }
    )
    assert (request.goals[0].source, request.goals[0].target) == ("reference", "position")
    assert request.scenarios == [{}]
