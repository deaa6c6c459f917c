from __future__ import annotations

import math

import pytest

from servotune.comparing import differences


def found(recorded, repeated) -> dict[str, float]:
    return {row.path: row.difference for row in differences(recorded, repeated)}


def test_every_number_is_found_by_its_path() -> None:
    recorded = {"parameters": {"k": {"value": 2.0, "unit": "1/s"}}, "goals": [{"after": {"value": 4.0}}]}
    repeated = {"parameters": {"k": {"value": 2.2, "unit": "1/s"}}, "goals": [{"after": {"value": 4.0}}]}
    # 0.2 of the larger one, 2.2
    assert found(recorded, repeated) == {
        "parameters.k.value": pytest.approx(0.2 / 2.2),
        "goals[0].after.value": 0.0,
    }


def test_a_curve_is_one_quantity_relative_to_its_largest_value() -> None:
    assert found({"y": [0.0, 1e-20, -4.0, None]}, {"y": [1e-20, 0.0, -4.2, None]}) == {"y[2]": pytest.approx(0.05)}
    assert found({"m": [[1.0, 0.0], [0.0, 1.0]]}, {"m": [[1.0, 0.0], [0.1, 1.0]]}) == {"m[2]": pytest.approx(0.1)}


def test_what_is_the_rounding_of_its_neighbours_is_equal() -> None:
    assert found({"a": 1.0, "b": 3e-17}, {"a": 1.0, "b": -2e-17}) == {"a": 0.0, "b": 0.0}
    # a small number in its own right is not
    assert found({"a": 1.0, "b": 3e-9}, {"a": 1.0, "b": 3.3e-9})["b"] == pytest.approx(1 / 11)


@pytest.mark.parametrize(
    ("recorded", "repeated"),
    [
        ({"a": 1.0}, {}),
        ({"a": 1.0}, {"a": None}),
        ({"a": [1.0, 2.0]}, {"a": [1.0]}),
        ({"a": [1.0, 2.0]}, {"a": [1.0, None]}),
        ({"a": [{"b": 1.0}]}, {"a": None}),
        ({"verdict": "pass"}, {"verdict": "fail"}),
    ],
)
def test_what_is_missing_or_another_word_is_infinitely_far(recorded, repeated) -> None:
    assert max(found(recorded, repeated).values()) == math.inf


def test_times_and_identifiers_are_no_results() -> None:
    assert found({"seconds": 1.0, "system": {"revision": 3}, "id": "x"}, {"seconds": 2.0, "system": None}) == {}
    assert found({"count": 3, "flag": True}, {"count": 3, "flag": False}) == {"count": 0.0}
