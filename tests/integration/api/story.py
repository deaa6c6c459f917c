"""One use of every operation, in an order that makes sense: what the examples in the API reference are recorded from.

``python -m tests.integration.api.story`` plays it against a service of its own and writes ``api/examples.json``.
"""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from api.app.main import create_app
from api.formats.writing.uff import FrequencyResponse, write
from api.settings import Settings
from storage import open_database
from tests.integration.api.conftest import finished, serving, working
from tests.integration.api.documents import RAW, lag_recording, sha256
from tests.integration.api.rigs import AGENT, CHANNELS, MEASUREMENT, samples

TARGET = Path(__file__).parents[3] / "api" / "examples.json"
DATA = lag_recording(samples=2000)
_TEXT = "application/json"

SYSTEM: dict[str, Any] = {
    "name": "position loop",
    "parameters": {
        "kp": {"value": 4, "unit": "1/s", "lower": 0.5, "upper": 40, "scale": "log", "doc": "proportional gain"},
        "tau": {"value": 50, "unit": "ms", "lower": 0.001, "upper": 0.5},
    },
    "blocks": {
        "reference": {"kind": "input"},
        "error": {"kind": "sum", "signs": "+-"},
        "controller": {"kind": "gain", "gain": "=kp"},
        "drive": {"kind": "transfer_function", "numerator": [1], "denominator": ["=tau", 1, 0]},
    },
    "connections": [
        {"from": "reference", "to": "error.in1"},
        {"from": "drive", "to": "error.in2"},
        {"from": "error", "to": "controller"},
        {"from": "controller", "to": "drive"},
    ],
    "outputs": {"position": "drive", "control": "controller"},
}
PLANT: dict[str, Any] = {
    "name": "lag",
    "parameters": {"k": {"value": 1, "lower": 0.1, "upper": 10}, "tau": {"value": 0.2, "unit": "s", "lower": 0.001}},
    "blocks": {
        "u": {"kind": "input"},
        "plant": {"kind": "transfer_function", "numerator": ["=k"], "denominator": ["=tau", 1]},
    },
    "connections": [{"from": "u", "to": "plant"}],
    "outputs": {"y": "plant"},
}
STEP = {"port": "reference", "signal": {"kind": "step", "amplitude": 1}}
RECORDED = {"inputs": {"u": "u"}, "outputs": {"y": "y"}}


@dataclass
class Story:
    """Plays the story and remembers, for each operation, what was sent and what came back."""

    client: httpx.Client
    examples: dict[str, dict[str, Any]] = field(default_factory=dict)

    def ask(
        self,
        operation: str,
        *,
        body: Any = None,
        content: bytes | None = None,
        headers: dict[str, str] | None = None,
        query: dict[str, Any] | None = None,
        **names: str,
    ) -> Any:
        """Make one request and return its JSON; ``names`` fill the path."""
        method, _, path = operation.partition(" ")
        for name, value in names.items():
            path = path.replace(f"{{{name}}}", value)
        reply = self.client.request(method, path, json=body, content=content, headers=headers, params=query)
        assert reply.is_success, (operation, reply.text)
        example: dict[str, Any] = {
            "status": reply.status_code,
            "parameters": {**names, **(query or {}), **(headers or {})},
        }
        if body is not None:
            example["request"] = body
        kind = reply.headers.get("Content-Type", "").partition(";")[0]
        if kind == _TEXT:
            example["reply"] = shortened(reply.json())
        elif kind.startswith("text/"):
            example["reply"] = reply.text[:300].rsplit("\n", 1)[0] + "\n"
        self.examples[operation] = example
        return reply.json() if kind == _TEXT else None


def shortened(value: Any) -> Any:
    """Return a reply with its lists cut, its numbers rounded and its secrets replaced."""
    match value:
        case dict():
            return {key: shortened(item) for key, item in value.items()}
        case list():
            return [shortened(item) for item in value[: 1 if value and isinstance(value[0], dict) else 3]]
        case float():
            return float(f"{value:.5g}")
        case str():
            return re.sub(r"\b(st|whsec)_[\w/+=-]{40,}", r"\1_...", value)
    return value


