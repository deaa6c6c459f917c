"""JSON bodies are read strictly."""

from __future__ import annotations

import asyncio
import json
import threading
from typing import Any

import pytest

from api.http import bodies
from api.http.bodies import _Reading, parse


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


@pytest.mark.parametrize("count", [1000, 4000, 16_000])
def test_the_cost_of_a_key_twice_grows_as_the_keys_do(count) -> None:
    """Each key is looked at a bounded number of times, counted as comparisons: a pass over the keys before it would be a square."""

    class Key(str):
        compared = 0
        __slots__ = ()

        def __eq__(self, other: object) -> bool:
            Key.compared += 1
            return str.__eq__(self, other)

        __hash__ = str.__hash__

    pairs = [(Key(f"k{i}"), 0) for i in range(count)]
    with pytest.raises(ValueError, match=f"'k{count - 1}' twice"):
        _Reading().members([*pairs, (Key(f"k{count - 1}"), 1)])
    assert 0 < Key.compared < count


def test_keys_and_numbers_are_bounded() -> None:
    objects = ",".join(['{"a":[],"b":[]}'] * 100_000)
    assert len(parse(f"[{objects}]".encode())) == 100_000
    with pytest.raises(json.JSONDecodeError, match="at most 200000 keys, got more"):
        parse(f'[{objects},{{"c":[]}}]'.encode())
    numbers = ",".join(["0"] * 1_000_000)
    assert len(parse(f"[{numbers}]".encode())) == 1_000_000
    with pytest.raises(json.JSONDecodeError, match="at most 1000000 numbers, got more"):
        parse(f"[{numbers},0.5]".encode())


def test_a_large_document_is_read_beside_the_event_loop(monkeypatch) -> None:
    """Whoever else waits for the loop is answered meanwhile; a small one is not worth a thread."""
    threads = []

    def noted(body: bytes) -> Any:
        threads.append(threading.get_ident())
        return parse(body)

    monkeypatch.setattr(bodies, "parse", noted)
    small, large = b"[1]", b"[" + b" " * (64 << 10) + b"1]"
    for body in (small, large):
        assert asyncio.run(bodies.parse_beside(body)) == [1]
    with pytest.raises(json.JSONDecodeError, match="'a' twice"):
        asyncio.run(bodies.parse_beside(b'{"a": 1, "a": 1' + b" " * (64 << 10) + b"}"))
    assert [thread == threading.get_ident() for thread in threads] == [True, False, False]


def test_sixty_four_levels_pass() -> None:
    assert parse(b"[" * 128 + b"]" * 128) is not None


def test_escaped_text_passes() -> None:
    assert parse(b'{"a": "\\u00e9 \\ud83d\\ude00 \\\\u0000"}') == {"a": "\u00e9 \U0001f600 \\u0000"}
