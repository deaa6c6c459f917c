"""Every list of the contract in pages that stay what they are while things are added and deleted; a new list is walked, too."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import count
from typing import Any

import httpx
import pytest

from storage import Database, open_database
from storage.models import DEFAULT_WORKSPACE
from storage.repositories import AlertRepository
from tests.integration.api.documents import LAG, OPTIMIZATION, RAW, lag_recording, sha256
from tests.integration.api.rigs import AGENT, MEASUREMENT
from tests.integration.api.test_schedules import NIGHTLY
from tests.support.contract import OPERATIONS

#: Those that come in pages.
LISTS = sorted(
    operation.removeprefix("GET ")
    for operation, described in OPERATIONS.items()
    if any(parameter["name"] == "cursor" for parameter in described.get("parameters", ()))
)
STEP = {"input": {"port": "u", "signal": {"kind": "step"}}, "samples": 2}
WEBHOOK = {"url": "https://webhooks.example/", "events": ["job.failed"]}


@dataclass
class Room:
    """Somebody who fills the lists; ``ids`` has what those lists are of that belong to one thing."""

    client: httpx.Client
    database: Database
    ids: dict[str, str]
    numbers: Iterator[int] = field(default_factory=count)

    def add(self, path: str) -> None:
        """Put one more thing into the list at a path of the contract."""
        ADD[path](self, next(self.numbers))

    def post(self, path: str, body: Any = None) -> Any:
        reply = self.client.post(path, json=body)
        assert reply.is_success, reply.text
        return reply.json()

    def raise_alert(self, number: int) -> None:
        with self.database.session() as session:
            alerts = AlertRepository(session, DEFAULT_WORKSPACE)
            assert alerts.raise_once(kind="validation", source=f"job_{number}", detail="x", data={})

    def revise(self, number: int) -> None:
        where = f"/v1/systems/{self.ids['systems']}"
        reply = self.client.put(where, json=LAG | {"name": f"lag {number}"}, headers={"If-Match": "*"})
        assert reply.status_code == 200, reply.text

    def send(self, number: int) -> None:
        data = lag_recording(samples=2 + number)
        reply = self.client.put(f"/v1/datasets/{self.ids['datasets']}/segments/{sha256(data)}", content=data)
        assert reply.status_code == 201, reply.text


ADD: dict[str, Callable[[Room, int], Any]] = {
    "/v1/acquisition-templates": lambda room, n: room.post("/v1/acquisition-templates", {"name": f"t{n}"}),
    "/v1/acquisitions": lambda room, n: room.post("/v1/acquisitions", {"template": room.ids["acquisition-templates"]}),
    "/v1/agents": lambda room, n: room.post("/v1/agents", AGENT | {"name": f"agent {n}", "rig": f"bench-of-{n}"}),
    "/v1/alerts": Room.raise_alert,
    "/v1/audit": Room.revise,
    "/v1/comments": lambda room, n: room.post("/v1/comments", {"about": room.ids["systems"], "text": f"comment {n}"}),
    "/v1/datasets": lambda room, n: room.post("/v1/datasets", RAW),
    "/v1/datasets/{identifier}/segments": Room.send,
    "/v1/jobs": lambda room, n: room.post("/v1/optimizations", OPTIMIZATION | {"system": LAG}),
    "/v1/keys": lambda room, n: room.post("/v1/keys", {"name": f"key {n}", "scopes": ["read"]}),
    "/v1/results": lambda room, n: room.post("/v1/simulations", STEP | {"system": LAG, "keep": True}),
    "/v1/rigs": lambda room, n: room.post("/v1/agents", AGENT | {"name": f"agent {n}", "rig": f"rig-{n}"}),
    "/v1/schedules": lambda room, n: room.post("/v1/schedules", NIGHTLY | {"name": f"schedule {n}"}),
    "/v1/schedules/{identifier}/runs": lambda room, n: room.post(f"/v1/schedules/{room.ids['schedules']}/trigger"),
    "/v1/systems": lambda room, n: room.post("/v1/systems", LAG | {"name": f"system {n}"}),
    "/v1/systems/{identifier}/revisions": Room.revise,
    "/v1/webhooks": lambda room, n: room.post("/v1/webhooks", WEBHOOK | {"name": f"webhook {n}"}),
    "/v1/webhooks/{identifier}/deliveries": lambda room, n: room.post(f"/v1/webhooks/{room.ids['webhooks']}/test"),
    "/v1/workspaces": lambda room, n: room.post("/v1/workspaces", {"name": f"room {n}"}),
}


@pytest.fixture(scope="module")
def room(service, client) -> Iterator[Room]:
    bodies = {
        "systems": LAG,
        "datasets": RAW,
        "schedules": NIGHTLY | {"overlap": "queue"},
        "webhooks": WEBHOOK | {"name": "x"},
        "acquisition-templates": MEASUREMENT,
    }
    ids = {}
    assert client.post("/v1/agents", json=AGENT).status_code == 200
    for kind, body in bodies.items():
        reply = client.post(f"/v1/{kind}", json=body)
        assert reply.status_code == 201, reply.text
        ids[kind] = reply.json()["id"]
    database = open_database(service.database_url)
    yield Room(client, database, ids)
    database.dispose()


def names_of(path: str, page: dict[str, Any]) -> list[Any]:
    """Return what tells the items of a page from all others of their list."""
    key = {"revisions": "revision", "segments": "sha256"}.get(path.rpartition("/")[2], "id")
    return [item[key] for item in page["items"]]


def test_there_is_a_way_to_fill_every_list() -> None:
    assert sorted(ADD) == LISTS


@pytest.mark.parametrize("path", LISTS)
def test_pages_stay_what_they_are_while_things_are_added_and_deleted(room, path) -> None:
    kind = path.split("/")[2]
    where = path.replace("{identifier}", room.ids.get(kind, ""))
    for _ in range(5):
        room.add(path)
    whole = names_of(path, room.client.get(where, params={"limit": 1000}).json())
    assert len(whole) == len(set(whole)) >= 5
    size = -(-len(whole) // 3)
    seen: list[Any] = []
    cursor, deleted = None, set()
    while True:
        page = room.client.get(where, params={"limit": size} | ({"cursor": cursor} if cursor else {})).json()
        seen += names_of(path, page)
        cursor = page["next_cursor"]
        assert len(page["items"]) == size or (cursor is None and len(page["items"]) < size)
        if cursor is None:
            break
        if len(seen) == size:
            room.add(path)
            if f"DELETE {path}/{{identifier}}" in OPERATIONS and kind != "keys":  # a revoked key stays in its list
                # The last that was shown, where the next page begins, and one that was not shown yet.
                deleted = {whole[size - 1], next(name for name in whole[:size:-1] if name != room.ids.get(kind))}
                for identifier in deleted:
                    gone = room.client.delete(f"{where}/{identifier}", headers={"If-Match": "*"})
                    assert gone.status_code == 204, gone.text
    assert len(seen) == len(set(seen))
    assert [name for name in seen if name in whole] == [
        name for place, name in enumerate(whole) if place < size or name not in deleted
    ]
    wrong = room.client.get(where, params={"cursor": "x"})
    assert wrong.status_code == 422
    assert wrong.json()["detail"].startswith("cursor must be ")
    assert wrong.json()["detail"].endswith(", got 'x'")


def test_lists_are_narrowed_by_name_and_by_time(room) -> None:
    made = [room.post("/v1/datasets", RAW | {"name": name}) for name in ("Fräse, morning", "FRäSE, 90 % load", "lathe")]
    room.post("/v1/datasets", {"name": "fräse of a file", "format": "csv"})

    def listed(path: str = "datasets", **wanted: Any) -> list[str]:
        reply = room.client.get(f"/v1/{path}", params=wanted)
        assert reply.status_code == 200, reply.text
        return [one.get("name", one["id"]) for one in reply.json()["items"]]

    assert listed(name="fräse") == ["fräse of a file", "FRäSE, 90 % load", "Fräse, morning"]
    assert listed(name="äSe", format="raw", status="open", limit=1) == ["FRäSE, 90 % load"]
    # Of other letters than English ones Postgres knows the capitals that its locale tells.
    if room.database.engine.dialect.name == "sqlite":
        assert listed(name="ÄSE, M") == ["Fräse, morning"]
    # What stands for any letter in a database stands for itself here.
    assert listed(name="% l") == ["FRäSE, 90 % load"]
    assert listed(name="fr_se") == listed(name="fräse", status="failed") == []
    assert listed(name=made[2]["id"]) == ["lathe"]
    first, second, third = (one["created_at"] for one in made)
    assert listed(after=first, before=third) == ["FRäSE, 90 % load", "Fräse, morning"]
    # One after the other: pages of what is wanted follow one another as those of a whole list do.
    page = room.client.get("/v1/datasets", params={"name": "fräse", "limit": 2}).json()
    assert listed(name="fräse", limit=2, cursor=page["next_cursor"]) == ["Fräse, morning"]
    room.post("/v1/systems", LAG | {"name": "Fräse"})
    assert listed("systems", name="FRäSE", after=second) == ["Fräse"]
    assert listed("systems", name="fräse", before=second) == []
    for path, body in (("jobs", OPTIMIZATION | {"system": LAG}), ("results", STEP | {"system": LAG, "keep": True})):
        new = room.post({"jobs": "/v1/optimizations", "results": "/v1/simulations"}[path], body)["id"]
        assert new in listed(path, after=third)
        assert new not in listed(path, before=third)
    early = "0001-01-01T00:00:00+14:00"
    for wrong in (
        {"name": "a\0"},
        {"name": "x" * 201},
        {"after": "2026-01-01T00:00:00"},
        {"before": "noon"},
        {"before": early},
    ):
        refused = room.client.get("/v1/datasets", params=wrong)
        assert refused.status_code == 422, refused.text
        assert next(iter(wrong)) in refused.text
