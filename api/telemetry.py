"""How the application traces its requests, where `SERVOTUNE_OTLP_ENDPOINT` says that somebody collects traces."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from api.settings import Settings
from api.tracing import provider_of

if TYPE_CHECKING:
    from fastapi.telemetry import TelemetryConfig

#: What an application does that nobody collects traces of.
OFF: TelemetryConfig = {"tracing": False, "metrics": False, "logs": False}


def configured(settings: Settings) -> tuple[TelemetryConfig, Callable[[], None]]:
    """Return how the application is to trace its requests, and what sends the last traces off when it ends.

    Raises
    ------
    SystemExit
        When traces are wanted and the libraries for them are not installed.
    """
    provider = provider_of(settings, "servotune")
    if provider is None:
        return OFF, lambda: None
    return {"tracer_provider": provider, "metrics": False, "logs": False}, provider.shutdown