def tell(story: Story, wait: Callable[[dict[str, Any]], Any]) -> None:
    """Use every operation once."""
    ask = story.ask
    for path in (
        "/healthz",
        "/readyz",
        "/metrics",
        "/v1/catalog/elements",
        "/v1/catalog/signals",
        "/v1/catalog/metrics",
    ):
        ask(f"GET {path}")
    ask("GET /v1/catalog/methods")
    _systems(ask)
    _studies(ask)
    dataset = _datasets(ask)
    _functions(story, wait)
    _webhooks(story, dataset, wait)
    optimization = _jobs(ask, wait)
    _schedules(ask, optimization)
    _measurements(ask)
    _access(ask)


def _systems(ask: Callable[..., Any]) -> None:
    one = "/v1/systems/{identifier}"
    key = {"Idempotency-Key": "8e03978e-40d5-43e8-bc93-6894a57f9324"}
    identifier = ask("POST /v1/systems", body=SYSTEM, headers=key)["id"]
    ask("GET /v1/systems", query={"limit": 20})
    ask(f"GET {one}", identifier=identifier)
    ask(
        f"PUT {one}",
        body=SYSTEM | {"name": "position loop, new drive"},
        headers={"If-Match": '"1"'},
        identifier=identifier,
    )
    ask(f"GET {one}/revisions", identifier=identifier)
    ask(f"GET {one}/revisions/{{number}}", identifier=identifier, number="1")
    ask(f"GET {one}/state-space", identifier=identifier, query={"open_at": "error"})
    ask("POST /v1/simulations", body={"system": identifier, "input": STEP, "samples": 200, "keep": True})
    ask(f"DELETE {one}", headers={"If-Match": '"2"'}, identifier=identifier)


def _studies(ask: Callable[..., Any]) -> None:
    result = ask(
        "POST /v1/simulations",
        body={"system": SYSTEM, "input": STEP, "outputs": ["position"], "metrics": ["rise_time", "overshoot"],
              "samples": 200, "variants": [{"kp": 4}, {"kp": 8}], "keep": True},
    )  # fmt: skip
    ask(
        "POST /v1/frequency-responses",
        body={"system": SYSTEM, "open_at": "error", "from": "reference", "to": "position", "frequencies": [1, 10, 100]},
    )
    ask("POST /v1/state-space", body={"system": SYSTEM, "parameters": {"kp": 8}})
    ask(
        "POST /v1/influence",
        body={"system": SYSTEM, "input": "reference", "output": "position", "parameters": ["kp", "tau"],
              "metrics": ["rise_time", "overshoot"], "change": 0.1},
    )  # fmt: skip
    ask("GET /v1/results", query={"kind": "simulation"})
    ask("GET /v1/results/{identifier}", identifier=result["id"])
    ask("GET /v1/results/{identifier}/report", query={"format": "html"}, identifier=result["id"])
    said = ask("POST /v1/comments", body={"about": result["id"], "text": "Overshoots with kp = 8: keep 4."})["id"]
    ask("GET /v1/comments", query={"about": result["id"]})
    ask("GET /v1/comments/{identifier}", identifier=said)
    ask("DELETE /v1/comments/{identifier}", headers={"If-Match": '"1"'}, identifier=said)


def _functions(story: Story, wait: Callable[[dict[str, Any]], Any]) -> None:
    """Read a function of frequency of a universal file, which comes in as other files do."""
    w = 2 * np.pi * np.arange(1.0, 101.0)
    response = FrequencyResponse(
        frequency=w / (2 * np.pi), values=1 / (400.0**2 - w**2 + 40j * w), response="x", reference="f",
        response_unit="m", reference_unit="N",
    )  # fmt: skip
    content = b"".join(write([response], recorded=datetime(2026, 1, 2, tzinfo=UTC)))
    one = f"/v1/datasets/{story.client.post('/v1/datasets', json={'name': 'hammer', 'format': 'uff'}).json()['id']}"
    story.client.put(f"{one}/segments/{sha256(content)}", content=content)
    manifest = {"segments": [sha256(content)], "sha256": sha256(content)}
    wait(story.client.post(f"{one}/commit", json=manifest).json()["job"])
    (listed,) = story.client.get(one).json()["functions"]
    read = "GET /v1/datasets/{identifier}/functions/{name}"
    story.ask(read, identifier=one.rpartition("/")[2], name=listed["name"])


