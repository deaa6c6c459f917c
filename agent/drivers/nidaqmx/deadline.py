"""A deadline on every call to a device server: nidaqmx sends none, and a frozen server would hold the agent for ever."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable
from typing import Any

import grpc

_Details = namedtuple("_Details", "method timeout metadata credentials wait_for_ready compression")  # noqa: PYI024 - gRPC wants attributes, and compares nothing


class _CallDetails(_Details, grpc.ClientCallDetails):
    """What gRPC is told of a call."""


class Deadline(grpc.UnaryUnaryClientInterceptor):
    """Gives every call its own timeout and some seconds more.

    Parameters
    ----------
    margin : float
        s beyond what the call itself may wait for.
    """

    def __init__(self, margin: float) -> None:
        self._margin = margin

    def intercept_unary_unary(self, continuation: Callable[[Any, Any], Any], details: Any, request: Any) -> Any:
        """Make the call."""
        asked = getattr(request, "timeout", None) or getattr(request, "time_to_wait", None) or 0.0
        limit = max(float(asked), 0.0) + self._margin
        told = _CallDetails(details.method, limit, details.metadata, details.credentials, None, None)
        return continuation(told, request)


def channel(server: str, *, margin: float) -> Any:
    """Return a channel to a device server, without limits on the size of a message."""
    options = [
        ("grpc.max_receive_message_length", -1),
        ("grpc.max_send_message_length", -1),
        # A server that is back after a while is found within a second, not within two minutes.
        ("grpc.initial_reconnect_backoff_ms", 200),
        ("grpc.min_reconnect_backoff_ms", 200),
        ("grpc.max_reconnect_backoff_ms", 1000),
    ]
    return grpc.intercept_channel(grpc.insecure_channel(server, options=options), Deadline(margin))
