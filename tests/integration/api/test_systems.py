"""/v1/systems: revisions, conditional changes, paging, idempotency; and what is refused."""

from __future__ import annotations

import threading

import pytest

from tests.integration.api.documents import LAG, PNEUMATIC, pneumatic


def test_a_system_lives_through_its_revisions(client) -> None:
    created = client.post("/v1/systems", json=PNEUMATIC)
    assert created.status_code == 201
    body = created.json()
    assert body["document"] == PNEUMATIC  # units as written
    assert body["revision"] == 1
    assert body["warnings"] == []
    where = created.headers["Location"]
    assert where == f"/v1/systems/{body['id']}"
    assert created.headers["ETag"] == '"1"'

    changed = PNEUMATIC | {"name": "second"}
    assert client.put(where, json=changed).status_code == 428
    updated = client.put(where, json=changed, headers={"If-Match": '"1"'})
    assert (updated.status_code, updated.json()["revision"], updated.headers["ETag"]) == (200, 2, '"2"')
    stale = client.put(where, json=changed, headers={"If-Match": '"1"'})
    assert stale.status_code == 412
    assert "must be 2, got 1" in stale.json()["detail"]

    assert client.get(where).json()["document"]["name"] == "second"
    assert client.get(f"{where}/revisions/1").json()["document"] == PNEUMATIC
    assert [row["revision"] for row in client.get(f"{where}/revisions").json()["items"]] == [2, 1]
    first = client.get(f"{where}/revisions", params={"limit": 1}).json()
    second = client.get(f"{where}/revisions", params={"limit": 1, "cursor": first["next_cursor"]}).json()
    assert [row["revision"] for row in second["items"]] == [1]
    assert second["next_cursor"] is None
    assert client.get(f"{where}/revisions/9").status_code == 404

    assert client.delete(where).status_code == 428
    assert client.delete(where, headers={"If-Match": '"1"'}).status_code == 412
    assert client.delete(where, headers={"If-Match": "*"}).status_code == 204
    assert client.get(where).status_code == 404
    assert client.delete(where, headers={"If-Match": "*"}).status_code == 404


def test_pages_hold_every_system_once(client) -> None:
    made = {client.post("/v1/systems", json=LAG | {"name": f"n{i}"}).json()["id"] for i in range(5)}
    seen: list[str] = []
    cursor = None
    while True:
        page = client.get("/v1/systems", params={"limit": 2} | ({"cursor": cursor} if cursor else {})).json()
        assert len(page["items"]) <= 2
        seen += [item["id"] for item in page["items"]]
        cursor = page["next_cursor"]
        if cursor is None:
            break
    assert made <= set(seen)
    assert len(seen) == len(set(seen))


@pytest.mark.parametrize("query", ["limit=0", "limit=1001", "limit=x", "cursor=nonsense", "cursor=" + "x" * 600])
def test_a_wrong_page_is_refused(client, query) -> None:
    reply = client.get(f"/v1/systems?{query}")
    assert reply.status_code == 422
    assert reply.headers["Content-Type"] == "application/problem+json"


def test_a_repeated_key_gets_the_first_answer_and_makes_nothing_new(client) -> None:
    headers = {"Idempotency-Key": "once"}
    first = client.post("/v1/systems", json=LAG, headers=headers)
    second = client.post("/v1/systems", json=LAG, headers=headers)
    assert second.status_code == 201
    assert second.json() == first.json()
    assert second.headers["Location"] == first.headers["Location"]
    assert second.headers["Idempotency-Replayed"] == "true"
    other = client.post("/v1/systems", json=LAG | {"name": "other"}, headers=headers)
    assert other.status_code == 422
    assert other.json()["type"].endswith("idempotency-key-reused")


def test_a_key_is_free_again_after_a_refusal(client) -> None:
    headers = {"Idempotency-Key": "refused-first"}
    wrong = LAG | {"outputs": {"y": "nothing"}}
    assert client.post("/v1/systems", json=wrong, headers=headers).status_code == 422
    assert client.post("/v1/systems", json=LAG, headers=headers).status_code == 201


