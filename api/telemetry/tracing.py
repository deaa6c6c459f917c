"""Spans for OpenTelemetry and how one trace holds whoever asked for a job and the attempts at it.

A job keeps the span in which it was asked for (W3C Trace Context), that of a request or of a schedule whose instant has come,
and every attempt of a worker at the job is a child of that span: one trace shows who asked, how long the job waited, and who
computed it. Where `SERVOTUNE_OTLP_ENDPOINT` does not say that somebody collects traces, nothing of this is loaded.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from typing import TYPE_CHECKING

from api.settings import Settings
from storage.models import Job, JobStatus, Schedule

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


class Traces:
    """What one process tells those who collect traces; by default, that nobody does.

    Parameters
    ----------
    provider : TracerProvider, optional
        What makes the spans of the process and sends them, also those of its requests.
    """

    def __init__(self, provider: TracerProvider | None = None) -> None:
        self.provider = provider

    @contextmanager
    def job(self, job: Job) -> Iterator[Callable[[str], None]]:
        """Trace one attempt at a job; takes the status in which the attempt leaves it."""
        attributes: dict[str, str | int] = {
            "servotune.job.id": job.parent_id or job.id,
            "servotune.job.kind": job.kind,
            "servotune.job.attempt": job.attempts,
        }
        if job.part is not None:
            attributes["servotune.job.part"] = job.part
        if job.request_id is not None:
            attributes["servotune.request.id"] = job.request_id
        with self._span(f"job {job.kind}", attributes, kind="CONSUMER", above=job.traceparent) as tell:
            yield tell

    @contextmanager
    def schedule(self, schedule: Schedule, *, request_id: str) -> Iterator[None]:
        """Trace how an instant of a schedule is dealt with; a job that it starts is below."""
        attributes: dict[str, str | int] = {
            "servotune.schedule.id": schedule.id,
            "servotune.job.kind": schedule.kind,
            "servotune.request.id": request_id,
        }
        with self._span(f"schedule {schedule.kind}", attributes, kind="PRODUCER", above=None):
            yield

    @contextmanager
    def _span(
        self, name: str, attributes: dict[str, str | int], *, kind: str, above: str | None
    ) -> Iterator[Callable[[str], None]]:
        if self.provider is None:
            yield lambda _status: None
            return
        from opentelemetry.context import Context  # noqa: PLC0415 - an extra
        from opentelemetry.trace import SpanKind, StatusCode  # noqa: PLC0415 - as above
        from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator  # noqa: PLC0415 - as above

        carrier = {} if above is None else {"traceparent": above}
        with self.provider.get_tracer("servotune").start_as_current_span(
            name,
            context=TraceContextTextMapPropagator().extract(carrier, context=Context()),
            kind=SpanKind[kind],
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

    def close(self) -> None:
        """Send the last traces off."""
        if self.provider is not None:
            self.provider.shutdown()


def traces_of(settings: Settings, process: str) -> Traces:
    """Return what a process, by this name, tells those who collect traces.

    Raises
    ------
    SystemExit
        When traces are wanted and the libraries for them are not installed.
    """
    if settings.otlp_endpoint is None:
        return Traces()
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter  # noqa: PLC0415 - an extra
        from opentelemetry.sdk.resources import Resource  # noqa: PLC0415 - as above
        from opentelemetry.sdk.trace import TracerProvider  # noqa: PLC0415 - as above
        from opentelemetry.sdk.trace.export import BatchSpanProcessor  # noqa: PLC0415 - as above
    except ModuleNotFoundError as error:
        raise SystemExit(
            f"SERVOTUNE_OTLP_ENDPOINT must be left out without the extra servotune-server[telemetry], {error.name} is missing"
        ) from error
    provider = TracerProvider(
        resource=Resource.create({"service.name": process, "service.version": version("servotune")})
    )
    endpoint = settings.otlp_endpoint.rstrip("/") + "/v1/traces"
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter(endpoint=endpoint)))
    return Traces(provider)