def _datasets(ask: Callable[..., Any]) -> str:
    one = "/v1/datasets/{identifier}"
    identifier = ask("POST /v1/datasets", body=RAW)["id"]
    digest = sha256(DATA)
    octets = {"Content-Type": "application/octet-stream"}
    ask(f"PUT {one}/segments/{{sha256}}", content=DATA, headers=octets, identifier=identifier, sha256=digest)
    ask(f"GET {one}/segments", identifier=identifier)
    ask(f"POST {one}/commit", body={"segments": [digest], "sha256": digest}, identifier=identifier)
    ask("GET /v1/datasets", query={"limit": 20})
    ask(f"GET {one}", identifier=identifier)
    ask(f"GET {one}/channels/{{name}}", query={"start": 0.5, "end": 1.5}, identifier=identifier, name="y")
    ask(f"GET {one}/original", identifier=identifier)
    ask(f"GET {one}/export", query={"format": "csv", "end": 0.002}, identifier=identifier)
    table = {"name": "bench 3", "format": "csv"}
    file = ask("POST /v1/datasets", body=table)["id"]
    text = b"t [s];force [N]\n0,000;1,5\n0,001;1,75\n0,002;2\n"
    names = {"identifier": file, "sha256": sha256(text)}
    ask(f"PUT {one}/segments/{{sha256}}", content=text, headers=octets, **names)
    ask(f"POST {one}/preview", body={"segments": [sha256(text)]}, identifier=file)
    steps = [
        {"kind": "cut", "start": 0.1},
        {"kind": "filter", "band": "low_pass", "frequency": {"value": 50, "unit": "Hz"}, "channels": ["y"]},
        {"kind": "differentiate", "channel": "y", "name": "velocity"},
    ]
    ask("POST /v1/processings", body={"name": "lag, filtered", "sources": [identifier], "steps": steps})
    frf = ask(
        "POST /v1/frfs",
        body={"dataset": identifier, "input": "u", "output": "y", "segment": 0.5, "keep": True,
              "system": PLANT, "from": "u", "to": "y", "parameters": {"k": 3, "tau": 0.05}},
    )  # fmt: skip
    ask("GET /v1/frfs/{identifier}/uff", identifier=frf["id"])
    ask("POST /v1/spectra", body={"dataset": identifier, "channel": "y", "window": "hann", "segment": 0.5})
    ask(
        "POST /v1/validations",
        body={"system": PLANT, "dataset": identifier, **RECORDED, "parameters": {"k": 3, "tau": 0.05}},
    )
    ask(
        "POST /v1/identifications",
        body={"system": PLANT, "dataset": identifier, **RECORDED, "parameters": ["k", {"parameter": "tau", "upper": 1}],
              "offsets": "estimate"},
    )  # fmt: skip
    ask("GET /v1/lineage/{identifier}", query={"direction": "down"}, identifier=identifier)
    ask("GET /v1/lineage/{identifier}/bundle", identifier=identifier)
    other = ask("POST /v1/datasets", body=RAW)["id"]
    ask(f"DELETE {one}", headers={"If-Match": '"1"'}, identifier=other)
    return str(identifier)


