from __future__ import annotations

from pathlib import Path

import pytest

from servotune.bundles import BundleError
from servotune.errors import ConflictError, NotFoundError
from tests.unit.servotune.conftest import Answer

JOB = {"id": "job_1", "kind": "validation", "status": "queued", "progress": 0.0, "message": "", "result": None}
CASE = {"dataset": "ds_1", "inputs": {"u": "u"}, "outputs": {"y": "y"}}


def test_a_validation_says_where_its_parameters_come_from(service, client) -> None:
    service.on("POST /v1/validations", Answer({"verdict": "pass", "outputs": {}}))
    assert client.validate("sys_1", **CASE, identification="job_7", points=50)["verdict"] == "pass"
    assert service.asked[0].json == {"system": "sys_1", **CASE, "identification": "job_7", "points": 50}


def test_a_validation_may_be_left_to_a_worker(service, client) -> None:
    service.on("POST /v1/validations", Answer(JOB, status=202))
    job = client.validate_later("sys_1", **CASE)
    assert (job.id, job.kind) == ("job_1", "validation")
    assert service.asked[0].headers["Prefer"] == "respond-async"
    assert service.asked[0].headers["Idempotency-Key"]


def test_what_depends_on_a_dataset_is_told(service, client) -> None:
    dependents = [{"id": "job_1", "kind": "validation", "name": "validation"}]
    refusal = {"title": "Conflict", "detail": "must have nothing", "dependents": dependents}
    service.on("DELETE /v1/datasets/ds_1", Answer(refusal, status=409))
    with pytest.raises(ConflictError) as caught:
        client.datasets.delete("ds_1")
    assert caught.value.problem["dependents"] == dependents
    service.on("DELETE /v1/datasets/ds_1", Answer(b"", status=204))
    client.datasets.delete("ds_1", force=True)
    assert service.asked[-1].path == "/v1/datasets/ds_1?force=true"


def test_an_export_that_fails_leaves_nothing_behind(service, client, tmp_path: Path) -> None:
    with pytest.raises(NotFoundError):
        client.lineage.export("job_1", tmp_path / "bundle.zip")
    assert list(tmp_path.iterdir()) == []
    service.on("GET /v1/lineage/job_1/bundle", Answer(b"bytes", headers={"Content-Type": "application/zip"}))
    client.lineage.export("job_1", tmp_path / "bundle.zip")
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("bundle.zip", b"bytes")]
    with pytest.raises(BundleError):
        client.lineage.repeat(tmp_path / "bundle.zip")


def test_the_graph_is_asked_for_in_one_direction(service, client) -> None:
    service.on("GET /v1/lineage/ds_1", Answer({"id": "ds_1", "nodes": [], "edges": [], "truncated": False}))
    assert client.lineage.get("ds_1", direction="down")["edges"] == []
    assert service.asked[0].path == "/v1/lineage/ds_1?direction=down"
