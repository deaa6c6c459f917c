"""The span of an attempt at a job: below whoever asked for it, with the status in which the attempt leaves the job."""

from __future__ import annotations

import pytest
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest
from opentelemetry.proto.trace.v1.trace_pb2 import Span, Status

from api.settings import Settings
from api.telemetry.tracing import traceparent, traces_of
from storage.jobs.outcomes import Stopped
from storage.models import Job, Schedule
from tests.support.collecting import collector, spans_of

#: W3C Trace Context, section 3.2.
TRACE, CALLER = "4bf92f3577b34da6a3ce929d0e0e4736", "00f067aa0ba902b7"


def job(**fields: object) -> Job:
    return Job(id="job_1", kind="validation", attempts=2, **fields)


def test_attempts_are_spans_below_the_request() -> None:
    within: list[str | None] = []
    with collector() as (endpoint, received):
        traces = traces_of(Settings(otlp_endpoint=endpoint), "servotune-worker")
        with traces.job(job(traceparent=f"00-{TRACE}-{CALLER}-01", request_id="req-1")) as tell:
            within.append(traceparent())
            tell("failed")
        with traces.job(job(parent_id="job_0", part=3)) as tell:
            tell("succeeded")
        with pytest.raises(Stopped), traces.job(job(traceparent="nonsense")):
            raise Stopped
        traces.close()
    sent = [ExportTraceServiceRequest.FromString(body) for _, body in received]
    spans: list[Span] = [span for one in sent for part in one.resource_spans[0].scope_spans for span in part.spans]
    failed, shared, stopped = spans
    assert (failed.trace_id.hex(), failed.parent_span_id.hex()) == (TRACE, CALLER)
    assert within == [f"00-{TRACE}-{failed.span_id.hex()}-01"]
    assert failed.status.code == Status.STATUS_CODE_ERROR
    # Without a request, or with one that cannot be read, a trace of its own.
    assert [span.parent_span_id for span in (shared, stopped)] == [b"", b""]
    told = {item.key: item.value.string_value or item.value.int_value for item in shared.attributes}
    assert told == {
        "servotune.job.id": "job_0",
        "servotune.job.kind": "validation",
        "servotune.job.attempt": 2,
        "servotune.job.part": 3,
        "servotune.job.status": "succeeded",
    }
    assert [span.status.code for span in (shared, stopped)] == [Status.STATUS_CODE_UNSET] * 2


def test_a_job_of_a_schedule_is_below_the_occasion_on_which_it_was_started() -> None:
    schedule = Schedule(id="sch_1", kind="validation")
    with collector() as (endpoint, received):
        traces = traces_of(Settings(otlp_endpoint=endpoint), "servotune")
        with traces.schedule(schedule, request_id="tick_1"):
            asked = job(traceparent=traceparent(), request_id="tick_1")
        with traces.job(asked) as tell:
            tell("succeeded")
        traces.close()
    assert asked.traceparent is not None
    spans = {span.name: span for span in spans_of(received, asked.traceparent.split("-")[1]).values()}
    occasion, attempt = spans["schedule validation"], spans["job validation"]
    assert (occasion.parent_span_id, attempt.parent_span_id) == (b"", occasion.span_id)
    assert {item.key: item.value.string_value for item in occasion.attributes} == {
        "servotune.schedule.id": "sch_1",
        "servotune.job.kind": "validation",
        "servotune.request.id": "tick_1",
    }


def test_nothing_is_traced_where_nobody_collects() -> None:
    traces = traces_of(Settings(otlp_endpoint=None), "servotune")
    assert traces.provider is None
    with traces.job(job()) as tell:
        tell("failed")
        assert traceparent() is None
    traces.close()
