"""A reply of the service: a dictionary whose keys are attributes, too, and whose parts are replies themselves.

What it prints as is short; `json.dumps` and `dict` give the whole.
"""

from __future__ import annotations

import html
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

_LONGEST_WORD = 40
_MOST_WORDS = 6


class Reply(dict[str, Any]):
    """What the service answered; SI units throughout.

    A key is an attribute; one that is a word of Python, or a method of dictionaries, with an underscore behind it: ``from_``, ``values_``.
    Keys that a reply may leave out are None where it does.

    Examples
    --------
    ::

        reply = client.simulate(document, input={"port": "reference", "signal": {"kind": "step"}})
        reply.variants[0].metrics["position"].overshoot.value
    """

    def __init__(self, raw: Mapping[str, Any] = {}, /) -> None:
        known = _known(type(self))
        super().__init__({key: _made(known.get(key), value) for key, value in raw.items()})

    def __getattr__(self, name: str) -> Any:
        key = name[:-1] if name.endswith("_") and not name.endswith("__") else name
        if key in self:
            return self[key]
        if key in _optional(type(self)):
            return None
        raise AttributeError(f"{type(self).__name__} has no {name!r}; it has {', '.join(self)}")

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *(str(key) for key in self)})

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.summary()}>"

    def summary(self) -> str:
        """Return what is told of it in a line."""
        words: list[str] = []
        for key, value in self.items():
            text = _short(value)
            if text and len(words) < _MOST_WORDS:
                words.append(f"{key}={text}")
        return ", ".join(words)

    def table(self) -> Iterator[tuple[str, str]]:
        """Yield names and texts of what a notebook shows."""
        for key, value in self.items():
            yield key, _short(value) or repr(value)[: 2 * _LONGEST_WORD]

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th style='text-align:left'>{html.escape(name)}</th><td style='text-align:left'>{html.escape(text)}</td></tr>"
            for name, text in self.table()
        )
        return f"<table><caption>{html.escape(type(self).__name__)}</caption>{rows}</table>"


def _short(value: Any) -> str:
    """Return a value as a word or two; empty for what has more in it."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, bool | int) or value is None:
        return str(value)
    if isinstance(value, str):
        return value if len(value) <= _LONGEST_WORD else f"{value[: _LONGEST_WORD - 3]}..."
    if isinstance(value, list):
        return f"[{len(value)}]"
    if isinstance(value, Reply) and type(value) is not Reply:
        return repr(value)
    return ""


def _made(hint: Callable[[Any], Any] | None, value: Any) -> Any:
    """Return a value as what its annotation says; a dictionary without one is a plain reply."""
    if hint is not None and value is not None:
        return hint(value)
    if isinstance(value, dict) and not isinstance(value, Reply):
        return Reply(value)
    if isinstance(value, list) and value and isinstance(value[0], dict | list):
        return [_made(None, item) for item in value]
    return value


@cache
def _known(kind: type[Reply]) -> dict[str, Callable[[Any], Any]]:
    """Return what makes the parts of a reply whose annotations name replies."""
    found = {}
    for name, hint in get_type_hints(kind).items():
        maker = _maker(hint)
        if maker is not None:
            found[name.removesuffix("_")] = maker
    return found


@cache
def _optional(kind: type[Reply]) -> frozenset[str]:
    """Return the keys of a reply that may be None."""
    return frozenset(
        name.removesuffix("_") for name, hint in get_type_hints(kind).items() if type(None) in get_args(hint)
    )


def _maker(hint: Any) -> Callable[[Any], Any] | None:
    origin, args = get_origin(hint), get_args(hint)
    if origin in (UnionType, Union):
        makers = [maker for maker in map(_maker, args) if maker is not None]
        return makers[0] if makers else None
    if isinstance(hint, type) and issubclass(hint, Reply):
        return hint
    if origin is list:
        inner = _maker(args[0])
        return None if inner is None else partial(_all, inner)
    if origin is dict:
        inner = _maker(args[1])
        return None if inner is None else partial(_each, inner)
    return None


def _all(inner: Callable[[Any], Any], values: list[Any]) -> list[Any]:
    return [item if item is None else inner(item) for item in values]


def _each(inner: Callable[[Any], Any], value: Mapping[str, Any]) -> Reply:
    """Return a reply whose parts, all of one kind, have names of the user's."""
    named = Reply()
    for key, item in value.items():
        named[key] = item if item is None else inner(item)
    return named
