"""What leaves the service with a status of 400 or more, as RFC 9457 problem documents, and the core's exceptions as such.

Conversions between the wire and the core need no more than this: no storage, no web framework.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from http import HTTPStatus
from typing import Any

from numpy.linalg import LinAlgError

from api.problems.pointers import Place, pointer
from engine.model.errors import EngineError, IllPosedError

MEDIA_TYPE = "application/problem+json"
_TYPE_BASE = "urn:servotune:problem:"
ILL_POSED = "ill-posed-loop"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One thing that is wrong in a document, and where."""

    place: Place
    detail: str


class Problem(Exception):  # noqa: N818 -- the name that RFC 9457 gives to the thing
    """An answer with a status of 400 or more.

    Parameters
    ----------
    status : int
        HTTP status.
    kind : str
        Last part of the ``type`` URI, e.g. "not-found".
    detail : str
        One sentence: the thing, the rule and the value got.
    faults : sequence of Fault
        What is wrong in the document, for 422.
    headers : mapping
        Headers that belong to the answer.
    extra : mapping
        Further members of the problem document.
    """

    def __init__(
        self,
        status: int,
        kind: str,
        detail: str,
        *,
        faults: Sequence[Fault] = (),
        headers: Mapping[str, str] | None = None,
        extra: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(detail)
        self.status = status
        self.kind = kind
        self.detail = detail
        self.faults = tuple(faults)
        self.headers = dict(headers or {})
        self.extra = dict(extra or {})

    def __reduce__(self) -> tuple[Any, ...]:
        given: dict[str, Any] = {"faults": self.faults, "headers": self.headers, "extra": self.extra}
        return partial(type(self), self.status, self.kind, self.detail, **given), ()

    def within(self, *prefix: str | int) -> Problem:
        """Return this problem with ``prefix`` put before the place of every fault."""
        self.faults = tuple(Fault(place=(*prefix, *fault.place), detail=fault.detail) for fault in self.faults)
        return self

    def document(self) -> dict[str, Any]:
        """Return the problem document."""
        body: dict[str, Any] = {
            "type": _TYPE_BASE + self.kind,
            "title": HTTPStatus(self.status).phrase,
            "status": self.status,
            "detail": self.detail,
            **self.extra,
        }
        if self.faults:
            body["errors"] = [{"pointer": pointer(fault.place), "detail": fault.detail} for fault in self.faults]
        return body


def invalid(detail: str, *place: str | int) -> Problem:
    """Return the 422 of a document with one fault at ``place``."""
    return Problem(422, "invalid-document", detail, faults=[Fault(place=place, detail=detail)])


def invalid_document(faults: Sequence[Fault]) -> Problem:
    """Return the 422 of a document with several faults."""
    first = faults[0].detail
    detail = first if len(faults) == 1 else f"{first} (and {len(faults) - 1} more, see errors)"
    return Problem(422, "invalid-document", detail, faults=faults)


CORE: tuple[type[Exception], ...] = (EngineError, LinAlgError)


def problem_of_core(error: Exception) -> Problem | None:
    """Return the problem that an exception of the core stands for, None for another."""
    if isinstance(error, IllPosedError):
        fault = Fault(place=error.at, detail=error.message)
        return Problem(422, ILL_POSED, error.message, faults=[fault], extra={"ports": list(error.ports)})
    if isinstance(error, EngineError):
        return invalid(error.message, *error.at)
    if isinstance(error, LinAlgError):
        detail = f"the system must have a response that float64 can resolve at these values, got: {error}"
        return Problem(422, "unresolved", detail, faults=[Fault(place=(), detail=detail)])
    return None


@contextmanager
def at(*prefix: str | int) -> Iterator[None]:
    """Turn errors of the core raised inside into problems whose places count from ``prefix``."""
    try:
        yield
    except (EngineError, Problem) as error:
        problem = error if isinstance(error, Problem) else problem_of_core(error)
        assert problem is not None
        raise problem.within(*prefix) from error
