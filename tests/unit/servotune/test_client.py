"""What the client sends, and what it makes of the answers."""

from __future__ import annotations

import socket
import warnings
from datetime import UTC, datetime
from importlib.metadata import version

import pytest

import servotune
from tests.unit.servotune.conftest import Answer, Asked, Service


def test_every_request_carries_the_key(service: Service, client: servotune.Client):
    service.on("GET /readyz", Answer({"checks": {"worker": "ok"}}))
    assert client.ready() == {"checks": {"worker": "ok"}}
    assert service.asked[0].headers["Authorization"] == "Bearer secret"


@pytest.mark.parametrize(
    ("service_version", "warned"), [("99.1.0", True), (None, False), ("same", False), ("same.9", False)]
)
def test_a_service_of_another_version_is_warned_of_once(
    service: Service, client: servotune.Client, service_version: str | None, warned: bool
):
    own = ".".join(version("servotune").split(".")[:2])
    told = {} if service_version is None else {"Servotune-Version": service_version.replace("same", f"{own}.7")}
    service.on("GET /v1/jobs/job_1", Answer({"id": "job_1"}, headers=told))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        client.jobs.get("job_1")
        client.jobs.get("job_1")
    said = [str(one.message) for one in caught if one.category is servotune.VersionWarning]
    assert len(said) == warned
    if warned:
        assert "is of version 99.1.0" in said[0]
        assert "pip install 'servotune==99.1.0'" in said[0]


def test_absent_arguments_are_left_to_the_service(service: Service, client: servotune.Client):
    service.on("POST /v1/simulations", Answer({"variants": []}))
    client.simulate("sys_1", input={"port": "reference", "signal": {"kind": "step"}}, samples=10)
    assert service.asked[0].json == {
        "system": "sys_1",
        "input": {"port": "reference", "signal": {"kind": "step"}},
        "samples": 10,
    }


def test_an_influence_study_takes_a_duration(service: Service, client: servotune.Client):
    service.on("POST /v1/influence", Answer({"elasticities": {}}))
    client.influence("sys_1", input="u", output="y", parameters=["k"], metrics=["overshoot"], duration=1.2)
    assert service.asked[0].json["duration"] == 1.2


def test_the_python_keyword_from_has_an_underscore(service: Service, client: servotune.Client):
    service.on("POST /v1/frequency-responses", Answer({"variants": []}))
    client.frequency_response("sys_1", from_="reference", to="position")
    assert service.asked[0].json == {"system": "sys_1", "from": "reference", "to": "position"}


def test_a_refused_document_says_where(service: Service, client: servotune.Client):
    problem = {
        "type": "/problems/invalid-document",
        "title": "Invalid document",
        "status": 422,
        "detail": "1 place is wrong",
        "errors": [{"pointer": "/blocks/motor/area", "detail": "area must be positive m², got -1"}],
    }
    service.on("POST /v1/systems", Answer(problem, status=422, headers={"Content-Type": "application/problem+json"}))
    with pytest.raises(servotune.InvalidRequestError) as caught:
        client.systems.create({"name": "x"})
    assert caught.value.errors == (servotune.FieldError("/blocks/motor/area", "area must be positive m², got -1"),)
    assert str(caught.value) == (
        "422 Invalid document: 1 place is wrong (POST /v1/systems)\n"
        "  /blocks/motor/area: area must be positive m², got -1"
    )


@pytest.mark.parametrize(
    ("status", "kind"),
    [
        (401, servotune.UnauthorizedError),
        (403, servotune.ForbiddenError),
        (404, servotune.NotFoundError),
        (409, servotune.ConflictError),
        (412, servotune.PreconditionFailedError),
        (413, servotune.TooLargeError),
        (428, servotune.PreconditionFailedError),
        (500, servotune.ServerError),
        (418, servotune.ApiError),
    ],
)
def test_each_status_has_its_exception(
    service: Service, client: servotune.Client, status: int, kind: type[servotune.ApiError]
):
    service.on("GET /v1/systems/sys_1", Answer({"title": "No", "detail": "because"}, status=status))
    with pytest.raises(kind) as caught:
        client.systems.get("sys_1")
    assert type(caught.value) is kind
    assert (caught.value.status, caught.value.detail) == (status, "because")


def test_an_answer_of_another_program_is_named(service: Service, client: servotune.Client):
    service.on("GET /v1/systems/sys_1", Answer(b"<html>", headers={"Content-Type": "text/html"}))
    with pytest.raises(servotune.UnexpectedReplyError, match="is this a Servotune service"):
        client.systems.get("sys_1")


