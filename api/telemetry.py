"""Traces for OpenTelemetry, where `SERVOTUNE_OTLP_ENDPOINT` says that somebody collects them; the extra `telemetry` has the libraries."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version
from typing import TYPE_CHECKING

from api.settings import Settings

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
    if settings.otlp_endpoint is None:
        return OFF, lambda: None
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter  # noqa: PLC0415 - an extra
        from opentelemetry.sdk.resources import Resource  # noqa: PLC0415 - as above
        from opentelemetry.sdk.trace import TracerProvider  # noqa: PLC0415 - as above
        from opentelemetry.sdk.trace.export import BatchSpanProcessor  # noqa: PLC0415 - as above
    except ModuleNotFoundError as error:
        raise SystemExit(
            f"SERVOTUNE_OTLP_ENDPOINT must be left out without the extra servotune[telemetry], {error.name} is missing"
        ) from error
    resource = Resource.create({"service.name": "servotune", "service.version": version("servotune")})
    provider = TracerProvider(resource=resource)
    endpoint = settings.otlp_endpoint.rstrip("/") + "/v1/traces"
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter(endpoint=endpoint)))
    return {"tracer_provider": provider, "metrics": False, "logs": False}, provider.shutdown
