"""From samples to numbers and back: the chain of a real study, deleted from, exported, and repeated on another installation."""

from __future__ import annotations

import copy
import hashlib
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import servotune
from api.schemas.lineage import LineageReply
from tests.integration.api.conftest import Service, finished, serving, working
from tests.integration.api.documents import LAG, RAW, lag_recording, upload

SAMPLES = 1500
FASTER = {
    "variables": [{"parameter": "tau", "lower": 0.01, "upper": 0.2}],
    "experiments": [{"name": "step", "input": {"port": "u", "signal": {"kind": "step"}}}],
    "goals": [{"metric": "rise_time", "experiment": "step", "output": "y", "sense": "minimize"}],
    "method": {"kind": "gradient", "starts": 1, "seed": 3},
}
CASE = {"inputs": {"u": "u"}, "outputs": {"y": "y"}}


@pytest.fixture(scope="module")
def client(sqlite_service):
    with sqlite_service.client() as own:
        yield own


@pytest.fixture(scope="module")
def chain(client, sqlite_worker) -> dict[str, str]:
    """Record, cut, identify, write the estimates into the model, validate, optimise, write that into the model, simulate."""
    dataset = upload(client, RAW, lag_recording(samples=SAMPLES)).json()["id"]
    cut = client.post(
        "/v1/processings",
        json={"name": "cut", "sources": [dataset], "steps": [{"kind": "cut", "start": 0.1, "end": 1.3}]},
    )
    assert cut.status_code == 201, cut.text
    processed = cut.json()["id"]
    system = client.post("/v1/systems", json=LAG).json()["id"]
    asked = {"system": system, "dataset": processed, **CASE, "parameters": ["k", "tau"], "offsets": "estimate"}
    identification = finished(client, client.post("/v1/identifications", json=asked).json())
    found = client.get(identification["result"]).json()["parameters"]
    model = copy.deepcopy(LAG)
    for name, estimate in found.items():
        model["parameters"][name] |= {"value": estimate["value"], "unit": estimate["unit"] or "1"}
    changed = client.put(
        f"/v1/systems/{system}",
        json=model,
        headers={"If-Match": '"1"'},
        params={"derived_from": identification["id"]},
    )
    assert changed.status_code == 200, changed.text
    validation = finished(
        client,
        client.post(
            "/v1/validations",
            json={"system": system, "dataset": dataset, **CASE, "offsets": "estimate"},
            headers={"Prefer": "respond-async"},
        ).json(),
    )
    assert client.get(validation["result"]).json()["verdict"] == "pass"
    optimization = finished(client, client.post("/v1/optimizations", json=FASTER | {"system": system}).json())
    model["parameters"]["tau"] = {"value": client.get(optimization["result"]).json()["best"]["tau"], "unit": "s"}
    client.put(
        f"/v1/systems/{system}",
        json=model,
        headers={"If-Match": '"2"'},
        params={"derived_from": optimization["id"]},
    )
    kept = client.post(
        "/v1/simulations",
        json={"system": system, "input": {"port": "u", "signal": {"kind": "step"}}, "samples": 50, "keep": True},
    ).json()["id"]
    return {
        "dataset": dataset,
        "processed": processed,
        "system": system,
        "first": f"{system}@1",
        "second": f"{system}@2",
        "identification": identification["id"],
        "third": f"{system}@3",
        "validation": validation["id"],
        "optimization": optimization["id"],
        "kept": kept,
    }


def graph(client, identifier: str, **query: str) -> dict[str, Any]:
    reply = client.get(f"/v1/lineage/{identifier}", params=query)
    assert reply.status_code == 200, reply.text
    LineageReply.model_validate(reply.json())
    found: dict[str, Any] = reply.json()
    return found


def test_one_call_returns_the_way_from_the_samples_to_the_verdict(client, chain) -> None:
    found = graph(client, chain["validation"], direction="up")
    edges = {(edge["from"], edge["to"], edge["role"]) for edge in found["edges"]}
    assert edges == {
        (chain["dataset"], chain["processed"], "source"),
        (chain["processed"], chain["identification"], "data"),
        (chain["first"], chain["identification"], "model"),
        (chain["first"], chain["second"], "revision"),
        (chain["identification"], chain["second"], "parameters"),
        (chain["second"], chain["validation"], "model"),
        (chain["dataset"], chain["validation"], "data"),
    }
    nodes = {node["id"]: node for node in found["nodes"]}
    assert nodes[chain["dataset"]]["facts"]["sha256"] == client.get(f"/v1/datasets/{chain['dataset']}").json()["sha256"]
    assert set(nodes[chain["identification"]]["facts"]["versions"]) >= {"servotune", "numpy", "scipy"}
    down = graph(client, chain["dataset"], direction="down")
    assert {chain["validation"], chain["identification"], chain["kept"]} <= {node["id"] for node in down["nodes"]}


