"""Another workspace's admin walks every route and finds nothing: what is there and what is not look the same to it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from storage import open_database
from storage.models import DEFAULT_WORKSPACE
from storage.repositories import AlertRepository
from tests.integration.api.documents import LAG, OPTIMIZATION, RAW, lag_recording, sha256, upload
from tests.integration.api.rigs import AGENT, CHANNELS, MEASUREMENT
from tests.integration.api.test_schedules import NIGHTLY
from tests.support import contract

OPERATIONS = sorted(operation for operation in contract.OPERATIONS if operation.partition(" ")[2].startswith("/v1"))
#: Every name, id and hash of the owner's things has this in it, or is one of the ids.
MARK = "confidential"
DATA = lag_recording(samples=500)

WEBHOOK = {"name": "x", "url": "https://webhooks.example/", "events": ["job.failed"]}

Things = dict[str, str]


@pytest.fixture(scope="module")
def things(client, service) -> Iterator[Things]:
    """What the owner has: the id of one thing of each kind."""
    system = client.post("/v1/systems", json=LAG | {"name": MARK}).json()["id"]
    assert upload(client, RAW | {"name": MARK}, DATA, segment=len(DATA)).status_code == 200
    kept = client.post("/v1/simulations", json=_simulation(system) | {"keep": True}).json()
    job = client.post("/v1/optimizations", json=OPTIMIZATION | {"system": system}).json()
    key = client.post("/v1/keys", json={"name": MARK, "scopes": ["read"]}).json()
    schedule = client.post("/v1/schedules", json=NIGHTLY | {"name": MARK}).json()
    agent = client.post("/v1/agents", json=AGENT | {"name": MARK, "rig": MARK}).json()
    measurement = MEASUREMENT | {"name": MARK, "rig": MARK}
    template = client.post("/v1/acquisition-templates", json=measurement).json()
    acquisition = client.post("/v1/acquisitions", json=measurement).json()
    webhook = client.post("/v1/webhooks", json=WEBHOOK | {"name": MARK}).json()
    comment = client.post("/v1/comments", json={"about": system, "text": MARK}).json()
    yield {
        "comments": comment["id"],
        "webhooks": webhook["id"],
        "alerts": _alert(service.database_url),
        "agents": agent["id"],
        "rigs": agent["rig_id"],
        "acquisition-templates": template["id"],
        "acquisitions": acquisition["id"],
        "schedules": schedule["id"],
        "systems": system,
        "lineage": system,
        "datasets": client.get("/v1/datasets").json()["items"][0]["id"],
        "results": kept["id"],
        "frfs": kept["id"],
        "jobs": job["id"],
        "keys": key["id"],
        "workspaces": "ws_default",
    }
    client.post(f"/v1/jobs/{job['id']}/cancel")


def _alert(database_url: str) -> str:
    """Raise an alert as a worker does; return its id."""
    database = open_database(database_url)
    with database.session() as session:
        alerts = AlertRepository(session, DEFAULT_WORKSPACE)
        assert alerts.raise_once(kind="validation", source="job_1", detail=MARK, data={})
        (alert,) = alerts.page().items
    database.dispose()
    return str(alert.id)


@pytest.fixture(scope="module")
def stranger(service) -> Iterator[httpx.Client]:
    with service.client("stranger") as own:
        yield own


def _simulation(system: str) -> dict[str, Any]:
    return {"system": system, "input": {"port": "u", "signal": {"kind": "step"}}}


def _recorded(dataset: str) -> dict[str, Any]:
    return {"dataset": dataset, "inputs": {"u": "u"}, "outputs": {"y": "y"}}


#: What is sent beside the path.
BODIES: dict[str, dict[str, Any]] = {
    "PUT /v1/systems/{identifier}": LAG,
    "PUT /v1/workspaces/{identifier}": {"name": "mine now"},
    "PUT /v1/webhooks/{identifier}": WEBHOOK,
    "PUT /v1/schedules/{identifier}": NIGHTLY,
    "POST /v1/datasets/{identifier}/preview": {"segments": [sha256(DATA)]},
    "POST /v1/datasets/{identifier}/commit": {"segments": [sha256(DATA)], "sha256": sha256(DATA)},
    "POST /v1/keys/{identifier}/rotate": {},
    "PUT /v1/acquisition-templates/{identifier}": {"name": "mine now"},
    "POST /v1/acquisitions/{identifier}/attempts/{number}/heartbeat": {"agent": "agt_none", "status": "running"},
    "POST /v1/acquisitions/{identifier}/attempts/{number}/dataset": {
        "agent": "agt_none",
        "start_time": "2026-01-01T00:00:00Z",
        "sample_rate": 1000,
        "channels": CHANNELS,
    },
    "POST /v1/acquisitions/{identifier}/attempts/{number}/finish": {"agent": "agt_none"},
}

#: Bodies that name things: each must be refused as if the thing did not exist.
REFERRING: dict[str, list[Any]] = {
    "POST /v1/simulations": [
        lambda t: _simulation(t["systems"]),
        lambda t: {
            "system": LAG,
            "input": {"port": "u", "signal": {"kind": "sampled", "dataset": t["datasets"], "channel": "u"}},
        },
    ],
    "POST /v1/frequency-responses": [lambda t: {"system": t["systems"], "from": "u", "to": "y"}],
    "POST /v1/state-space": [lambda t: {"system": t["systems"]}],
    "POST /v1/influence": [
        lambda t: {
            "system": t["systems"],
            "input": "u",
            "output": "y",
            "parameters": ["tau"],
            "metrics": ["rise_time"],
        }
    ],
    "POST /v1/processings": [lambda t: {"name": "mine", "sources": [t["datasets"]]}],
    "POST /v1/frfs": [
        lambda t: {"dataset": t["datasets"], "input": "u", "output": "y"},
    ],
    "POST /v1/spectra": [
        lambda t: {"dataset": t["datasets"], "channel": "u"},
        lambda t: {**_simulation(t["systems"]), "output": "y"},
    ],
    "POST /v1/validations": [
        lambda t: {"system": t["systems"], **_recorded("ds_none")},
        lambda t: {"system": LAG, **_recorded(t["datasets"])},
        lambda t: {"system": LAG, **_recorded("ds_none"), "identification": t["jobs"]},
    ],
    "POST /v1/identifications": [
        lambda t: {"system": t["systems"], **_recorded("ds_none"), "parameters": ["k"]},
        lambda t: {"system": LAG, **_recorded(t["datasets"]), "parameters": ["k"]},
    ],
    "POST /v1/optimizations": [
        lambda t: OPTIMIZATION | {"system": t["systems"]},
        lambda t: (
            OPTIMIZATION
            | {
                "system": LAG,
                "experiments": [
                    {
                        "name": "step",
                        "input": {"port": "u", "signal": {"kind": "sampled", "dataset": t["datasets"], "channel": "u"}},
                    }
                ],
            }
        ),
    ],
    "POST /v1/schedules": [
        lambda t: NIGHTLY | {"job": {"kind": "optimization", "body": OPTIMIZATION | {"system": t["systems"]}}},
        lambda t: (
            NIGHTLY
            | {
                "job": {
                    "kind": "identification",
                    "body": {"system": LAG, **_recorded(t["datasets"]), "parameters": ["k"]},
                }
            }
        ),
    ],
    "POST /v1/acquisitions": [
        lambda _: MEASUREMENT | {"rig": MARK},
        lambda t: {"template": t["acquisition-templates"]},
    ],
    "POST /v1/comments": [
        lambda t: {"about": t["systems"], "text": "mine"},
        lambda t: {"about": t["datasets"], "text": "mine"},
        lambda t: {"about": t["jobs"], "text": "mine"},
        lambda t: {"about": t["results"], "text": "mine"},
    ],
    "POST /v1/keys": [lambda t: {"name": "x", "scopes": ["admin"], "workspace": t["workspaces"]}],
}

#: Routes that name nothing, and what a stranger gets from them.
OWN = {
    "POST /v1/systems": (LAG, 201),
    "POST /v1/datasets": (RAW, 201),
    "POST /v1/agents": (AGENT, 200),
    "POST /v1/acquisition-templates": ({"name": "mine"}, 201),
    "POST /v1/webhooks": (WEBHOOK, 201),
    "POST /v1/session": (None, 201),
    "DELETE /v1/session": (None, 204),
    "POST /v1/tickets": (None, 201),
    "POST /v1/workspaces": ({"name": "mine"}, 403),
}


def named(operation: str) -> bool:
    return "{" in operation


def listed(operation: str) -> bool:
    return operation.startswith("GET") and not named(operation)


def test_every_route_is_walked() -> None:
    unknown = [
        operation
        for operation in OPERATIONS
        if not (named(operation) or listed(operation) or operation in REFERRING or operation in OWN)
    ]
    assert unknown == [], "say what a stranger gets from them"


def ask(client: httpx.Client, operation: str, things: Things) -> httpx.Response:
    method, _, path = operation.partition(" ")
    kind = path.split("/")[2]
    path = path.replace("{identifier}", things[kind]).replace("{sha256}", sha256(DATA))
    path = path.replace("{number}", "1").replace("{name}", "u")
    if operation.startswith("PUT /v1/datasets"):
        return client.put(path, content=DATA)
    headers = {"If-Match": "*"} if method in {"PUT", "DELETE"} else {}
    return client.request(method, path, json=BODIES.get(operation), headers=headers)


@pytest.mark.parametrize("operation", [operation for operation in OPERATIONS if named(operation)])
def test_a_thing_of_others_is_not_there(stranger, things, operation) -> None:
    none = {kind: identifier[:4] + "0" * (len(identifier) - 4) for kind, identifier in things.items()}
    reply, missing = ask(stranger, operation, things), ask(stranger, operation, none)
    # Who runs the installation may change workspaces, nobody else.
    assert reply.status_code == (403 if operation == "PUT /v1/workspaces/{identifier}" else 404), reply.text
    assert reply.headers["Content-Type"] == "application/problem+json"
    assert MARK not in reply.text
    kind = operation.split("/")[2]
    assert reply.text.replace(things[kind], "?") == missing.text.replace(none[kind], "?")
    assert reply.status_code == missing.status_code
    assert set(reply.headers) == set(missing.headers)


@pytest.mark.parametrize("operation", sorted(REFERRING))
def test_a_thing_of_others_cannot_be_used(stranger, things, operation) -> None:
    none = {kind: identifier[:4] + "0" * (len(identifier) - 4) for kind, identifier in things.items()}
    path = operation.partition(" ")[2]
    for body in REFERRING[operation]:
        reply, missing = stranger.post(path, json=body(things)), stranger.post(path, json=body(none))
        assert reply.status_code == missing.status_code == 422, reply.text
        texts = [reply.text, missing.text]
        for kind, identifier in things.items():
            texts = [texts[0].replace(identifier, "?"), texts[1].replace(none[kind], "?")]
        assert texts[0] == texts[1]


@pytest.mark.parametrize("operation", [operation for operation in OPERATIONS if listed(operation)])
def test_a_list_shows_nothing_of_others(stranger, client, things, operation) -> None:
    path = operation.partition(" ")[2]
    reply = stranger.get(path)
    assert reply.status_code == 200
    assert MARK not in reply.text
    for identifier in things.values():
        assert identifier not in reply.text
    # And not because nothing is there: its owner sees it.
    kind = path.split("/")[2]
    if kind in things:
        assert things[kind] in client.get(path).text
        # A cursor of theirs opens nothing either.
        cursor = client.get(path, params={"limit": 1}).json()["next_cursor"]
        if cursor is not None:
            assert not any(
                identifier in stranger.get(path, params={"cursor": cursor}).text for identifier in things.values()
            )


@pytest.mark.parametrize("operation", sorted(OWN))
def test_what_names_nothing_stays_in_its_own_room(stranger, client, things, operation) -> None:
    method, _, path = operation.partition(" ")
    body, status = OWN[operation]
    headers = {"Authorization": stranger.headers["Authorization"]}
    with httpx.Client(base_url=stranger.base_url, headers=headers, trust_env=False) as own:
        reply = own.request(method, path, json=body)
    assert reply.status_code == status, reply.text
    if "Location" in reply.headers:
        assert client.get(reply.headers["Location"]).status_code == 404


def test_equal_bytes_do_not_tell_that_others_have_them(stranger, things) -> None:
    where = stranger.post("/v1/datasets", json=RAW).headers["Location"]
    assert stranger.get(f"{where}/segments").json()["items"] == []
    missing = stranger.post(f"{where}/commit", json=BODIES["POST /v1/datasets/{identifier}/commit"])
    assert (missing.status_code, missing.json()["missing"]) == (409, [sha256(DATA)])
    first = stranger.put(f"{where}/segments/{sha256(DATA)}", content=DATA)
    assert first.status_code == 201  # new to this workspace, as it would be to an empty service
    used = stranger.get("/v1/workspaces/ws_other").json()["used"]["stored_bytes"]
    stranger.delete(where, headers={"If-Match": "*"})
    assert used - stranger.get("/v1/workspaces/ws_other").json()["used"]["stored_bytes"] == len(DATA)


def test_an_idempotency_key_of_others_is_a_fresh_one(stranger, client, things) -> None:
    headers = {"Idempotency-Key": MARK}
    mine = client.post("/v1/systems", json=LAG | {"name": MARK}, headers=headers)
    theirs = stranger.post("/v1/systems", json=LAG, headers=headers)
    assert theirs.status_code == 201
    assert theirs.json()["id"] != mine.json()["id"]
    assert "Idempotency-Replayed" not in theirs.headers


def test_after_the_walk_everything_is_where_it_was(client, things) -> None:
    assert client.get(f"/v1/systems/{things['systems']}").json()["revision"] == 1
    assert client.get(f"/v1/datasets/{things['datasets']}/original").content == DATA
    assert client.get(f"/v1/results/{things['results']}").status_code == 200
    assert client.get(f"/v1/jobs/{things['jobs']}").json()["status"] == "queued"
    assert client.get(f"/v1/keys/{things['keys']}").json()["revoked_at"] is None
    assert client.get(f"/v1/schedules/{things['schedules']}").json()["revision"] == 1
