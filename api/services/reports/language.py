"""The language of a report: English as it stands in the code, Romanian from the list beside it.

What people wrote, and sentences of the service, such as warnings and advice, stay as they are: the contract speaks English.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Any, Literal

Language = Literal["en", "ro"]
"""Those of the pages."""

_spoken: ContextVar[Language] = ContextVar("language of a report", default="en")


@contextmanager
def speaking(spoken: Language) -> Iterator[None]:
    """Write what is said within in this language."""
    before = _spoken.set(spoken)
    try:
        yield
    finally:
        _spoken.reset(before)


def language() -> Language:
    """Return the language that is spoken here."""
    return _spoken.get()


@cache
def romanian() -> Mapping[str, Mapping[str, Any]]:
    """Return ``texts`` by their English, ``words`` by names of the contract, and ``choices`` by the fields that offer them."""
    read: Mapping[str, Mapping[str, Any]] = json.loads(Path(__file__).with_name("romanian.json").read_text("utf-8"))
    return read


def _found(part: str, name: str, otherwise: str) -> str:
    return str(romanian()[part].get(name, otherwise)) if language() == "ro" else otherwise


def say(text: str, **gaps: object) -> str:
    """Return a text in the language of the report, with what stands in its gaps.

    >>> say("{count} values", count=3)
    '3 values'
    """
    found = _found("texts", text, text)
    return found.format(**gaps) if gaps else found


def words(name: str) -> str:
    """Return ``rise_time`` as "rise time"."""
    return name.replace("_", " ")


def said_of(name: str, title: str = "") -> str:
    """Return what something of a catalogue is called at the beginning of a line, in English by its title."""
    return _capital(_found("words", name, title or name))


def word(name: str) -> str:
    """Return a name of the contract as words: a verdict, a status, a kind, a field.

    >>> word("not_settled")
    'not settled'
    """
    return _found("words", name, words(name))


def label(name: str) -> str:
    """Return a name of the contract as a heading.

    >>> label("rise_time")
    'Rise time'
    """
    return _capital(word(name))


def choice(field: str, value: str) -> str:
    """Return what was chosen in a field; where that is none of what the contract offers there, it is a name."""
    offered = romanian()["choices"].get(field, {})
    if value not in offered:
        return value
    return str(offered[value]) if language() == "ro" else words(value)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
