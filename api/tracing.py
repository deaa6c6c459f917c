"""Spans for OpenTelemetry and how one trace holds a request and the jobs that it asked for.

A job keeps the span of the request that asked for it (W3C Trace Context), and every attempt of a worker at the job is a child
of that span: one trace shows the request, how long the job waited, and who computed it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from typing import TYPE_CHECKING

from api.settings import Settings
from storage.jobs.supervision import Traced, untraced
from storage.models import Job, JobStatus

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import TracerProvider


def traceparent() -> str | None:
    """Return the span that is open here, as W3C's Trace Context writes it; None where nothing is traced."""
    if "opentelemetry.sdk.trace" not in sys.modules:  # nobody collects: the libraries need not even be there
        return None
    from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator  # noqa: PLC0415 - an extra

    carrier: dict[str, str] = {}
    TraceContextTextMapPropagator().inject(carrier)
    return carrier.get("traceparent")


def traces_of_jobs(settings: Settings) -> tuple[Traced, Callable[[], None]]:
    """Return how a worker is to trace its jobs, and what sends the last traces off when it ends.

    Raises
    ------
    SystemExit
        When traces are wanted and the libraries for them are not installed.
    """
    provider = provider_of(settings, "servotune-worker")
    if provider is None:
        return untraced, lambda: None
    from opentelemetry.context import Context  # noqa: PLC0415 - an extra
    from opentelemetry.trace import SpanKind, StatusCode  # noqa: PLC0415 - as above
    from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator  # noqa: PLC0415 - as above

    tracer, propagator = provider.get_tracer("servotune"), TraceContextTextMapPropagator()

    @contextmanager
    def traced(job: Job) -> Iterator[Callable[[str], None]]:
        carrier = {} if job.traceparent is None else {"traceparent": job.traceparent}
        attributes: dict[str, str | int] = {
            "servotune.job.id": job.parent_id or job.id,
            "servotune.job.kind": job.kind,
            "servotune.job.attempt": job.attempts,
        }
        if job.part is not None:
            attributes["servotune.job.part"] = job.part
        if job.request_id is not None:
            attributes["servotune.request.id"] = job.request_id
        with tracer.start_as_current_span(
            f"job {job.kind}",
            context=propagator.extract(carrier, context=Context()),
            kind=SpanKind.CONSUMER,
            attributes=attributes,
            # What is wrong with a job is in its status; that a worker stops is no error of the job.
            record_exception=False,
            set_status_on_exception=False,
        ) as span:

            def tell(status: str) -> None:
                span.set_attribute("servotune.job.status", status)
                if status == JobStatus.FAILED:
                    span.set_status(StatusCode.ERROR)

            yield tell

    return traced, provider.shutdown


def provider_of(settings: Settings, service: str) -> TracerProvider | None:
    """Return what makes the spans of a process and sends them; None when nobody collects them.

    Raises
    ------
    SystemExit
        When they are wanted and the libraries for them are not installed.
    """
    if settings.otlp_endpoint is None:
        return None
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter  # noqa: PLC0415 - an extra
        from opentelemetry.sdk.resources import Resource  # noqa: PLC0415 - as above
        from opentelemetry.sdk.trace import TracerProvider  # noqa: PLC0415 - as above
        from opentelemetry.sdk.trace.export import BatchSpanProcessor  # noqa: PLC0415 - as above
    except ModuleNotFoundError as error:
        raise SystemExit(
            f"SERVOTUNE_OTLP_ENDPOINT must be left out without the extra servotune[telemetry], {error.name} is missing"
        ) from error
    resource = Resource.create({"service.name": service, "service.version": version("servotune")})
    provider = TracerProvider(resource=resource)
    endpoint = settings.otlp_endpoint.rstrip("/") + "/v1/traces"
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter(endpoint=endpoint)))
    return provider
