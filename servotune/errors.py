"""What can go wrong between a script and the service, each with the words that the service itself gave."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


class ServotuneError(Exception):
    """Anything this library raises on purpose; catch it to catch them all."""


class VersionWarning(UserWarning):
    """Client and service are of different versions."""


class ServiceUnreachableError(ServotuneError):
    """No answer from the service: wrong address, not started, or the network is down."""


class UnexpectedReplyError(ServotuneError):
    """An answer that is not the service's: another program listens there, or a proxy stands between."""


class DocumentError(ServotuneError, ValueError):
    """A value that cannot be sent: a number that is not finite, or what JSON has no word for; the text says where."""


class WaitTimeoutError(ServotuneError, TimeoutError):
    """The job is still running after the time that the caller was ready to wait; it goes on running."""


@dataclass(frozen=True, slots=True)
class FieldError:
    """One place of the request body that the service refused."""

    pointer: str
    detail: str


class ApiError(ServotuneError):
    """A refusal by the service: the `application/problem+json` document of RFC 9457, typed.

    Attributes
    ----------
    status : int
        HTTP status code.
    type : str
        URI reference that names the kind of problem.
    title, detail : str
        What went wrong, in general and this time.
    errors : tuple of FieldError
        The places of the request body that are wrong, as JSON pointers from its root.
    """

    def __init__(self, *, status: int, problem: Mapping[str, Any], request: str = "") -> None:
        self.status = status
        self.type = str(problem.get("type", "about:blank"))
        self.title = str(problem.get("title", ""))
        self.detail = str(problem.get("detail", ""))
        self.errors = _field_errors(problem.get("errors"))
        self.request = request
        self.problem = dict(problem)
        super().__init__(str(self))

    def __str__(self) -> str:
        what = ": ".join(part for part in (self.title, self.detail) if part) or "refused without a reason"
        head = f"{self.status} {what}" + (f" ({self.request})" if self.request else "")
        return "\n".join([head, *(f"  {error.pointer or '/'}: {error.detail}" for error in self.errors)])


class UnauthorizedError(ApiError):
    """The key is missing or unknown (401)."""


class ForbiddenError(ApiError):
    """The key is known and does not allow this (403)."""


class NotFoundError(ApiError):
    """No such resource (404)."""


class ConflictError(ApiError):
    """The resource's state does not allow this now (409)."""


class PreconditionFailedError(ApiError):
    """Somebody else changed the document (412), or the request did not say which one it changes (428)."""


class TooLargeError(ApiError):
    """More than the service takes (413)."""


class InvalidRequestError(ApiError):
    """The document is wrong; `errors` says where (422)."""


class TooManyRequestsError(ApiError):
    """Too many requests, even after waiting as the service asked (429)."""


class ServerError(ApiError):
    """The service failed (5xx)."""


class JobFailedError(ApiError):
    """The job ended without a result; the problem document says why."""


class JobCancelledError(ServotuneError):
    """The job was cancelled before it had a result."""


_BY_STATUS: Mapping[int, type[ApiError]] = {
    401: UnauthorizedError,
    403: ForbiddenError,
    404: NotFoundError,
    409: ConflictError,
    412: PreconditionFailedError,
    413: TooLargeError,
    422: InvalidRequestError,
    428: PreconditionFailedError,
    429: TooManyRequestsError,
}


def api_error(status: int, problem: Mapping[str, Any], request: str) -> ApiError:
    """Return the exception that fits a status code."""
    kind = _BY_STATUS.get(status, ServerError if status >= 500 else ApiError)
    return kind(status=status, problem=problem, request=request)


def _field_errors(entries: object) -> tuple[FieldError, ...]:
    if not isinstance(entries, Sequence) or isinstance(entries, str):
        return ()
    return tuple(
        FieldError(pointer=str(entry.get("pointer", "")), detail=str(entry.get("detail", "")))
        for entry in entries
        if isinstance(entry, Mapping)
    )
