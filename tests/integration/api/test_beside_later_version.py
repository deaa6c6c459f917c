"""A service and its worker go on serving when a later version has migrated the database beneath them, as in a rolling upgrade."""

from __future__ import annotations

from storage import open_database
from tests.integration.api.conftest import finished
from tests.integration.api.documents import LAG, OPTIMIZATION, RAW, lag_recording, upload
from tests.support.later_version import expand


def optimize(client) -> None:
    """Ask for a job, and see it done."""
    asked = client.post("/v1/optimizations", json={"system": LAG, **OPTIMIZATION})
    assert asked.status_code == 202, asked.text
    assert finished(client, asked.json())["status"] == "succeeded"


def test_who_serves_goes_on_when_a_later_version_has_migrated(service, worker, client) -> None:
    system = client.post("/v1/systems", json=LAG).json()["id"]
    optimize(client)
    assert client.get("/readyz").json()["status"] == "ready"
    database = open_database(service.database_url)
    expand(database)
    assert not database.is_current()
    database.dispose()
    ready = client.get("/readyz")
    assert (ready.status_code, ready.json()["checks"]["migrations"]) == (200, "ok")
    assert client.get(f"/v1/systems/{system}").status_code == 200
    recording = upload(client, RAW, lag_recording())
    assert (recording.status_code, recording.json()["status"]) == (200, "ready")
    optimize(client)
