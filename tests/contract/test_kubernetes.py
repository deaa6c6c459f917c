"""The manifests name commands, settings, addresses and keys that exist; kubectl puts them together where it is installed."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.contract.test_deployment import IMAGE, KNOWN, takes_its_arguments

FOLDER = Path(__file__).parents[2] / "deploy" / "kubernetes"
DOCUMENTS: list[dict[str, Any]] = [
    document
    for path in sorted(FOLDER.rglob("*.yaml"))
    for document in yaml.safe_load_all(path.read_text())
    if document["kind"] != "Kustomization"
]
PODS = {
    document["metadata"]["name"]: document["spec"]["template"]
    for document in DOCUMENTS
    if document["kind"] in {"Deployment", "Job"}
}
OPENAPI: dict[str, Any] = json.loads((FOLDER.parents[1] / "openapi" / "openapi.json").read_text())


def container(name: str) -> dict[str, Any]:
    (found,) = PODS[name]["spec"]["containers"]
    return dict(found)


def test_there_are_a_service_a_worker_and_a_migration() -> None:
    assert set(PODS) == {"servotune-api", "servotune-worker", "servotune-migrate"}


@pytest.mark.parametrize("name", PODS)
def test_commands_and_settings_exist(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    given = container(name)
    takes_its_arguments(given["args"], capsys)
    assert {entry["name"] for entry in given["env"]} <= KNOWN


@pytest.mark.parametrize("name", PODS)
def test_nothing_runs_as_root_or_writes_but_where_it_may(name: str) -> None:
    spec, given = PODS[name]["spec"], container(name)
    user = int(re.findall(r"--uid (\d+)", IMAGE)[0])
    assert spec["securityContext"]["runAsNonRoot"] is True
    assert spec["securityContext"]["runAsUser"] == user
    assert spec["automountServiceAccountToken"] is False
    assert given["securityContext"]["readOnlyRootFilesystem"] is True
    assert given["securityContext"]["capabilities"] == {"drop": ["ALL"]}
    mounted = {entry["mountPath"]: entry["name"] for entry in given["volumeMounts"]}
    assert set(mounted) == {"/tmp", *re.findall(r"^VOLUME (\S+)$", IMAGE, flags=re.MULTILINE)}
    assert set(mounted.values()) == {entry["name"] for entry in spec["volumes"]}


def test_probes_ask_addresses_that_there_are() -> None:
    given = container("servotune-api")
    paths = {given[probe]["httpGet"]["path"] for probe in ("startupProbe", "livenessProbe", "readinessProbe")}
    paths.add(PODS["servotune-api"]["metadata"]["annotations"]["prometheus.io/path"])
    assert paths == {"/healthz", "/readyz", "/metrics"}
    assert paths <= set(OPENAPI["paths"])
    assert given["ports"][0]["containerPort"] == int(re.findall(r"^EXPOSE (\d+)$", IMAGE, flags=re.MULTILINE)[0])


def test_what_chooses_pods_chooses_some() -> None:
    labels = [pod["metadata"]["labels"] for pod in PODS.values()]
    for document in DOCUMENTS:
        spec = document["spec"]
        selector = spec.get("podSelector") or spec.get("selector") or {}
        wanted = selector.get("matchLabels", selector)
        if document["kind"] != "ScaledObject":
            assert any(wanted.items() <= entry.items() for entry in labels), document["metadata"]["name"]
        else:
            assert spec["scaleTargetRef"]["name"] in PODS


@pytest.mark.skipif(shutil.which("kubectl") is None, reason="kubectl must be installed")
@pytest.mark.parametrize("which", ["base", "scaling"])
def test_kubectl_puts_them_together(which: str) -> None:
    done = subprocess.run(
        ["kubectl", "kustomize", str(FOLDER / which)], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr
    made = {(entry["kind"], entry["metadata"]["name"]): entry for entry in yaml.safe_load_all(done.stdout)}
    assert ("Service", "servotune") in made
    assert (("ScaledObject", "servotune-worker") in made) == (which == "scaling")
    # Whoever scales says how many there are: a number in the manifest would undo it.
    assert ("replicas" in made["Deployment", "servotune-worker"]["spec"]) == (which == "base")
    for kind in ("Deployment", "PodDisruptionBudget"):
        selector = made[kind, "servotune-api"]["spec"]["selector"]["matchLabels"]
        assert selector == {"app.kubernetes.io/component": "api", "app.kubernetes.io/name": "servotune"}
