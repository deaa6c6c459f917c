"""One table from exception to problem: the core's, and those of storage.

Everything that leaves the service with a status of 400 or more is a :class:`api.problems.documents.Problem`; exceptions become
one through :func:`problem_of`. No web framework here: workers and services use the same table.
"""

from __future__ import annotations

from collections.abc import Mapping

from api.problems.documents import CORE, Problem, problem_of_core
from storage.errors import (
    UNAVAILABLE,
    CancelledError,
    ChecksumError,
    DamagedBlobError,
    DocumentError,
    IdempotencyMismatchError,
    IdempotencyRunningError,
    InvalidCursorError,
    LeaseLostError,
    LeftOutError,
    MissingSegmentsError,
    NotFoundError,
    QuotaExceededError,
    RevisionConflictError,
    StateError,
    StorageError,
    VaultError,
    why_unavailable,
)


class RecalledError(Exception):
    """A computation was ended, or did not begin, because nobody waits for it any more: there is nobody to tell."""


#: Storage's exceptions: status and the last part of the type URI.
_STORAGE: Mapping[type[StorageError], tuple[int, str]] = {
    NotFoundError: (404, "not-found"),
    LeftOutError: (410, "original-left-out"),
    RevisionConflictError: (412, "revision-conflict"),
    CancelledError: (409, "cancelled"),
    LeaseLostError: (409, "lease-lost"),
    StateError: (409, "conflict"),
    MissingSegmentsError: (409, "missing-segments"),
    ChecksumError: (422, "checksum-mismatch"),
    DamagedBlobError: (503, "damaged-blob"),
    DocumentError: (422, "invalid-document"),
    InvalidCursorError: (422, "invalid-cursor"),
    IdempotencyMismatchError: (422, "idempotency-key-reused"),
    IdempotencyRunningError: (409, "idempotency-key-in-use"),
    QuotaExceededError: (403, "quota-exceeded"),
    VaultError: (409, "secret-key"),
}
#: Everything that :func:`problem_of` has an answer for.
KNOWN: tuple[type[Exception], ...] = (Problem, *CORE, *_STORAGE, *UNAVAILABLE)


def problem_of(error: Exception) -> Problem | None:
    """Return the problem that an exception stands for, None for one that nobody foresaw."""
    if isinstance(error, Problem):
        return error
    core = problem_of_core(error)
    return core if core is not None else _storage_problem(error)


def _storage_problem(error: Exception) -> Problem | None:
    if isinstance(error, UNAVAILABLE):
        return Problem(503, "unavailable", f"{why_unavailable(error)}; try again later", headers={"Retry-After": "5"})
    if isinstance(error, QuotaExceededError):
        return _quota_problem(error)
    for kind, (status, name) in _STORAGE.items():
        if isinstance(error, kind):
            extra = {"missing": list(error.missing)} if isinstance(error, MissingSegmentsError) else {}
            headers = {"Retry-After": "1"} if isinstance(error, IdempotencyRunningError) else {}
            return Problem(status, name, str(error), headers=headers, extra=extra)
    return None


def _quota_problem(error: QuotaExceededError) -> Problem:
    """Return 429 for what passes by itself (jobs end), 403 for what does not."""
    headers = {"RateLimit-Policy": f'"{error.name}";q={error.limit}', "RateLimit": f'"{error.name}";r=0'}
    extra = {"quota": error.name, "limit": error.limit, "used": error.used}
    if error.name == "jobs":
        return Problem(429, "quota-exceeded", str(error), headers={**headers, "Retry-After": "10"}, extra=extra)
    return Problem(403, "quota-exceeded", str(error), headers=headers, extra=extra)
