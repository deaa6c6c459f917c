"""Pointers count from the root of the request body, and never name the tag of a union."""

from __future__ import annotations

import pytest

from api.problems.pointers import place_in, pointer

BODY = {
    "system": {
        "blocks": {
            "motor": {"kind": "linear_pneumatic_motor", "area": -1},
            "gain": {"kind": "gain", "gain": "x"},
        }
    },
    "goals": [{"from": "a"}],
}


@pytest.mark.parametrize(
    ("location", "names_a_field", "expected"),
    [
        (
            ("system", "document", "blocks", "motor", "linear_pneumatic_motor", "area"),
            False,
            "/system/blocks/motor/area",
        ),
        # an element whose parameter is called like its kind
        (("system", "document", "blocks", "gain", "gain", "gain"), False, "/system/blocks/gain/gain"),
        (("system", "document", "blocks", "gain", "gain", "foo"), True, "/system/blocks/gain/foo"),
        (
            ("system", "document", "blocks", "motor", "linear_pneumatic_motor", "mass"),
            True,
            "/system/blocks/motor/mass",
        ),
        (("goals", 0, "from"), False, "/goals/0/from"),
        (("goals", 0, "metric"), True, "/goals/0/metric"),
        (("goals", 7, "metric"), False, "/goals"),
        ((), False, ""),
    ],
)
def test_a_location_of_pydantic_becomes_a_place_in_the_body(location, names_a_field, expected) -> None:
    assert pointer(place_in(BODY, location, names_a_field=names_a_field)) == expected


def test_special_characters_are_escaped() -> None:
    # RFC 6901, section 3
    assert pointer(("a/b", "m~n", 0)) == "/a~1b/m~0n/0"
