"""A deadline on every call to a device server: nidaqmx sends none, and a frozen server would hold the agent for ever."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable
from typing import Any

import grpc

from agent.drivers.nidaqmx.settings import NidaqmxSettings

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


def channel(settings: NidaqmxSettings) -> Any:
    """Return a channel to a device server, without limits on the size of a message; secure where certificates are given."""
    options: list[tuple[str, Any]] = [
        ("grpc.max_receive_message_length", -1),
        ("grpc.max_send_message_length", -1),
        # A server that is back after a while is found within a second, not within two minutes.
        ("grpc.initial_reconnect_backoff_ms", 200),
        ("grpc.min_reconnect_backoff_ms", 200),
        ("grpc.max_reconnect_backoff_ms", 1000),
    ]
    if settings.server_name:
        options.append(("grpc.ssl_target_name_override", settings.server_name))
    if settings.secure:
        credentials = grpc.ssl_channel_credentials(
            settings.pem("ca"), settings.pem("private_key"), settings.pem("certificate")
        )
        made = grpc.secure_channel(settings.server, credentials, options=options)
    else:
        made = grpc.insecure_channel(settings.server, options=options)
    return grpc.intercept_channel(made, Deadline(settings.deadline))
