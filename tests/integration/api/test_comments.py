"""Comments: whom they belong to, what they may be about, what becomes of them with that; on a real server."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import Any

import httpx
import pytest

from api.schemas.comments import LONGEST
from servotune import connect
from servotune.errors import ApiError
from storage import Database, open_database
from storage.errors import StateError
from storage.models import DEFAULT_WORKSPACE, Job
from storage.models.base import utc_now
from storage.repositories import CommentRepository, jobs
from storage.repositories import comments as kept
from tests.integration.api.documents import LAG, OPTIMIZATION, RAW

STEP = {"system": LAG, "input": {"port": "u", "signal": {"kind": "step"}}, "samples": 2, "keep": True}

ANY = {"If-Match": "*"}


@pytest.fixture
def database(service) -> Iterator[Database]:
    opened = open_database(service.database_url)
    yield opened
    opened.dispose()


def thing(client: httpx.Client, kind: str) -> str:
    path, body = {
        "system": ("/v1/systems", LAG),
        "dataset": ("/v1/datasets", RAW),
        "job": ("/v1/optimizations", OPTIMIZATION | {"system": LAG}),
        "result": ("/v1/simulations", STEP),
    }[kind]
    reply = client.post(path, json=body)
    assert reply.is_success, reply.text
    return str(reply.json()["id"])


def written(client: httpx.Client, about: str, text: str = "x") -> dict[str, Any]:
    reply = client.post("/v1/comments", json={"about": about, "text": text})
    assert reply.status_code == 201, reply.text
    assert reply.headers["Location"] == f"/v1/comments/{reply.json()['id']}"
    return dict(reply.json())


def with_key(service, client: httpx.Client, name: str, *scopes: str) -> httpx.Client:
    key = client.post("/v1/keys", json={"name": name, "scopes": list(scopes)}).json()["key"]
    return httpx.Client(base_url=service.url, headers={"Authorization": f"Bearer {key}"}, timeout=60, trust_env=False)


@pytest.mark.parametrize("kind", ["system", "dataset", "job", "result"])
def test_a_comment_is_kept_as_it_was_written(service, client, kind) -> None:
    about, text = thing(client, kind), "<b>80 Hz</b> & a line\n\tfurther: 5 µm"
    with with_key(service, client, "Ana", "write") as ana:
        first = written(ana, about, text)
        second = written(ana, about, "and another")
    assert (first["about"], first["text"], first["author"]) == (about, text, "Ana")
    age = datetime.now(UTC) - datetime.fromisoformat(first["created_at"])
    assert timedelta(0) <= age < timedelta(minutes=1)
    seen = client.get("/v1/comments", params={"about": about}).json()["items"]
    assert [row["id"] for row in seen] == [second["id"], first["id"]]
    assert client.get(f"/v1/comments/{first['id']}").json() == first  # an admin may delete it, as its author may


def test_who_may_write_read_and_delete(service, client) -> None:
    about = thing(client, "system")
    with (
        with_key(service, client, "Ana", "write") as ana,
        with_key(service, client, "Ion", "write") as ion,
        with_key(service, client, "guest", "read") as guest,
    ):
        said = written(ana, about)
        where = f"/v1/comments/{said['id']}"
        deletable = {reader: reader.get(where).json()["deletable"] for reader in (ana, ion, guest, client)}
        assert deletable == {ana: True, ion: False, guest: False, client: True}
        assert guest.post("/v1/comments", json={"about": about, "text": "x"}).status_code == 403
        assert guest.delete(where, headers=ANY).status_code == 403
        refused = ion.delete(where, headers=ANY)
        assert refused.status_code == 403
        assert refused.json()["detail"].endswith("by its author or an admin, " + repr(said["id"]) + " is of 'Ana'")
        assert ana.delete(where).status_code == 428
        assert ana.delete(where, headers={"If-Match": '"2"'}).status_code == 412
        assert ana.delete(where, headers={"If-Match": ana.get(where).headers["ETag"]}).status_code == 204
        assert ana.get(where).status_code == ana.delete(where, headers=ANY).status_code == 404
        other = written(ion, about)
        assert client.delete(f"/v1/comments/{other['id']}", headers=ANY).status_code == 204


def test_what_is_written_in_a_browser_belongs_to_the_key_behind_it(service, client) -> None:
    about = thing(client, "system")
    with with_key(service, client, "Ana", "write") as ana:
        signed_in = ana.post("/v1/session")
        headers = {"X-CSRF-Token": signed_in.json()["csrf_token"]}
        with httpx.Client(
            base_url=service.url, cookies=signed_in.cookies, headers=headers, timeout=60, trust_env=False
        ) as browser:
            said = written(browser, about)
        # The next sign-in, and the key itself, are the same author.
        assert (said["author"], said["author_id"]) == ("Ana", ana.get("/v1/session").json()["principal"])
        assert ana.delete(f"/v1/comments/{said['id']}", headers=ANY).status_code == 204


@pytest.mark.parametrize(
    ("body", "pointer", "says"),
    [
        ({"text": ""}, "/text", "at least 1"),
        ({"text": " \n\t"}, "/text", "text must say something, got nothing but blanks"),
        ({"text": "x" * (LONGEST + 1)}, "/text", f"at most {LONGEST}"),
        ({"text": 5}, "/text", "text"),
        ({"about": "sys_none"}, "/about", "about must be the id of a system, a dataset, a job or a kept result that exists, got 'sys_none'"),
        ({"about": "key_1"}, "/about", "got 'key_1'"),
    ],
)  # fmt: skip
def test_what_is_no_comment_is_refused_by_its_place(client, body, pointer, says) -> None:
    about = thing(client, "system")
    reply = client.post("/v1/comments", json={"about": about, "text": "x"} | body)
    assert reply.status_code == 422
    assert [fault["pointer"] for fault in reply.json()["errors"]] == [pointer]
    assert says in reply.json()["detail"]
    assert client.get("/v1/comments", params={"about": about}).json()["items"] == []


def test_the_longest_comment_is_kept_whole(client) -> None:
    text = "µ" * LONGEST
    said = written(client, thing(client, "system"), text)
    assert client.get(f"/v1/comments/{said['id']}").json()["text"] == text


@pytest.mark.parametrize("kind", ["system", "dataset"])
def test_comments_go_with_what_a_user_deletes(client, kind) -> None:
    about, other = thing(client, kind), thing(client, kind)
    gone, stays = written(client, about), written(client, other)
    assert client.delete(f"/v1/{kind}s/{about}", headers={"If-Match": "*"}).status_code == 204
    assert client.get(f"/v1/comments/{gone['id']}").status_code == 404
    assert client.get("/v1/comments", params={"about": about}).json()["items"] == []
    assert client.get(f"/v1/comments/{stays['id']}").status_code == 200
    refused = client.post("/v1/comments", json={"about": about, "text": "x"})
    assert refused.status_code == 422


def test_comments_go_with_a_job_that_is_forgotten(client, database) -> None:
    about = thing(client, "job")
    gone = written(client, about)
    client.post(f"/v1/jobs/{about}/cancel")
    with database.session() as session:
        session.get_one(Job, about).finished_at = utc_now() - timedelta(days=100)
    with database.session() as session:
        assert jobs.forget(session, before=utc_now() - timedelta(days=99)) == 1
    assert client.get(f"/v1/comments/{gone['id']}").status_code == 404


def test_a_thing_has_so_many_comments(client, database, monkeypatch) -> None:
    monkeypatch.setattr(kept, "MOST", 3)
    about = thing(client, "system")
    said = [written(client, about) for _ in range(3)]
    full = client.post("/v1/comments", json={"about": about, "text": "x"})
    assert (full.status_code, full.json()["detail"]) == (409, f"{about!r} must have at most 3 comments, it has 3")
    with database.session() as session, pytest.raises(StateError):
        CommentRepository(session, DEFAULT_WORKSPACE).create(subject=about, author_id="a", author_name="a", text="x")
    client.delete(f"/v1/comments/{said[0]['id']}", headers=ANY)
    written(client, about)


def test_who_commented_and_who_deleted_is_in_the_log(client) -> None:
    about = thing(client, "system")
    said = written(client, about)
    client.delete(f"/v1/comments/{said['id']}", headers=ANY)
    log = [entry for entry in client.get("/v1/audit").json()["items"] if entry["target"] == said["id"]]
    assert [entry["action"] for entry in log] == ["comment.delete", "comment.create"]
    assert all(entry["detail"]["about"] == about for entry in log)


def test_the_python_client_writes_lists_and_deletes(service, client) -> None:
    about = thing(client, "system")
    with connect(service.url, key=service.keys["admin"]) as own:
        said = own.comments.create(about, "keep 4")
        assert own.comments.get(said.id).text == "keep 4"
        assert [comment.id for comment in own.comments.list(about=about)] == [said.id]
        own.comments.delete(said.id)
        assert list(own.comments.list(about=about)) == []
        with pytest.raises(ApiError) as refused:
            own.comments.get(said.id)
        assert refused.value.status == 404
