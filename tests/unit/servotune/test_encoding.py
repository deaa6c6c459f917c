"""What becomes of a script's values on their way: numpy's are numbers, and what is none is named with its place."""

from __future__ import annotations

import json
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pint
import pytest

import servotune
from servotune.encoding import encoded
from tests.unit.servotune.conftest import Answer, Service


@dataclass
class Step:
    amplitude: np.float32
    kind: str = "step"


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.int64(3), 3),
        (np.uint8(3), 3),
        (np.float32(0.5), 0.5),
        (np.float64(0.1), 0.1),
        (np.bool_(True), True),
        (np.array(2.5), 2.5),
        (np.array([[1, 2], [3, 4]]), [[1, 2], [3, 4]]),
        (np.linspace(0, 1, 3), [0.0, 0.5, 1.0]),
        (np.roots([1.0, 2.0, 5.0]), [[-1.0, 2.0], [-1.0, -2.0]]),
        ([np.int64(1), (np.float32(2.0), None)], [1, [2.0, None]]),
        (range(3), [0, 1, 2]),
        (Fraction(1, 4), 0.25),
        (Decimal("0.1"), 0.1),
        (pint.UnitRegistry().Quantity(np.float32(65.0), "cm**2"), {"value": 65.0, "unit": "centimeter ** 2"}),
        (Step(amplitude=np.float32(2.0)), {"amplitude": 2.0, "kind": "step"}),
        ({"a": {"b": np.array([1])}}, {"a": {"b": [1]}}),
        (np.str_("kp"), "kp"),
    ],
)
def test_values_become_json(value: Any, expected: Any) -> None:
    found = encoded(value)
    assert json.loads(json.dumps(found)) == expected
    assert type(found) is not np.bool_


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ({"variants": [{"kp": 1.0}, {"kp": float("nan")}]}, "/variants/1/kp must be finite, got nan"),
        ({"frequencies": np.array([1.0, np.inf])}, "/frequencies/1 must be finite, got inf"),
        ({"zeros": np.array([1.0 + 1j * np.nan])}, "/zeros/0 must be finite, got nan"),
        ({"system": {"blocks": {1: {}}}}, "names in /system/blocks must be texts, got 1"),
        (
            {"input": {"port": object()}},
            "/input/port must be a number, a text, a list, a mapping or None, got builtins.o",
        ),
        ({"x": b"raw"}, "/x must be a number, a text, a list, a mapping or None, got builtins.bytes"),
        ({"x": {1, 2}}, "/x must be a number, a text, a list, a mapping or None, got builtins.set"),
    ],
)
def test_what_cannot_be_sent_is_named_with_its_place(value: Any, message: str) -> None:
    with pytest.raises(servotune.DocumentError) as caught:
        encoded(value)
    assert str(caught.value).startswith(message)


def test_a_study_takes_arrays(service: Service, client: servotune.Client) -> None:
    service.on("POST /v1/frequency-responses", Answer({"variants": []}))
    gains = np.array([1.0, 2.0], dtype=np.float32)
    client.frequency_response(
        {"parameters": {"J": {"value": np.float32(0.5)}}},
        open_at="error",
        frequencies=np.logspace(0, 2, 3),
        variants=[{"Kp": gain} for gain in gains],
    )
    assert service.asked[0].json == {
        "system": {"parameters": {"J": {"value": 0.5}}},
        "open_at": "error",
        "frequencies": [1.0, 10.0, 100.0],
        "variants": [{"Kp": 1.0}, {"Kp": 2.0}],
    }


def test_nothing_is_sent_of_a_document_that_is_wrong(service: Service, client: servotune.Client) -> None:
    with pytest.raises(servotune.DocumentError, match="/variants/0/kp must be finite, got nan"):
        client.simulate("sys_1", input={"port": "u", "signal": {"kind": "step"}}, variants=[{"kp": np.nan}])
    assert service.asked == []