def test_structures_that_were_compared_belong_to_it(client) -> None:
    first, second = (client.post("/v1/systems", json=LAG | {"name": name}).json()["id"] for name in ("one", "two"))
    alternatives = [{"name": "given", "system": first}, {"name": "other", "system": second}]
    job = client.post("/v1/optimizations", json=FASTER | {"system": first, "alternatives": alternatives})
    assert job.status_code == 202, job.text
    client.post(f"/v1/jobs/{job.json()['id']}/cancel")
    sources = {edge["from"] for edge in graph(client, job.json()["id"], direction="up")["edges"]}
    assert sources == {f"{first}@1", f"{second}@1"}


def test_a_revision_must_say_where_its_numbers_really_come_from(client, chain) -> None:
    for wrong in ("job_" + "0" * 26, chain["dataset"]):
        reply = client.post("/v1/systems", json=LAG, params={"derived_from": wrong})
        assert reply.status_code == 422, reply.text
        assert "derived_from must be a finished job or a kept study" in reply.json()["detail"]
    kept = client.post("/v1/systems", json=LAG, params={"derived_from": chain["kept"]}).json()["id"]
    assert (chain["kept"], f"{kept}@1") in {(e["from"], e["to"]) for e in graph(client, kept)["edges"]}


def test_a_deletion_tells_what_depends_on_it(client, chain) -> None:
    where = f"/v1/datasets/{chain['dataset']}"
    reply = client.delete(where, headers={"If-Match": "*"})
    assert reply.status_code == 409
    problem = reply.json()
    assert problem["type"].endswith(":has-dependents")
    assert {entry["id"] for entry in problem["dependents"]} == {chain["processed"], chain["validation"]}
    assert chain["processed"] in problem["detail"]
    assert client.get(where).status_code == 200
    free = upload(client, RAW, lag_recording(samples=20)).json()["id"]
    client.post("/v1/validations", json={"system": LAG, "dataset": free, **CASE, "keep": True})
    assert client.delete(f"/v1/datasets/{free}", headers={"If-Match": "*"}).status_code == 409
    forced = client.delete(f"/v1/datasets/{free}", headers={"If-Match": "*"}, params={"force": True})
    assert forced.status_code == 204
    gone = next(node for node in graph(client, free)["nodes"] if node["id"] == free)
    assert gone["exists"] is False


def test_what_is_incomplete_is_not_exported(client, chain) -> None:
    dataset = upload(client, RAW, lag_recording(samples=30)).json()["id"]
    kept = client.post("/v1/validations", json={"system": LAG, "dataset": dataset, **CASE, "keep": True}).json()["id"]
    client.delete(f"/v1/datasets/{dataset}", headers={"If-Match": "*"}, params={"force": True})
    reply = client.get(f"/v1/lineage/{kept}/bundle")
    assert reply.status_code == 409
    assert reply.json()["missing"] == [dataset]
    assert client.get("/v1/lineage/job_none/bundle").status_code == 404


