"""Servotune for scripts: connect to a service, then simulate, identify, validate and optimise servo drives through it.

Examples
--------
::

    import servotune

    client = servotune.connect("http://127.0.0.1:8000", key="...")  # or `servotune login`
    reply = client.simulate(document, input={"port": "reference", "signal": {"kind": "step"}})
    print(reply.metrics["position"].overshoot)  # reply["variants"][0]["metrics"] is the same
    reply.plot()
    reply.to_pandas()
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from servotune.algebra import Part, block, feedback, from_control, gain, parallel, series, tf
from servotune.building import System, quantity
from servotune.client import Client, connect
from servotune.errors import (
    ApiError,
    ConflictError,
    DocumentError,
    FieldError,
    ForbiddenError,
    InvalidRequestError,
    JobCancelledError,
    JobFailedError,
    NotFoundError,
    PreconditionFailedError,
    ServerError,
    ServiceUnreachableError,
    ServotuneError,
    TooLargeError,
    TooManyRequestsError,
    UnauthorizedError,
    UnexpectedReplyError,
    VersionWarning,
    WaitTimeoutError,
)
from servotune.jobs import Job
from servotune.local import local
from servotune.progress import ProgressBar

if TYPE_CHECKING:
    from servotune.asynchronous import AsyncClient

__all__ = [
    "ApiError",
    "AsyncClient",
    "Client",
    "ConflictError",
    "DocumentError",
    "FieldError",
    "ForbiddenError",
    "InvalidRequestError",
    "Job",
    "JobCancelledError",
    "JobFailedError",
    "NotFoundError",
    "Part",
    "PreconditionFailedError",
    "ProgressBar",
    "ServerError",
    "ServiceUnreachableError",
    "ServotuneError",
    "System",
    "TooLargeError",
    "TooManyRequestsError",
    "UnauthorizedError",
    "UnexpectedReplyError",
    "VersionWarning",
    "WaitTimeoutError",
    "block",
    "connect",
    "feedback",
    "from_control",
    "gain",
    "local",
    "parallel",
    "quantity",
    "series",
    "tf",
]


def __getattr__(name: str) -> Any:
    """Load what few scripts need, and what brings an event loop, where it is asked for."""
    if name == "AsyncClient":
        from servotune.asynchronous import AsyncClient  # noqa: PLC0415 - as said above

        return AsyncClient
    raise AttributeError(f"module 'servotune' has no attribute {name!r}")
