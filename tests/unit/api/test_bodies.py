"""JSON bodies are read strictly."""

from __future__ import annotations

import json

import pytest

from api.bodies import parse


def test_a_plain_document_passes() -> None:
    assert parse(b'{"a": [1, 2.5, "x", null, true], "b": {"c": {}}}') == {
        "a": [1, 2.5, "x", None, True],
        "b": {"c": {}},
    }


@pytest.mark.parametrize(
    ("body", "says"),
    [
        (b'{"a": NaN}', "finite, got NaN at /a"),
        (b'{"blocks": {"c": {"kp": [1, NaN]}}}', "finite, got NaN at /blocks/c/kp/1"),
        (b'{"a": Infinity}', "finite"),
        (b'{"a": -Infinity}', "finite"),
        (b'{"a": 1e999}', "below 1.8e308"),
        (b'{"a": ' + b"9" * 5000 + b"}", "below 1.8e308"),
        (b'{"a": 1, "a": 2}', "'a' twice"),
        (b'{"a": {"b": 1, "c": 2, "b": 3}}', "'b' twice"),
        (b'{"a": ', "Expecting value"),
        (b"", "Expecting value"),
        (b'{"a": 1} x', "Extra data"),
        (b'{"a": "\xff"}', "UTF-8"),
        (b'{"a": "x\\u0000y"}', "NUL"),
        (b'{"a\\u0000": 1}', "NUL"),
        (b'{"a": "\\ud800"}', "NUL"),
        (b"[" * 100_000, "128 levels"),
        (b"[" * 129 + b"]" * 129, "128 levels"),
        (b'{"a":' * 129 + b"1" + b"}" * 129, "128 levels"),
    ],
)
def test_what_is_no_document_is_refused(body, says) -> None:
    with pytest.raises(json.JSONDecodeError) as caught:
        parse(body)
    assert says in caught.value.msg


def test_one_key_twice_among_many_costs_no_more_than_many_keys() -> None:
    """Each key is looked at once: a pass over the keys before it would be seconds of nothing else."""
    body = "{" + ",".join(f'"k{i}": 0' for i in range(200_000)) + ',"k199999": 1}'
    with pytest.raises(json.JSONDecodeError, match="'k199999' twice"):
        parse(body.encode())


def test_sixty_four_levels_pass() -> None:
    assert parse(b"[" * 128 + b"]" * 128) is not None


def test_escaped_text_passes() -> None:
    assert parse(b'{"a": "\\u00e9 \\ud83d\\ude00 \\\\u0000"}') == {"a": "\u00e9 \U0001f600 \\u0000"}