def command(service: Service, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {
        "SERVOTUNE_URL": service.url,
        "SERVOTUNE_KEY": service.keys["admin"],
        "PYTHONPATH": ":".join(sys.path),
    }
    return subprocess.run(
        [sys.executable, "-m", "servotune", "lineage", *arguments],
        env=environment,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )


def test_a_bundle_repeats_to_the_same_numbers_elsewhere(sqlite_service, chain, sqlite_template, tmp_path) -> None:
    output = tmp_path / "bundle.zip"
    exported = command(sqlite_service, "export", chain["kept"], "--output", str(output))
    assert exported.returncode == 0, exported.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["bundle.zip"]
    with zipfile.ZipFile(output) as archive:
        names = set(archive.namelist())
        assert archive.read(f"datasets/{chain['dataset']}/original") == lag_recording(samples=SAMPLES)
        manifest = json.loads(archive.read("manifest.json"))
    made = ("first", "second", "third")
    assert {f"models/{chain[name]}.json" for name in made} <= names
    assert {f"jobs/{chain[name]}.json" for name in ("identification", "optimization")} <= names
    # it holds what the numbers need, not what else was made from the same samples
    assert f"jobs/{chain['validation']}.json" not in names
    assert set(manifest["versions"]) >= {"servotune", "numpy", "scipy"}
    assert manifest["seeds"] == {chain["optimization"]: 3}

    database = tmp_path / "other.db"
    database.write_bytes(sqlite_template.read_bytes())
    with working(f"sqlite:///{database}"), serving(f"sqlite:///{database}") as other:
        done = command(other, "replay", str(output), "--tolerance", "1e-9")
        assert done.returncode == 0, done.stdout + done.stderr
        assert "the same within 1e-09" in done.stdout
        assert all(word in done.stdout for word in ("identification", "optimization", "simulation", "dataset"))
        with servotune.connect(other.url, key=other.keys["admin"]) as client:
            # the lineage there is the same graph
            kept = client._transport.get("/v1/results", params={"kind": "simulation"})["items"][0]["id"]
            there = client.lineage.get(kept, direction="up")
            assert sorted(e["role"] for e in there["edges"]) == sorted(e["role"] for e in manifest["edges"])


TEXT = {
    "name": "text",
    "format": "txt",
    "import": {
        "delimiter": ",",
        "decimal": ".",
        "header_lines": 1,
        "sample_rate": 1000,
        "columns": [{"index": 0, "name": "u", "unit": "V"}, {"index": 1, "name": "y", "unit": "mm"}],
    },
}


def test_a_number_that_was_changed_is_found(client, sqlite_service, sqlite_worker, tmp_path) -> None:
    rows = np.frombuffer(lag_recording(samples=40)).reshape(-1, 2)
    text = "u,y\n" + "\n".join(f"{u!r},{y!r}" for u, y in rows.tolist()) + "\n"
    parsing = upload(client, TEXT, text.encode()).json()["job"]
    assert finished(client, parsing)["status"] == "succeeded"
    dataset = client.get("/v1/datasets").json()["items"][0]["id"]
    kept = client.post("/v1/validations", json={"system": LAG, "dataset": dataset, **CASE, "keep": True}).json()["id"]
    output = tmp_path / "bundle.zip"
    with servotune.connect(sqlite_service.url, key=sqlite_service.keys["admin"]) as own:
        own.lineage.export(kept, output)
    spoiled = spoil(output, f"studies/{kept}.json", tmp_path / "spoiled.zip")
    failed = command(sqlite_service, "replay", str(spoiled))
    assert failed.returncode == 1
    assert "NOT the same" in failed.stdout
    assert "outputs.y.fit_percent" in failed.stdout
    # the file was read again as it had been described
    again = client.get("/v1/datasets").json()["items"][0]["id"]
    assert again != dataset
    assert client.get(f"/v1/datasets/{again}/original").text == text


def spoil(bundle: Path, name: str, target: Path) -> Path:
    """Change a fit by a thousandth, with a checksum that hides it."""
    with zipfile.ZipFile(bundle) as source, zipfile.ZipFile(target, "w") as copied:
        manifest = json.loads(source.read("manifest.json"))
        document = json.loads(source.read(name))
        document["result"]["outputs"]["y"]["fit_percent"] *= 1.001
        changed = json.dumps(document).encode()
        manifest["files"][name] = hashlib.sha256(changed).hexdigest()
        for entry in source.namelist():
            content = {name: changed, "manifest.json": json.dumps(manifest).encode()}.get(entry)
            copied.writestr(entry, source.read(entry) if content is None else content)
    return target


def test_the_command_says_what_is_wrong(sqlite_service, tmp_path) -> None:
    wrong = command(sqlite_service, "export", "job_none", "--output", str(tmp_path / "x.zip"))
    assert (wrong.returncode, list(tmp_path.iterdir())) == (1, [])
    assert "does not exist" in wrong.stderr
    (tmp_path / "text.zip").write_text("no bundle")
    broken = command(sqlite_service, "replay", str(tmp_path / "text.zip"))
    assert broken.returncode == 1
    assert "must be an exported lineage" in broken.stderr