def _webhooks(story: Story, dataset: str, wait: Callable[[dict[str, Any]], Any]) -> None:
    ask, one = story.ask, "/v1/webhooks/{identifier}"
    body = {
        "name": "maintenance",
        "url": "https://maintenance.example/servotune",
        "events": ["alert.validation", "job.failed"],
    }
    identifier = ask("POST /v1/webhooks", body=body)["id"]
    ask("GET /v1/webhooks")
    ask(f"GET {one}", identifier=identifier)
    ask(f"PUT {one}", body=body | {"active": False}, headers={"If-Match": '"1"'}, identifier=identifier)
    validation = {"system": PLANT, "dataset": dataset, **RECORDED, "limit_percent": 0.001, "diagnose": "never"}
    wait(story.client.post("/v1/validations", json=validation, headers={"Prefer": "respond-async"}).json())
    alert = ask("GET /v1/alerts", query={"kind": "validation"})["items"][0]
    ask("GET /v1/alerts/{identifier}", identifier=alert["id"])
    ask(f"POST {one}/test", identifier=identifier)
    ask(f"GET {one}/deliveries", identifier=identifier)
    # Not the one that is being tried: how often that has failed changes by itself.
    spare = story.client.post("/v1/webhooks", json=body | {"name": "spare"}).json()["id"]
    ask(f"DELETE {one}", headers={"If-Match": "*"}, identifier=spare)


def _schedules(ask: Callable[..., Any], optimization: dict[str, Any]) -> None:
    one = "/v1/schedules/{identifier}"
    nightly = {
        "name": "every night",
        "cron": "30 2 * * mon-fri",
        "time_zone": "Europe/Bucharest",
        "job": {"kind": "optimization", "body": optimization},
        "overlap": "skip",
        "missed": "one",
    }
    identifier = ask("POST /v1/schedules", body=nightly)["id"]
    ask("GET /v1/schedules")
    ask(f"GET {one}", identifier=identifier)
    ask(f"PUT {one}", body=nightly | {"cron": "0 3 * * *"}, headers={"If-Match": '"1"'}, identifier=identifier)
    ask(f"POST {one}/trigger", identifier=identifier)
    ask(f"GET {one}/runs", identifier=identifier)
    ask(f"POST {one}/pause", identifier=identifier)
    ask(f"POST {one}/resume", identifier=identifier)
    ask(f"DELETE {one}", headers={"If-Match": "*"}, identifier=identifier)


def _measurements(ask: Callable[..., Any]) -> None:
    one, attempt = "/v1/acquisitions/{identifier}", "/v1/acquisitions/{identifier}/attempts/{number}"
    agent = ask("POST /v1/agents", body=AGENT)
    ask("GET /v1/agents")
    ask("GET /v1/agents/{identifier}", identifier=agent["id"])
    ask("GET /v1/rigs")
    ask("GET /v1/rigs/{identifier}", identifier=agent["rig_id"])
    template = "/v1/acquisition-templates/{identifier}"
    kept = ask("POST /v1/acquisition-templates", body=MEASUREMENT)["id"]
    ask("GET /v1/acquisition-templates")
    ask(f"GET {template}", identifier=kept)
    ask(f"PUT {template}", body=MEASUREMENT | {"duration": 1}, headers={"If-Match": '"1"'}, identifier=kept)
    given_up = ask("POST /v1/acquisitions", body={"template": kept, "duration": 0.5})["id"]
    ask(f"DELETE {template}", headers={"If-Match": '"2"'}, identifier=kept)
    ask("GET /v1/acquisitions", query={"rig": "bench-1", "status": "queued"})
    ask(f"POST {one}/cancel", identifier=given_up)
    ask(f"POST {one}/retry", identifier=given_up)
    claim = ask("POST /v1/agents/{identifier}/claim", query={"wait": 20}, identifier=agent["id"])
    names = {"identifier": claim["acquisition"], "number": str(claim["attempt"])}
    preview = {"start": 0, "step": 0.05, "channels": {"position": [[0.0, 0.4], [0.4, 1.2]]}}
    beat = {"agent": agent["id"], "status": "running", "progress": 0.5, "preview": preview}
    ask(f"POST {attempt}/heartbeat", body=beat, **names)
    opening = {"agent": agent["id"], "start_time": claim["time"], "sample_rate": 1024, "channels": CHANNELS}
    dataset = ask(f"POST {attempt}/dataset", body=opening, **names)["id"]
    data = samples()
    put = "PUT /v1/datasets/{identifier}/segments/{sha256}"
    ask(
        put, content=data, headers={"Content-Type": "application/octet-stream"}, identifier=dataset, sha256=sha256(data)
    )
    manifest = {"segments": [sha256(data)], "sha256": sha256(data)}
    ask("POST /v1/datasets/{identifier}/commit", body=manifest, identifier=dataset)
    ask(f"POST {attempt}/finish", body={"agent": agent["id"], "facts": {"actual_rate": 1024}}, **names)
    ask(f"GET {one}", identifier=claim["acquisition"])
    ask(f"GET {one}/events", headers={"Last-Event-ID": "1"}, identifier=claim["acquisition"])


