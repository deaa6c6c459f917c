"""Every answer of 400 or more leaves as application/problem+json: what FastAPI calls for each exception."""

from __future__ import annotations

import json
import logging
from http import HTTPStatus

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response
from starlette.exceptions import HTTPException
from starlette.routing import Match

from api.problems.documents import MEDIA_TYPE, Problem
from api.problems.exceptions import KNOWN, RecalledError, problem_of
from api.problems.faults import validation_problem

_log = logging.getLogger("servotune.api")
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
