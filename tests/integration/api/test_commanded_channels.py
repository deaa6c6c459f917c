"""The output of a drive among the channels of a measurement: told to agents that know it, refused where it makes no sense."""

from __future__ import annotations

from typing import Any

import pytest

from tests.integration.api.rigs import AGENT, MEASUREMENT, RIG


def _ask(client, rig: str, understands: list[str], **change: Any):
    reply = client.post("/v1/agents", json=AGENT | {"rig": rig, "document": RIG | {"understands": understands}})
    assert reply.status_code == 200, reply.text
    return reply.json()["id"], client.post("/v1/acquisitions", json=MEASUREMENT | {"rig": rig} | change)


def test_an_agent_is_told_to_keep_what_it_plays(client, request) -> None:
    agent, asked = _ask(client, request.node.name, ["commanded"], channels=["valve", "position"])
    assert asked.status_code == 202, asked.text
    told = client.post(f"/v1/agents/{agent}/claim").json()["request"]
    assert (told["channels"], told["commanded"]) == (["position"], True)


@pytest.mark.parametrize(
    ("understands", "change", "pointer", "says"),
    [
        (["trigger"], {"channels": ["position", "valve"]}, "/channels", "update the agent"),
        (["commanded"], {"channels": ["valve"]}, "/channels", "at least one input"),
        (
            ["commanded"],
            {"channels": ["position", "valve"], "drive": None},
            "/channels/1",
            "output of the drive, got 'valve'",
        ),
        (["commanded"], {"channels": ["position", "valve", "valve"]}, "/channels/2", "named once"),
    ],
)
def test_what_cannot_be_kept_is_refused_at_its_place(client, understands, change, pointer, says) -> None:
    _, reply = _ask(client, "commanded", understands, **change)
    assert reply.status_code == 422, reply.text
    (wrong,) = reply.json()["errors"]
    assert (wrong["pointer"], says in wrong["detail"]) == (pointer, True), wrong
