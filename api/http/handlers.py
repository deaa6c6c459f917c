"""Every answer of 400 or more leaves as application/problem+json: what FastAPI calls for each exception."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Iterator, Mapping, Sequence, Sized
from difflib import get_close_matches
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response
from starlette.exceptions import HTTPException
from starlette.routing import Match

from api.problems.documents import MEDIA_TYPE, Fault, Problem, invalid_document
from api.problems.exceptions import KNOWN, RecalledError, problem_of
from api.problems.pointers import place_in

_log = logging.getLogger("servotune.api")
_MOST_FAULTS = 50
_LONGEST_SHOWN = 80
#: Of a request whose client did not wait for the answer.
_LEFT = 499
_METHODS = ("GET", "POST", "PUT", "PATCH", "DELETE")


def problem_response(problem: Problem) -> Response:
    """Return the response that carries a problem."""
    return Response(
        json.dumps(problem.document(), ensure_ascii=False, allow_nan=False).encode("utf-8", errors="replace"),
        status_code=problem.status,
        headers=problem.headers,
        media_type=MEDIA_TYPE,
    )


def _fault(error: dict[str, Any], body: Any) -> Fault:
    where, *location = error["loc"]
    kind = error["type"]
    if where != "body":
        name = f"{where} parameter {'.'.join(str(part) for part in location)}"
        return Fault(place=(), detail=sentence(name, error))
    if kind == "json_invalid":
        at = f" (character {location[0]})" if location else ""
        return Fault(place=(), detail=f"the body must be JSON: {error['ctx']['error']}{at}")
    if not isinstance(body, dict):
        return Fault(place=(), detail="the body must be a JSON object sent with Content-Type: application/json")
    place = place_in(body, location, names_a_field=kind in {"missing", "extra_forbidden"})
    name = _name(place)
    if kind in {"union_tag_invalid", "union_tag_not_found"} and isinstance(error.get("input"), dict):
        expected = error.get("ctx", {}).get("expected_tags", "")
        got = error["input"].get("kind")
        near = get_close_matches(got, re.findall(r"'(.*?)'", expected), n=1) if isinstance(got, str) else []
        meant = f" (was {near[0]!r} meant?)" if near else ""
        detail = f"kind must be one of {expected or 'the catalogue'}, got {_shown(got)}{meant}"
        return Fault(place=(*place, "kind"), detail=detail)
    return Fault(place=place, detail=sentence(name, error))


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


def validation_problem(errors: Sequence[Any], body: Any) -> Problem:
    """Return the 422 for what pydantic found."""
    return invalid_document([_fault(dict(error), body) for error in errors[:_MOST_FAULTS]])


def _let_go(error: BaseException) -> None:
    """Let go of the frames that an answered error has passed: they and the error hold each other, with the whole document in them."""
    pending: list[BaseException | None] = [error]
    seen: set[int] = set()  # causes may lead in a ring
    while pending:
        one = pending.pop()
        if one is not None and id(one) not in seen:
            seen.add(id(one))
            one.__traceback__ = None
            pending += (one.__cause__, one.__context__)


def _on_invalid(_: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    response = problem_response(validation_problem(error.errors(), error.body))
    _let_go(error)
    return response


def _allowed(request: Request) -> set[str]:
    """Return the methods that an address answers: several routes have the same one, and the router asks only the first."""
    scopes = ((method, {**request.scope, "method": method}) for method in _METHODS)
    return {
        method
        for method, scope in scopes
        if any(route.matches(scope)[0] is Match.FULL for route in request.app.router.routes)
    }


def _on_http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    kind = HTTPStatus(error.status_code).phrase.lower().replace(" ", "-")
    headers = dict(error.headers or {})
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        headers["Allow"] = ", ".join(sorted({*headers.get("Allow", "").split(", "), *_allowed(request)} - {""}))
    known = {404: "no such path", 405: f"the method must be one of {headers.get('Allow')} here, got {request.method}"}
    own = error.detail != HTTPStatus(error.status_code).phrase
    detail = error.detail if own else known.get(error.status_code, error.detail)
    _let_go(error)
    return problem_response(Problem(error.status_code, kind, detail, headers=headers))


def _on_known(_: Request, error: Exception) -> Response:
    problem = problem_of(error)
    assert problem is not None
    _let_go(error)
    return problem_response(problem)


def _on_recalled(_: Request, __: Exception) -> Response:
    return Response(status_code=_LEFT)  # nobody reads it; it is counted


def _on_unknown(request: Request, error: Exception) -> Response:
    number = request.state.request_id
    _log.error("request %s, %s %s, failed", number, request.method, request.url.path, exc_info=error)
    return problem_response(
        Problem(
            500,
            "internal-error",
            f"the service failed on this request; its log says where, under {number}",
            headers={"Connection": "close"},  # the server does so: whoever asks again must not use this one
        )
    )


def install(app: FastAPI) -> None:
    """Let ``app`` answer every error with a problem document."""
    app.add_exception_handler(RequestValidationError, _on_invalid)
    app.add_exception_handler(HTTPException, _on_http)
    for kind in KNOWN:
        app.add_exception_handler(kind, _on_known)
    app.add_exception_handler(RecalledError, _on_recalled)
    app.add_exception_handler(Exception, _on_unknown)