def _jobs(ask: Callable[..., Any], wait: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    one = "/v1/jobs/{identifier}"
    body = {
        "system": SYSTEM,
        "variables": [{"parameter": "kp"}],
        "experiments": [{"name": "step", "input": STEP}],
        "goals": [
            {"metric": "response_time", "experiment": "step", "output": "position", "sense": "minimize"},
            {"metric": "overshoot", "experiment": "step", "output": "position", "upper": 0.05},
        ],
        "method": {"kind": "gradient", "starts": 2, "seed": 1},
    }
    # One that has not ended by the time it is paused, however often it is asked for the wrong way first.
    long = ask("POST /v1/optimizations", body=body | {"method": {"kind": "grid", "points": {"kp": 1_000_000}}})
    ask(f"POST {one}/pause", identifier=long["id"])
    ask(f"POST {one}/resume", identifier=long["id"])
    ask(f"POST {one}/cancel", identifier=long["id"])
    job = ask("POST /v1/optimizations", body=body)
    ask("GET /v1/jobs", query={"kind": "optimization", "limit": 20})
    wait(job)
    ask(f"GET {one}", identifier=job["id"])
    ask(f"GET {one}/result", identifier=job["id"])
    ask(f"GET {one}/request", identifier=job["id"])
    ask(f"GET {one}/script", identifier=job["id"])
    ask(f"GET {one}/report", query={"format": "html"}, identifier=job["id"])
    ask(f"GET {one}/events", headers={"Last-Event-ID": "1"}, identifier=job["id"])
    ask(f"POST {one}/cancel", identifier=job["id"])
    return body


def _access(ask: Callable[..., Any]) -> None:
    room = ask("POST /v1/workspaces", body={"name": "test bench", "limits": {"systems": 100}})["id"]
    ask("GET /v1/workspaces")
    ask("GET /v1/workspaces/{identifier}", identifier=room)
    ask("PUT /v1/workspaces/{identifier}", body={"name": "bench 1"}, headers={"If-Match": '"1"'}, identifier=room)
    body = {"name": "lab PC 3", "scopes": ["read", "acquire"], "expires_at": "2030-01-01T00:00:00Z"}
    key = ask("POST /v1/keys", body=body)["id"]
    ask("GET /v1/keys")
    ask("GET /v1/keys/{identifier}", identifier=key)
    ask("POST /v1/keys/{identifier}/rotate", body={"overlap": 3600}, identifier=key)
    ask("DELETE /v1/keys/{identifier}", identifier=key)
    ask("GET /v1/audit", query={"action": "key.rotate"})
    ask("POST /v1/tickets")
    ask("POST /v1/session")
    ask("GET /v1/session")
    ask("DELETE /v1/session")


def told(client: httpx.Client) -> dict[str, dict[str, Any]]:
    """Play the story against a service that has a worker; return the examples."""
    story = Story(client)
    tell(story, lambda job: finished(client, job))
    return story.examples


def _record() -> Iterator[dict[str, dict[str, Any]]]:
    with tempfile.TemporaryDirectory() as folder:
        url = f"sqlite:///{folder}/story.db"
        database = open_database(url)
        database.migrate()
        database.dispose()
        with working(url), serving(url) as service, service.client() as client:
            yield told(client)


def operations() -> list[str]:
    """Return every operation of the service."""
    paths = create_app(Settings.model_construct()).openapi()["paths"]
    return [f"{method.upper()} {path}" for path, methods in paths.items() for method in methods]


if __name__ == "__main__":
    for examples in _record():
        TARGET.write_text(json.dumps(examples, indent=1, sort_keys=True, ensure_ascii=False) + "\n", encoding="utf-8")
