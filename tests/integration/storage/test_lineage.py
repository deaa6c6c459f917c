"""The graph of what was made from what, on both databases."""

from __future__ import annotations

import pytest

from storage.errors import NotFoundError
from storage.lineage import model_key, sources_in
from storage.models import DEFAULT_WORKSPACE, Dataset, JobStatus, Workspace
from storage.models.base import utc_now
from storage.repositories import (
    DatasetRepository,
    JobRepository,
    LineageRepository,
    ProcessingRepository,
    ResultRepository,
    ScheduleRepository,
    SystemRepository,
)
from storage.repositories.jobs import finish

OWN = DEFAULT_WORKSPACE


@pytest.fixture
def session(database):
    with database.session() as opened:
        yield opened
        opened.rollback()


def edges(graph) -> set[tuple[str, str]]:
    return set(graph.edges)


def ids(graph) -> set[str]:
    return {node.id for node in graph.nodes}


def chain(session) -> dict[str, str]:
    """Make dataset -> identification -> second revision -> validation, the model's first revision beside it."""
    dataset = DatasetRepository(session, OWN).create(name="run", format="raw").id
    systems, jobs = SystemRepository(session, OWN), JobRepository(session, OWN)
    system = systems.create(name="drive", document={"name": "drive"}).id
    first = {"request": {"dataset": dataset, "system": {}}, "system_reference": {"id": system, "revision": 1}}
    identification = jobs.create(kind="identification", body=first).id
    systems.update(system, name="drive", document={"name": "drive"}, expected_revision=1, derived_from=identification)
    second = {"request": {"dataset": dataset, "system": {}}, "system_reference": {"id": system, "revision": 2}}
    validation = jobs.create(kind="validation", body=second).id
    return {
        "dataset": dataset,
        "system": system,
        "first": model_key(system, 1),
        "second": model_key(system, 2),
        "identification": identification,
        "validation": validation,
    }


def test_a_document_names_its_sources_wherever_they_stand() -> None:
    dataset, job, system = ("ds_" + "1" * 26, "job_" + "2" * 26, "sys_" + "3" * 26)
    document = {
        "request": {"input": [{"signal": {"dataset": dataset}}], "identification": job, "again": dataset},
        "system_reference": {"id": system, "revision": 7},
        "name": "sys_of_mine", "other": {"id": system}, "text": f"about {job}",
    }  # fmt: skip
    assert sources_in(document) == [dataset, job, f"{system}@7"]
    assert sources_in(None) == []


def test_the_whole_chain_is_found_from_each_of_its_nodes(session) -> None:
    made = chain(session)
    everything = {
        (made["dataset"], made["identification"]),
        (made["first"], made["identification"]),
        (made["first"], made["second"]),
        (made["identification"], made["second"]),
        (made["second"], made["validation"]),
        (made["dataset"], made["validation"]),
    }
    lineage = LineageRepository(session, OWN)
    up = lineage.graph(made["validation"])
    assert edges(up) == everything
    assert ids(up) == {key for name, key in made.items() if name != "system"}
    assert edges(lineage.graph(made["dataset"])) == everything - {
        (made["first"], made["identification"]),
        (made["first"], made["second"]),
    }
    assert edges(lineage.graph(made["system"])) == everything
    assert edges(lineage.graph(made["first"], direction="up")) == set()
    assert edges(lineage.graph(made["first"], direction="down")) >= {(made["first"], made["second"])}
    kinds = {node.id: node.kind for node in up.nodes}
    assert (kinds[made["first"]], kinds[made["dataset"]], kinds[made["validation"]]) == (
        "model",
        "dataset",
        "validation",
    )


def test_siblings_are_no_relatives(session) -> None:
    made = chain(session)
    other = JobRepository(session, OWN).create(kind="validation", body={"request": {"dataset": made["dataset"]}}).id
    assert other not in ids(LineageRepository(session, OWN).graph(made["validation"]))
    assert other in ids(LineageRepository(session, OWN).graph(made["dataset"]))