def test_of_equal_requests_at_the_same_time_one_makes_the_system(service) -> None:
    replies = []

    def ask() -> None:
        with service.client() as own:
            replies.append(own.post("/v1/systems", json=LAG, headers={"Idempotency-Key": "race"}))

    threads = [threading.Thread(target=ask) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    made = {reply.json()["id"] for reply in replies if reply.status_code == 201}
    assert len(made) == 1
    assert {reply.status_code for reply in replies} <= {201, 409}


def test_warnings_point_into_the_document(client) -> None:
    document = LAG | {"parameters": LAG["parameters"] | {"unused": {"value": 1}}}
    warnings = client.post("/v1/systems", json=document).json()["warnings"]
    assert [entry["pointer"] for entry in warnings] == ["/parameters/unused"]


def change(**fields):
    return PNEUMATIC | fields


def motor(**fields):
    return pneumatic(motor=PNEUMATIC["blocks"]["motor"] | fields)


ALGEBRAIC = {
    "blocks": {"r": {"kind": "input"}, "s": {"kind": "sum", "signs": "++"}, "g": {"kind": "gain", "gain": 1}},
    "connections": [{"from": "r", "to": "s.in1"}, {"from": "s", "to": "g"}, {"from": "g", "to": "s.in2"}],
    "outputs": {"y": "g"},
}

WRONG = {
    "no blocks": (change(blocks={}), "/blocks"),
    "no outputs": (change(outputs={}), "/outputs"),
    "unknown kind": (pneumatic(motor={"kind": "perpetuum_mobile"}), "/blocks/motor/kind"),
    "no kind": (pneumatic(motor={"area": 1}), "/blocks/motor/kind"),
    "unknown field": (motor(colour="red"), "/blocks/motor/colour"),
    "missing parameter": (pneumatic(controller={"kind": "gain"}), "/blocks/controller/gain"),
    "wrong unit": (motor(area={"value": 1, "unit": "kg"}), "/blocks/motor/area"),
    "unknown unit": (motor(area={"value": 1, "unit": "parrot"}), "/blocks/motor/area"),
    "temperature": (
        pneumatic(controller={"kind": "gain", "gain": {"value": 6, "unit": "degC"}}),
        "/blocks/controller/gain",
    ),
    "out of bounds": (motor(area=-1), "/blocks/motor/area"),
    "text for a number": (motor(area="big"), "/blocks/motor/area"),
    "true for a number": (motor(area=True), "/blocks/motor/area"),
    "null for a number": (motor(area=None), "/blocks/motor/area"),
    "expression of nothing": (motor(area="=nothing"), "/blocks/motor/area"),
    "expression that is code": (motor(area="=__import__('os').getpid()"), "/blocks/motor/area"),
    "expression cut off": (motor(area="=2*"), "/blocks/motor/area"),
    "cyclic expressions": (
        change(parameters=PNEUMATIC["parameters"] | {"a": {"value": "=b"}, "b": {"value": "=a"}}),
        "/parameters/",
    ),
    "wrong name": (pneumatic(Motor={"kind": "gain", "gain": 1}), "/blocks/Motor"),
    "unknown source": (
        change(connections=[*PNEUMATIC["connections"], {"from": "ghost", "to": "error.in1"}]),
        "/connections/5",
    ),
    "driven twice": (
        change(connections=[*PNEUMATIC["connections"], {"from": "reference", "to": "error.in2"}]),
        "/connections/",
    ),
    "unknown output": (change(outputs={"y": "motor.smell"}), "/outputs/y"),
    "improper": (
        pneumatic(controller={"kind": "transfer_function", "numerator": [1, 0, 0], "denominator": [1, 1]}),
        "/blocks/controller/numerator",
    ),
    "ill-posed loop": (ALGEBRAIC, ""),
    "a list": ([], ""),
    "a number": (5, ""),
    "a text": ("system", ""),
    "too many blocks": (
        change(blocks={f"b{i}": {"kind": "gain", "gain": 1} for i in range(501)}),
        "/blocks",
    ),
    "too many states": (
        change(
            blocks={f"b{i}": {"kind": "integrator"} for i in range(201)},
            connections=[],
            outputs={"y": "b0"},
        ),
        "/blocks",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_document_is_refused_at_its_place(client, case) -> None:
    document, pointer = WRONG[case]
    reply = client.post("/v1/systems", json=document)
    assert reply.status_code == 422, reply.text
    assert reply.headers["Content-Type"] == "application/problem+json"
    problem = reply.json()
    assert problem["detail"]
    assert any(entry["pointer"].startswith(pointer) for entry in problem["errors"]), problem


def test_an_ill_posed_loop_names_its_ports(client) -> None:
    assert client.post("/v1/systems", json=ALGEBRAIC).json()["ports"]


def test_limits_name_count_and_limit(client) -> None:
    assert "500" in client.post("/v1/systems", json=WRONG["too many blocks"][0]).json()["detail"]
    assert "501" in client.post("/v1/systems", json=WRONG["too many blocks"][0]).json()["detail"]
    assert "201" in client.post("/v1/systems", json=WRONG["too many states"][0]).json()["detail"]


@pytest.mark.parametrize(
    ("content", "status"),
    [
        (b'{"name": NaN}', 422),
        (b'{"name": Infinity}', 422),
        (b'{"name": "a", "name": "b"}', 422),
        (b'{"name": ', 422),
        (b"", 422),
        (b"[" * 50_000, 422),
        (b'{"name": "\xff"}', 422),
        (b'{"name": "' + b"x" * (1 << 20) + b'"}', 413),
    ],
)
def test_what_is_no_json_document_is_refused(client, content, status) -> None:
    reply = client.post("/v1/systems", content=content, headers={"Content-Type": "application/json"})
    assert reply.status_code == status
    assert reply.headers["Content-Type"] == "application/problem+json"
    assert reply.json()["status"] == status


def test_a_body_that_is_not_declared_as_json_is_refused_with_a_hint(client) -> None:
    reply = client.post("/v1/systems", content=b"{}", headers={"Content-Type": "text/plain"})
    assert reply.status_code == 422
    assert "application/json" in reply.json()["detail"]


@pytest.mark.parametrize(("method", "path", "status"), [("GET", "/v1/nothing", 404), ("PATCH", "/v1/systems", 405)])
def test_wrong_paths_and_methods_are_problems_too(client, method, path, status) -> None:
    reply = client.request(method, path)
    assert reply.status_code == status
    assert reply.headers["Content-Type"] == "application/problem+json"
    assert reply.json()["status"] == status


def test_pages_do_not_move_when_something_is_inserted(client) -> None:
    made = [client.post("/v1/systems", json=LAG | {"name": f"before {i}"}).json()["id"] for i in range(4)]
    first = client.get("/v1/systems", params={"limit": 2}).json()
    assert [item["id"] for item in first["items"]] == [made[3], made[2]]
    client.post("/v1/systems", json=LAG | {"name": "meanwhile"})
    client.delete(f"/v1/systems/{made[2]}", headers={"If-Match": "*"})
    second = client.get("/v1/systems", params={"limit": 2, "cursor": first["next_cursor"]}).json()
    assert [item["id"] for item in second["items"]] == [made[1], made[0]]
