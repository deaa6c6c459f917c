"""A large recording is read by a worker: the agent asks until it is, and keeps its own samples until then."""

from __future__ import annotations

from agent import uploading
from api.services.recordings import parsing, raw_samples
from storage import open_database
from storage.models import DEFAULT_WORKSPACE


def test_the_agent_waits_until_a_large_recording_is_read(service, lab, monkeypatch) -> None:
    monkeypatch.setattr(raw_samples, "AT_ONCE", 0)
    monkeypatch.setattr(uploading, "_ASK", 0.05)
    with lab.agent():
        asked = lab.ask()

        def recording() -> dict[str, object]:
            identifier = lab.attempt(asked)["dataset"]
            return lab.client.get(f"/v1/datasets/{identifier}").json() if identifier else {"status": "none"}

        lab.until(lambda: recording()["status"] == "parsing", what=recording)
        assert len(lab.runs()) == 1
        assert lab.get(asked)["status"] == "uploading"
        # what a worker does; none is here
        database = open_database(service.database_url)
        parsing.run(
            {"dataset": recording()["id"]}, database=database, workspace=DEFAULT_WORKSPACE, progress=lambda *_: None
        )
        database.dispose()
        done = lab.wait(asked)
    attempt = done["attempts"][0]
    assert (done["status"], attempt["error"]) == ("done", None)
    assert len(lab.samples(done["dataset"])) == attempt["facts"]["samples"]
    assert lab.runs() == []
