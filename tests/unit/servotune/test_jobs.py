"""Watching a job: the stream, its interruptions, and what is raised when there is no result."""

from __future__ import annotations

import pytest

import servotune
from servotune.events import Event, parse
from tests.unit.servotune.conftest import Answer, Asked, Service

STREAM = {"Content-Type": "text/event-stream"}


def job(status: str, **more: object) -> dict[str, object]:
    return {"id": "job_1", "kind": "optimization", "status": status, "progress": 0.0, "message": ""} | more


def watched(service: Service, *streams: bytes | Answer, end: dict[str, object]) -> None:
    """Serve a job that runs until every stream has been read, one after the other, and then has ended as told."""
    left = [stream if isinstance(stream, Answer) else Answer(stream, headers=STREAM) for stream in streams]
    service.on("GET /v1/jobs/job_1/events", lambda _: left.pop(0))
    service.on("GET /v1/jobs/job_1", lambda _: Answer(job("running") if left else end))
    service.on("GET /v1/jobs/job_1/result", Answer({"status": "converged"}))


def test_the_result_comes_after_the_last_event(service: Service, client: servotune.Client):
    events = b'id: 1\nevent: progress\ndata: 0.5\n\nid: 2\nevent: message\ndata: "grid"\n\nid: 3\nevent: status\ndata: "succeeded"\n\n'
    watched(service, events, end=job("succeeded", result="/v1/jobs/job_1/result", progress=1.0))
    seen: list[tuple[float, str]] = []
    result = client.jobs.get("job_1").wait(progress=lambda fraction, message: seen.append((fraction, message)))
    assert result == {"status": "converged"}
    assert seen == [(0.5, ""), (0.5, "grid"), (0.5, "grid")]


def test_events_may_be_objects(service: Service, client: servotune.Client):
    events = b'id: 1\nevent: progress\ndata: {"progress": 0.25, "message": "halving"}\n\n'
    watched(service, events, end=job("succeeded"))
    seen: list[tuple[float, str]] = []
    client.jobs.get("job_1").wait(progress=lambda fraction, message: seen.append((fraction, message)))
    assert seen == [(0.25, "halving")]


def test_a_stream_that_breaks_off_resumes_after_the_last_event(service: Service, client: servotune.Client):
    first, second = b"id: 7\nevent: progress\ndata: 0.5\n\n", b"id: 8\nevent: progress\ndata: 0.75\n\n"
    watched(service, first, Answer(cut=True), second, end=job("succeeded"))
    fractions: list[float] = []
    client.jobs.get("job_1").wait(progress=lambda fraction, _: fractions.append(fraction))
    assert fractions == [0.5, 0.75]
    asked = [request.headers.get("Last-Event-ID") for request in service.asked if request.path.endswith("/events")]
    assert asked == [None, "7", "7"]


def test_a_failed_job_raises_its_problem(service: Service, client: servotune.Client):
    problem = {"status": 422, "title": "No progress", "detail": "all starts are unstable"}
    watched(service, end=job("failed", error=problem))
    with pytest.raises(servotune.JobFailedError, match="No progress: all starts are unstable") as caught:
        client.jobs.get("job_1").wait()
    assert caught.value.problem == problem


def test_a_cancelled_job_has_no_result(service: Service, client: servotune.Client):
    service.on("POST /v1/jobs/job_1/cancel", Answer(job("cancelled"), status=202))
    watched(service, end=job("cancelled"))
    cancelled = client.jobs.get("job_1").cancel()
    assert cancelled.done
    with pytest.raises(servotune.JobCancelledError, match=r"job_1 \(optimization\) was cancelled"):
        cancelled.result()


def test_waiting_ends_at_the_timeout_while_the_stream_only_says_that_it_lives(
    service: Service, client: servotune.Client
):
    service.on("GET /v1/jobs/job_1", Answer(job("running", progress=0.3)))
    service.on("GET /v1/jobs/job_1/events", Answer(b": still here\n\n" * 100, headers=STREAM))
    with pytest.raises(servotune.WaitTimeoutError, match=r"still running \(30% done\)"):
        client.jobs.get("job_1").wait(timeout=0.2)