def test_a_busy_service_is_asked_again_under_the_same_idempotency_key(service: Service, client: servotune.Client):
    def busy_once(_: Asked) -> Answer:
        if len(service.asked) == 1:
            return Answer({"title": "Busy"}, status=503, headers={"Retry-After": "0"})
        return Answer({"id": "sys_1", "revision": 1}, status=201)

    service.on("POST /v1/systems", busy_once)
    assert client.systems.create({"name": "x"})["id"] == "sys_1"
    first, second = (asked.headers["Idempotency-Key"] for asked in service.asked)
    assert first == second


def test_two_creations_have_two_idempotency_keys(service: Service, client: servotune.Client):
    service.on("POST /v1/systems", Answer({"id": "sys_1", "revision": 1}, status=201))
    client.systems.create({"name": "x"})
    client.systems.create({"name": "x"})
    first, second = (asked.headers["Idempotency-Key"] for asked in service.asked)
    assert first != second


def test_a_broken_connection_is_tried_again(service: Service, client: servotune.Client):
    service.on("GET /v1/systems/sys_1", lambda _: Answer(cut=True) if len(service.asked) < 3 else Answer({"id": "a"}))
    assert client.systems.get("sys_1") == {"id": "a"}
    assert len(service.asked) == 3


def test_a_refusal_is_not_tried_again(service: Service, client: servotune.Client):
    with pytest.raises(servotune.NotFoundError):
        client.systems.get("sys_1")
    assert len(service.asked) == 1


def test_nobody_there_is_said_with_the_address():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with (
        servotune.connect(f"http://127.0.0.1:{port}", attempts=1) as client,
        pytest.raises(servotune.ServiceUnreachableError, match=rf"http://127\.0\.0\.1:{port}.*servotune serve"),
    ):
        client.ready()


def test_connect_waits_until_the_service_is_ready(service: Service):
    service.on("GET /readyz", lambda _: Answer({"title": "Starting"}, status=503 if len(service.asked) < 3 else 200))
    with servotune.connect(service.url, wait=10.0):
        assert len(service.asked) == 3


def test_connect_gives_up_after_the_time_given(service: Service):
    service.on("GET /readyz", Answer({"title": "Not ready", "detail": "no worker"}, status=503))
    with pytest.raises(servotune.ServiceUnreachableError, match=r"not ready after 0\.3 s.*no worker"):
        servotune.connect(service.url, wait=0.3)


def test_lists_follow_their_cursors(service: Service, client: servotune.Client):
    def page(asked: Asked) -> Answer:
        if "cursor=more" in asked.path:
            return Answer({"items": [{"id": "b"}], "next_cursor": None})
        return Answer({"items": [{"id": "a"}], "next_cursor": "more"})

    service.on("GET /v1/systems", page)
    assert [system["id"] for system in client.systems.list()] == ["a", "b"]


def test_an_update_names_the_version_it_starts_from(service: Service, client: servotune.Client):
    service.on("GET /v1/systems/sys_1", Answer({"id": "sys_1"}, headers={"ETag": '"3"'}))
    service.on("PUT /v1/systems/sys_1", Answer({"id": "sys_1", "revision": 4}))
    assert client.systems.update("sys_1", {"name": "y"})["revision"] == 4
    assert service.of("PUT")[0].headers["If-Match"] == '"3"'


def test_a_system_is_found_by_its_name(service: Service, client: servotune.Client):
    listed = [{"id": "sys_3", "name": "other"}, {"id": "sys_2", "name": "axis"}, {"id": "sys_1", "name": "axis"}]
    service.on("GET /v1/systems", Answer({"items": listed, "next_cursor": None}))
    service.on("GET /v1/systems/sys_2", Answer({"id": "sys_2", "document": {"name": "axis"}}))
    assert client.systems.find("axis").document == {"name": "axis"}
    with pytest.raises(LookupError, match="got 'axle'"):
        client.systems.find("axle")


def test_jobs_since_an_instant_end_with_the_first_earlier_one(service: Service, client: servotune.Client):
    days = ("2026-11-25", "2026-11-20", "2026-11-10")
    listed = [{"id": f"job_{day}", "created_at": f"{day}T10:00:00Z"} for day in days]
    service.on("GET /v1/jobs", Answer({"items": listed, "next_cursor": "more"}))
    since = datetime(2026, 11, 20, 10, tzinfo=UTC)
    assert [job.id for job in client.jobs.list(schedule="sch_1", since=since)] == ["job_2026-11-25", "job_2026-11-20"]
    assert len(service.asked) == 1
