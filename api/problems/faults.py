"""What pydantic finds wrong in a document, as sentences that name the thing, the rule and the value."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence, Sized
from difflib import get_close_matches
from typing import Any

from api.problems.documents import Fault, Problem, invalid_document
from api.problems.pointers import place_in
from engine import elements, signals

_MOST_FAULTS = 50
_LONGEST_SHOWN = 80
_MOST_NAMES = 20


def validation_problem(errors: Sequence[Any], body: Any) -> Problem:
    """Return the 422 for what pydantic found; the place of an error begins with `body`, or says which part of the address it is in."""
    return invalid_document([_fault(dict(error), body) for error in errors[:_MOST_FAULTS]])


def _fault(error: dict[str, Any], body: Any) -> Fault:
    where, *location = error["loc"]
    kind = error["type"]
    if where != "body":
        name = f"{where} parameter {'.'.join(str(part) for part in location)}"
        return Fault(place=(), detail=sentence(name, error))
    if kind == "json_invalid":
        at = (
            f" (character {location[0]})" if location and location[0] else ""
        )  # at 0: the sentence names the place, if there is one
        return Fault(place=(), detail=f"the body must be JSON: {error['ctx']['error']}{at}")
    if not isinstance(body, dict):
        return Fault(place=(), detail="the body must be a JSON object sent with Content-Type: application/json")
    place = place_in(body, location, names_a_field=kind in {"missing", "extra_forbidden"})
    name = _name(place)
    if kind in {"union_tag_invalid", "union_tag_not_found"} and isinstance(error.get("input"), dict):
        expected = error.get("ctx", {}).get("expected_tags", "")
        got = error["input"].get("kind")
        known = re.findall(r"'(.*?)'", expected)
        near = get_close_matches(got, known, n=1) if isinstance(got, str) else []
        meant = f" (was {near[0]!r} meant?)" if near else ""
        # a hundred names would hide the one that was meant
        all_of_them = f"the {len(known)} in the catalogue" if near and len(known) > _MOST_NAMES else expected
        detail = f"kind must be one of {all_of_them or 'the catalogue'}, got {_shown(got)}{meant}"
        return Fault(place=(*place, "kind"), detail=detail)
    return Fault(place=place, detail=sentence(name, error) + (_meant(location) if kind == "extra_forbidden" else ""))


def _meant(location: Sequence[str | int]) -> str:
    """Return which parameter of a block or signal a wrong name is nearest to; its kind stands in front of the name."""
    kind = str(location[-2]) if len(location) > 1 else ""
    declared = elements.catalogue().get(kind) or signals.catalogue().get(kind)
    known = [] if declared is None else [param.name for param in declared.parameters]
    near = get_close_matches(str(location[-1]), known, n=1)
    return f" (was {near[0]!r} meant?)" if near else ""


def _name(place: Sequence[str | int]) -> str:
    """Return what a sentence calls a place: its last name, with the numbers behind it."""
    names = [at for at, part in enumerate(place) if isinstance(part, str)]
    return "/".join(str(part) for part in place[names[-1] if names else 0 :]) or "the document"


_KINDS = {
    "string_type": "a text", "bool_type": "true or false", "bool_parsing": "true or false", "list_type": "a list",
    "tuple_type": "a list", "dict_type": "an object", "model_type": "an object", "model_attributes_type": "an object",
    "datetime_type": "a date and time", "datetime_parsing": "a date and time", "datetime_from_date_parsing": "a date and time",
    "timezone_aware": "a date and time with its zone",
    "ip_v4_network": "an IP network", "ip_v6_network": "an IP network",
    "float_type": "a number", "float_parsing": "a number", "int_type": "a whole number", "int_parsing": "a whole number",
    "int_from_float": "a whole number", "finite_number": "a finite number",
}  # fmt: skip
"""What pydantic expected where the JSON value was of another kind."""


def sentence(name: str, error: Mapping[str, Any]) -> str:
    """Return ``<name> must be <rule>, got <value>`` for what pydantic found."""
    kind, message = error["type"], str(error["msg"])
    given, limits = error.get("input"), error.get("ctx", {})
    count = len(given) if isinstance(given, Sized) else 0
    shown = _shown(given)
    plain = given if isinstance(given, str) else shown  # a number of an address is a text
    sentences = {
        "missing": f"{name} must be given",
        "extra_forbidden": f"{name} must be left out: it is no field here",
        "value": f"{name} {message}",
        "value_error": f"{name} {message.removeprefix('Value error, ')}",
        "literal_error": f"{name} must be {limits.get('expected')}, got {shown}",
        "enum": f"{name} must be {limits.get('expected')}, got {shown}",
        "too_long": f"{name} must have at most {_counted(limits.get('max_length'), 'item')}, got {count}",
        "too_short": f"{name} must have at least {_counted(limits.get('min_length'), 'item')}, got {count}",
        "string_too_long": f"{name} must have at most {_counted(limits.get('max_length'), 'character')}, got {count}",
        "string_too_short": f"{name} must have at least {_counted(limits.get('min_length'), 'character')}, got {count}",
        "string_pattern_mismatch": f"{name} must match {limits.get('pattern')}, got {shown}",
        "greater_than": f"{name} must be > {limits.get('gt')}, got {plain}",
        "greater_than_equal": f"{name} must be >= {limits.get('ge')}, got {plain}",
        "less_than": f"{name} must be < {limits.get('lt')}, got {plain}",
        "less_than_equal": f"{name} must be <= {limits.get('le')}, got {plain}",
    }
    if kind in _KINDS:
        return f"{name} must be {_KINDS[kind]}, got {shown}"
    return sentences.get(kind, f"{name}: {message}, got {shown}")


def _counted(number: int | None, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _shown(value: Any) -> str:
    """Return how a value looks, of a long one the beginning; what is missing in a body comes with the whole body."""
    text = ""
    for piece in _pieces(value):
        text += piece
        if len(text) > _LONGEST_SHOWN:
            return text[: _LONGEST_SHOWN - 3] + "..."
    return text


def _pieces(value: Any) -> Iterator[str]:
    """Yield the ``repr`` of a JSON value piece by piece; a text is cut, but not so short that it could be shown whole."""
    if isinstance(value, dict):
        yield "{"
        for number, (key, child) in enumerate(value.items()):
            yield ", " if number else ""
            yield from _pieces(key)
            yield ": "
            yield from _pieces(child)
        yield "}"
    elif isinstance(value, list):
        yield "["
        for number, child in enumerate(value):
            yield ", " if number else ""
            yield from _pieces(child)
        yield "]"
    else:
        yield repr(value[: _LONGEST_SHOWN + 1] if isinstance(value, str) else value)