def test_a_refused_stream_is_an_error_not_an_endless_loop(service: Service, client: servotune.Client):
    service.on("GET /v1/jobs/job_1", Answer(job("running")))
    service.on("GET /v1/jobs/job_1/events", Answer({"title": "No key"}, status=401))
    with pytest.raises(servotune.UnauthorizedError):
        client.jobs.get("job_1").wait()


def test_an_optimisation_starts_a_job(service: Service, client: servotune.Client):
    def accept(asked: Asked) -> Answer:
        assert asked.headers["Idempotency-Key"]
        return Answer(job("queued"), status=202, headers={"Location": "/v1/jobs/job_1"})

    service.on("POST /v1/optimizations", accept)
    started = client.optimize("sys_1", variables=[{"parameter": "kp"}], goals=[], method={"kind": "grid"})
    assert (started.id, started.status, started.done) == ("job_1", "queued", False)


def test_what_an_optimisation_must_serve_goes_with_it(service: Service, client: servotune.Client):
    service.on("POST /v1/optimizations", Answer(job("queued"), status=202, headers={"Location": "/v1/jobs/job_1"}))
    extras = {
        "across_scenarios": "mean",
        "uncertain": [{"parameter": "m", "lower": 1, "upper": 2}],
        "yield_samples": 100,
        "cross_check": ["grid"],
        "alternatives": [{"name": "a"}, {"name": "b", "add": {"parameters": {"k": {"value": 2}}}}],
    }
    client.optimize("sys_1", variables=[{"parameter": "kp"}], goals=[], method={"kind": "grid"}, **extras)
    sent = service.asked[-1].json
    assert {key: sent[key] for key in extras} == extras
    assert set(sent) == {"system", "variables", "goals", "method", *extras}


def test_a_job_gives_its_script(service: Service, client: servotune.Client):
    service.on("GET /v1/jobs/job_1", Answer(job("succeeded")))
    service.on("GET /v1/jobs/job_1/script", Answer(b"import servotune\n", headers={"Content-Type": "text/x-python"}))
    assert client.jobs.get("job_1").script() == "import servotune\n"


def test_a_job_gives_its_request(service: Service, client: servotune.Client):
    service.on("GET /v1/jobs/job_1", Answer(job("succeeded")))
    service.on("GET /v1/jobs/job_1/request", Answer({"variables": [{"parameter": "kp"}]}))
    assert client.jobs.get("job_1").request() == {"variables": [{"parameter": "kp"}]}


def test_events_follow_the_html_standard():
    # The second and third examples of the HTML standard, section 9.2.6 (Interpreting an event stream).
    lines = [
        ": test stream",
        "",
        "data: first event",
        "id: 1",
        "",
        "data:second event",
        "id",
        "",
        "data:  third event",
        "",
    ]
    assert list(parse(lines)) == [
        Event(name="message", data="first event", id="1"),
        Event(name="message", data="second event", id=""),
        Event(name="message", data=" third event", id=""),
    ]
    assert list(parse(["data: YHOO", "data: +2", "data: 10", ""])) == [Event(name="message", data="YHOO\n+2\n10")]
    assert list(parse(["data: broken off"])) == []


def test_what_an_identification_takes_is_told_without_a_job(service, client) -> None:
    cost = {"evaluations": 18, "seconds": 2.5, "bytes": 4e7}
    service.on("POST /v1/identifications", Answer({"expected": cost, "warnings": []}))
    asked = {"dataset": "ds_1", "inputs": {"u": "u"}, "outputs": {"y": "y"}, "starts": 2}
    assert client.expected_cost("sys_1", parameters=["gain"], offsets=None, **asked) == {
        "expected": cost,
        "warnings": [],
    }
    assert service.asked[0].path == "/v1/identifications?dry_run=true"
    assert service.asked[0].json == {"system": "sys_1", "parameters": ["gain"], **asked}
    assert "Idempotency-Key" not in service.asked[0].headers
