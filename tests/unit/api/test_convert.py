"""Wire to core and back: values in SI, places of what is wrong, NaN as null."""

from __future__ import annotations

import math

import numpy as np
import pytest

from api.convert.recordings import envelope, in_si, physical, window
from api.convert.systems import diagram_from_wire, system_from_wire
from api.convert.values import listed, measured_to_wire, numbers, overrides_from_wire
from api.http.calls import answer, expected_revision
from api.problems.documents import Problem
from api.schemas.systems import SystemDocument
from engine.model.verdicts import Measured, Verdict

DOCUMENT = {
    "parameters": {
        "k": {"value": 2, "unit": "cm", "lower": {"value": 1, "unit": "cm"}, "upper": 1.0},
        "w": {"value": 10, "unit": "Hz"},
        "twice": {"value": "=2*k"},
    },
    "blocks": {
        "r": {"kind": "input"},
        "g": {"kind": "gain", "gain": "=k"},
        "lag": {"kind": "transfer_function", "numerator": [1], "denominator": ["=1/w", {"value": 1, "unit": "1"}]},
    },
    "connections": [{"from": "r", "to": "g"}, {"from": "g", "to": "lag"}],
    "outputs": {"y": "lag"},
}


def document(**changes) -> SystemDocument:
    return SystemDocument.model_validate(DOCUMENT | changes)


def test_parameters_are_kept_in_si() -> None:
    system = system_from_wire(document())
    k = system.parameters["k"]
    assert (k.value, k.unit, k.lower, k.upper) == (0.02, "m", 0.01, 1.0)
    assert system.parameters["w"].value == 20 * math.pi
    assert system.parameters["w"].unit == "rad/s"
    assert system.parameters["twice"].value == "=2*k"
    assert system.blocks["lag"].values["denominator"] == ["=1/w", 1.0]


def places(caught) -> list[str]:
    return [entry["pointer"] for entry in caught.value.document()["errors"]]


@pytest.mark.parametrize(
    ("changes", "pointer"),
    [
        ({"parameters": {"k": {"value": 1, "unit": "degC"}}}, "/system/parameters/k/unit"),
        ({"parameters": {"k": {"value": 1, "unit": "m", "lower": {"value": 1, "unit": "kg"}}}}, "/system/parameters/k/lower"),
        ({"parameters": {"k": {"value": "=1", "unit": "cm"}}}, "/system/parameters/k/unit"),
        ({"parameters": {"k": {"value": {"value": 1, "unit": "parrot"}}}}, "/system/parameters/k/value"),
        ({"blocks": DOCUMENT["blocks"] | {"g": {"kind": "delay", "time": {"value": 1, "unit": "m"}}}}, "/system/blocks/g/time"),
        (
            {"blocks": DOCUMENT["blocks"] | {"lag": {"kind": "transfer_function", "numerator": [1, {"value": 1, "unit": "degC"}], "denominator": [1, 1]}}},
            "/system/blocks/lag/numerator/1",
        ),
        ({"blocks": DOCUMENT["blocks"] | {"g": {"kind": "delay", "time": -1}}}, "/system/blocks/g/time"),
        ({"outputs": {"y": "nothing"}}, "/system/outputs/y"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_found_from_the_root_of_the_body(changes, pointer) -> None:
    with pytest.raises(Problem) as caught:
        diagram_from_wire(document(**changes), place=("system",))
    assert places(caught) == [pointer]


def test_overrides_are_in_si_and_name_what_exists() -> None:
    diagram = diagram_from_wire(document())
    given = {"k": {"value": 5, "unit": "mm"}, "w": {"value": 1, "unit": "Hz"}}
    assert overrides_from_wire(given, diagram, place=()) == {"k": 0.005, "w": 2 * math.pi}


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"nothing": 1}, "one of the system's"),
        ({"twice": 1}, "expression"),
        ({"g.gain": 1}, "expression"),
        ({"k": {"value": 1, "unit": "kg"}}, "must be in m"),
    ],
)
def test_a_wrong_override_is_refused_at_its_place(given, says) -> None:
    diagram = diagram_from_wire(document())
    with pytest.raises(Problem, match=says) as caught:
        overrides_from_wire(given, diagram, place=("variants", 3))
    assert places(caught) == [f"/variants/3/{next(iter(given))}"]


def test_what_is_no_number_leaves_as_null() -> None:
    assert listed(numbers([1.0, math.nan, math.inf, -1e101, -1e99])) == [1.0, None, None, None, -1e99]
    assert answer({"a": np.array([[1.0], [np.nan]])}).body == b'{"a":[[1.0],[null]]}'


def test_nan_outside_of_an_array_is_an_error_of_ours() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        answer({"a": math.nan})


def test_a_metric_leaves_with_its_verdict() -> None:
    assert measured_to_wire(Measured(value=1.5, unit="s")) == {"value": 1.5, "unit": "s", "verdict": "ok"}
    absent = Measured(value=None, unit="s", verdict=Verdict.NEVER_CROSSES, advice="raise the gain")
    assert measured_to_wire(absent) == {
        "value": None,
        "unit": "s",
        "verdict": "never_crosses",
        "advice": "raise the gain",
    }


def test_a_channel_is_calibrated_in_its_unit_and_then_in_si() -> None:
    channel = {"name": "x", "unit": "mm", "scale": 10.0, "offset": 1.0}
    raw = np.array([0.0, 0.5])
    assert physical(raw, channel).tolist() == [1.0, 6.0]
    values, unit = in_si(raw, channel, place=())
    assert values == pytest.approx([0.001, 0.006], rel=1e-15)
    assert unit == "m"


def test_a_negative_scale_exchanges_minimum_and_maximum() -> None:
    low, high = envelope(np.array([1.0]), np.array([2.0]), {"scale": -1.0})
    assert (low.tolist(), high.tolist()) == ([-2.0], [-1.0])


@pytest.mark.parametrize(
    ("given", "expected"), [(None, None), ([1, {"value": 2000, "unit": "ms"}], (1.0, 2.0)), ([1, 99], (1.0, 10.0))]
)
def test_a_window_is_within_the_recording(given, expected) -> None:
    assert window(given, length=10.0, name="window") == expected


@pytest.mark.parametrize("given", [[2, 1], [-1, 1], [1, 1], [11, 12], [{"value": 1, "unit": "m"}, 2]])
def test_a_wrong_window_is_refused(given) -> None:
    with pytest.raises(Problem):
        window(given, length=10.0, name="window")


@pytest.mark.parametrize(("header", "status"), [(None, 428), ("abc", 412), ('"x"', 412), ("", 412)])
def test_if_match_must_be_an_etag(header, status) -> None:
    with pytest.raises(Problem) as caught:
        expected_revision(header, lambda: 7)
    assert caught.value.status == status


@pytest.mark.parametrize(("header", "revision"), [('"3"', 3), ('W/"3"', 3), ("3", 3), ("*", 7)])
def test_if_match_names_a_revision(header, revision) -> None:
    assert expected_revision(header, lambda: 7) == revision