def test_a_recording_comes_from_the_job_that_wrote_it(session) -> None:
    datasets, jobs = DatasetRepository(session, OWN), JobRepository(session, OWN)
    file = datasets.create(name="file", format="csv")
    jobs.create(kind="dataset", body={"dataset": file.id})  # a look at the file, before it was read
    parsing = jobs.create(kind="dataset", body={"dataset": file.id}).id
    file.job_id = parsing
    session.flush()
    made = ProcessingRepository(session, OWN).create(
        name="cut", sources=[file.id], steps=[], combine=None, description={}, versions={}, start_time=None
    )
    lineage = LineageRepository(session, OWN)
    assert edges(lineage.graph(made.id)) == {(parsing, file.id), (file.id, made.id)}
    assert edges(lineage.graph(parsing)) == {(parsing, file.id), (file.id, made.id)}
    # what only read it into place depends on nothing
    assert [node.id for node in lineage.dependents(file.id)] == [made.id]


def test_an_origin_is_remembered(session) -> None:
    datasets = DatasetRepository(session, OWN)
    first = datasets.create(name="one", format="raw").id
    mean = datasets.create(name="mean", format="raw", origin={"mean_of": {"dataset": first}}).id
    assert edges(LineageRepository(session, OWN).graph(first)) == {(first, mean)}


def test_a_job_and_its_result_are_one_node(session) -> None:
    made = chain(session)
    result = (
        ResultRepository(session, OWN)
        .create(kind="validation", body={"verdict": "pass"}, versions={"servotune": "1"})
        .id
    )
    assert finish(session, made["validation"], status=JobStatus.SUCCEEDED, result_id=result)
    lineage = LineageRepository(session, OWN)
    assert ids(lineage.graph(result)) == ids(lineage.graph(made["validation"]))
    node = next(node for node in lineage.graph(result).nodes if node.id == made["validation"])
    assert node.facts["versions"] == {"servotune": "1"}


def test_what_was_deleted_leaves_its_place(session) -> None:
    made = chain(session)
    DatasetRepository(session, OWN).delete(made["dataset"])
    found = LineageRepository(session, OWN).graph(made["validation"])
    gone = next(node for node in found.nodes if node.id == made["dataset"])
    assert (gone.kind, gone.exists, gone.name) == ("dataset", False, "")
    assert (made["dataset"], made["validation"]) in edges(found)
    assert made["validation"] in ids(LineageRepository(session, OWN).graph(made["dataset"]))


def test_dependents_are_named_unless_they_failed(session) -> None:
    made = chain(session)
    lineage = LineageRepository(session, OWN)
    assert [node.id for node in lineage.dependents(made["dataset"])] == [made["identification"], made["validation"]]
    finish(session, made["validation"], status=JobStatus.FAILED, error={"title": "no"})
    assert [node.id for node in lineage.dependents(made["dataset"])] == [made["identification"]]
    assert lineage.dependents(made["system"]) == []
    schedule = ScheduleRepository(session, OWN).create(
        name="nightly", cron="0 2 * * *", time_zone="UTC", kind="validation",
        body={"system": made["system"], "dataset": made["dataset"]}, overlap="skip", missed="one", paused=False,
        next_at=utc_now(),
    )  # fmt: skip
    assert [(node.kind, node.id) for node in lineage.dependents(made["system"])] == [("schedule", schedule.id)]
    assert lineage.dependents(made["dataset"])[-1].id == schedule.id


def test_another_workspace_sees_nothing(session) -> None:
    made = chain(session)
    session.add(Workspace(id="ws_lineage", name="other"))
    session.flush()
    other = LineageRepository(session, "ws_lineage")
    for key in made.values():
        with pytest.raises(NotFoundError):
            other.graph(key)
    # naming a foreign thing in one's own request shows that one named it, and nothing else
    job = (
        JobRepository(session, "ws_lineage")
        .create(kind="validation", body={"request": {"dataset": made["dataset"]}})
        .id
    )
    found = other.graph(job)
    assert [(node.id, node.exists, dict(node.facts)) for node in found.nodes if node.id != job] == [
        (made["dataset"], False, {})
    ]
    assert job not in ids(LineageRepository(session, OWN).graph(made["dataset"]))
    assert session.get(Dataset, made["dataset"]) is not None


@pytest.mark.parametrize(
    "key", ["ds_none", "sys_none", "sys_none@1", "job_none", "nothing", "sys_x@999999999999999999999"]
)
def test_what_never_was_has_no_lineage(session, key) -> None:
    with pytest.raises(NotFoundError):
        LineageRepository(session, OWN).graph(key)
