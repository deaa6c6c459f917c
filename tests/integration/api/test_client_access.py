"""The client library with keys, workspaces and schedules, against a running service."""

from __future__ import annotations

import pytest

import servotune
from servotune.errors import ConflictError, ForbiddenError, UnauthorizedError
from tests.integration.api.test_schedules import JOB


def test_a_workspace_is_made_and_entered(sqlite_service) -> None:
    with servotune.connect(sqlite_service.url, key=sqlite_service.keys["admin"]) as operator:
        room = operator.workspaces.create("bench", limits={"systems": 5})
        assert operator.workspaces.get(room["id"])["limits"]["systems"] == 5
        assert room["id"] in [found["id"] for found in operator.workspaces.list()]
        key = operator.keys.create("bench admin", scopes=["admin"], workspace=room["id"])
    with servotune.connect(sqlite_service.url, key=key["key"]) as bench:
        assert [found["id"] for found in bench.workspaces.list()] == [room["id"]]
        with pytest.raises(ForbiddenError):
            bench.workspaces.create("another")
        lab = bench.keys.create("lab", scopes=["read"], expires_at="2999-01-01T00:00:00Z")
        new = bench.keys.rotate(lab["id"], overlap=60)
        assert new["replaces"] == lab["id"]
        bench.keys.revoke(lab["id"])
        assert {found["name"] for found in bench.keys.list()} == {"bench admin", "lab"}
    with (
        servotune.connect(sqlite_service.url, key=lab["key"]) as old,
        pytest.raises(UnauthorizedError, match="revoked"),
    ):
        list(old.systems.list())


def test_a_schedule_lives_its_life(sqlite_service) -> None:
    with servotune.connect(sqlite_service.url, key=sqlite_service.keys["run"]) as client:
        made = client.schedules.create("nightly", cron="30 2 * * *", **JOB, time_zone="Europe/Berlin")
        assert len(client.schedules.get(made["id"])["next_runs"]) == 5
        changed = client.schedules.update(made["id"], made["document"] | {"cron": "0 3 * * *"})
        assert changed["cron"] == "0 3 * * *"
        assert client.schedules.pause(made["id"])["paused"]
        run = client.schedules.trigger(made["id"])
        with pytest.raises(ConflictError, match="has not ended"):
            client.schedules.trigger(made["id"])
        assert [found["job"] for found in client.schedules.runs(made["id"])] == [run["job"]]
        assert not client.schedules.resume(made["id"])["paused"]
        assert [found["id"] for found in client.schedules.list()] == [made["id"]]
        client.schedules.delete(made["id"])
        assert list(client.schedules.list()) == []
