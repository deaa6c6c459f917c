"""`Prefer: respond-async`: a worker computes the study, of the system as it was when it was asked for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.integration.api.conftest import Service, finished, serving, working
from tests.integration.api.documents import PNEUMATIC, STEP

LATER = {"Prefer": "respond-async"}
STUDIES: list[tuple[str, str, dict[str, Any]]] = [
    ("simulations", "simulation", {"input": STEP, "variants": [{}, {"kp": 120}]}),
    ("frequency-responses", "frequency_response", {"open_at": "controller"}),
    ("influence", "influence", {"input": "reference", "output": "position", "parameters": ["kp"], "metrics": ["overshoot"]}),
    ("spectra", "spectrum", {"input": STEP, "output": "velocity", "quantity": "transform"}),
]  # fmt: skip


@pytest.fixture
def alone(sqlite_template: Path, tmp_path: Path) -> Iterator[Service]:
    """A service without a worker."""
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with serving(f"sqlite:///{path}") as running:
        yield running


def test_a_worker_computes_what_was_asked_for_of_the_revision_that_there_was(alone) -> None:
    with alone.client() as client:
        system = client.post("/v1/systems", json=PNEUMATIC)
        name = system.json()["id"]
        at_once = [client.post(f"/v1/{path}", json={"system": name, **body}).json() for path, _, body in STUDIES]
        accepted = [
            client.post(f"/v1/{path}", json={"system": name, **body}, headers=LATER) for path, _, body in STUDIES
        ]
        softer = {**PNEUMATIC, "parameters": PNEUMATIC["parameters"] | {"kp": {"value": 50, "unit": "cm**2/s"}}}
        changed = client.put(f"/v1/systems/{name}", json=softer, headers={"If-Match": system.headers["ETag"]})
        assert changed.json()["revision"] == 2
        assert [reply.status_code for reply in accepted] == [202] * len(STUDIES)
        for reply, (_, kind, _body) in zip(accepted, STUDIES, strict=True):
            assert (reply.headers["Preference-Applied"], reply.json()["kind"]) == ("respond-async", kind)
            assert reply.headers["Location"] == f"/v1/jobs/{reply.json()['id']}"
        with working(alone.database_url):
            ended = [finished(client, reply.json()) for reply in accepted]
        assert [job["status"] for job in ended] == ["succeeded"] * len(STUDIES), ended
        results = [client.get(job["result"]).json() for job in ended]
    for result, same in zip(results, at_once, strict=True):
        assert result["system"] == {"id": name, "revision": 1}
        result.pop("versions")
        assert result == same


def test_what_is_wrong_is_told_at_once_and_makes_no_job(alone) -> None:
    wrong = {"system": PNEUMATIC, "input": STEP, "variants": [{}, {"kq": 120}]}
    with alone.client() as client:
        later, at_once = (client.post("/v1/simulations", json=wrong, headers=given) for given in (LATER, {}))
        assert later.status_code == at_once.status_code == 422
        assert later.json() == at_once.json()
        assert client.get("/v1/jobs").json()["items"] == []


def test_a_job_is_made_once_for_a_key(alone) -> None:
    body = {"system": PNEUMATIC, "input": STEP}
    with alone.client() as client:
        first, again = (
            client.post("/v1/simulations", json=body, headers={**LATER, "Idempotency-Key": "once"}) for _ in range(2)
        )
        assert first.json()["id"] == again.json()["id"]
        assert len(client.get("/v1/jobs").json()["items"]) == 1
