"""Files of several time bases: every group a recording of its own, none resampled, equal to what other readers find."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
import scipy.signal
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsFile, TdmsWriter

from tests.integration.api.conftest import finished
from tests.integration.api.documents import sha256
from tests.integration.api.test_imports import imported, matlab, values
from tests.unit.api.test_labview_columns import file_of

RNG = np.random.default_rng(29)
FAST, SLOW, SWITCH = RNG.normal(size=1000), RNG.normal(size=77), RNG.random(77) > 0.5


@pytest.fixture(scope="module")
def client(sqlite_service, sqlite_worker):
    with sqlite_service.client() as client:
        yield client


def tdms_of_two_rates(slow=SLOW):
    target = io.BytesIO()
    with TdmsWriter(target) as writer:
        writer.write_segment(
            [
                ChannelObject("fast", "force", FAST, {"wf_increment": 1e-3, "unit_string": "N"}),
                ChannelObject("slow", "temperature", slow, {"wf_increment": 0.1, "unit_string": "degC"}),
                ChannelObject("slow", "force", SWITCH, {"wf_increment": 0.1}),
            ]
        )
    return target.getvalue()


def mdf_of_two_rates(tmp_path, version):
    fast, slow = np.arange(1000) / 1000, np.arange(77) / 10
    with MDF(version=version) as file:
        file.append([Signal(FAST, fast, name="force", unit="N")])
        file.append([Signal(SLOW, slow, name="temperature"), Signal(SWITCH.astype("u1"), slow, name="switch")])
        # in a group of its own, at the instants of the first
        file.append([Signal(2 * FAST, fast, name="twice", invalidation_bits=FAST > 0)])
        return Path(file.save(tmp_path / "x.mf4", overwrite=True)).read_bytes()


def test_groups_of_tdms_become_recordings(client):
    content = tdms_of_two_rates()
    first = imported(client, "tdms", content)
    assert first["status"] == "ready", first["error"]
    theirs = TdmsFile.read(io.BytesIO(content))
    fast, slow = first["groups"]
    assert (fast["name"], fast["dataset_id"], fast["sample_rate"], fast["sample_count"]) == (
        "fast",
        first["id"],
        1e3,
        1000,
    )
    second = client.get(f"/v1/datasets/{slow['dataset_id']}").json()
    assert (second["name"], second["sample_rate"], second["sample_count"]) == ("recording: slow", 10, 77)
    assert second["groups"] == first["groups"]
    np.testing.assert_array_equal(values(client, first, "fast/force"), FAST)
    np.testing.assert_array_equal(values(client, second, "temperature"), theirs["slow"]["temperature"][:])
    np.testing.assert_array_equal(values(client, second, "slow/force"), theirs["slow"]["force"][:].astype(float))
    lineage = client.get(f"/v1/lineage/{second['id']}").json()
    assert first["id"] in {node["id"] for node in lineage["nodes"]}
    assert client.get(f"/v1/datasets/{first['id']}/original").content == content
    none = client.get(f"/v1/datasets/{second['id']}/original")
    assert none.status_code == 409, none.text
    assert f"one group of a file, which '{first['id']}' has" in none.json()["detail"]
    refused = client.delete(f"/v1/datasets/{first['id']}", headers={"If-Match": f'"{first["revision"]}"'})
    assert refused.status_code == 409
    assert second["id"] in refused.text


def test_the_group_that_was_asked_for_is_the_recording_that_was_sent(client):
    first = imported(client, "tdms", tdms_of_two_rates(), group="slow")
    assert (first["sample_rate"], first["sample_count"]) == (10, 77)
    assert [group["name"] for group in first["groups"]] == ["slow", "fast"]
    wrong = imported(client, "tdms", tdms_of_two_rates(), group="medium")
    assert "group must be one of the file's (fast, slow), got 'medium'" in wrong["error"]["detail"]


def proposed(client, content, *names):
    """Return what a look at a file finds, and the columns of some names that it proposes, whatever their groups."""
    where = client.post("/v1/datasets", json={"name": "bench", "format": "tdms"}).headers["Location"]
    client.put(f"{where}/segments/{sha256(content)}", content=content)
    job = client.post(f"{where}/preview", json={"segments": [sha256(content)]}).json()["job"]
    assert finished(client, job)["status"] == "succeeded"
    look = client.get(f"/v1/jobs/{job['id']}/result").json()
    return look, [one for group in look["groups"] for one in group["columns"] if one["name"] in names]


def test_columns_of_several_groups_are_several_recordings(client):
    """What a page sends, which names every column: it was refused for their lengths, or held one group alone."""
    content = tdms_of_two_rates()
    look, columns = proposed(client, content, "fast/force", "temperature")
    assert [(one["name"], one["sample_rate"], one["sample_count"]) for one in look["groups"]] == [
        ("fast", 1000, 1000),
        ("slow", 10, 77),
    ]
    columns[1] |= {"name": "oil", "scale": 2.0, "unit": "K"}
    first = imported(client, "tdms", content, columns=columns)
    assert first["status"] == "ready", first["error"]
    fast, slow = first["groups"]
    assert (fast["channels"], slow["channels"]) == (["fast/force"], ["oil"])
    second = client.get(f"/v1/datasets/{slow['dataset_id']}").json()
    np.testing.assert_allclose(values(client, second, "oil"), 2 * SLOW, rtol=1e-15)
    assert second["channels"][0]["unit"] == "K"


def test_columns_of_one_group_are_one_recording(client):
    content = tdms_of_two_rates()
    _, columns = proposed(client, content, "temperature", "slow/force")
    only = imported(client, "tdms", content, columns=columns)
    assert (only["status"], only["groups"], only["sample_rate"]) == ("ready", [], 10)
    np.testing.assert_array_equal(values(client, only, "slow/force"), SWITCH.astype(float))


def test_columns_beside_another_group_are_refused(client):
    _, columns = proposed(client, tdms_of_two_rates(), "temperature")
    wrong = imported(client, "tdms", tdms_of_two_rates(), columns=columns, group="fast")
    assert "a column must be one of the file's (fast/force), got 'temperature'" in wrong["error"]["detail"]


def test_groups_are_brought_to_one_time_when_that_is_asked_for(client):
    slow = np.sin(np.arange(77) / 20)
    fast, slow_one = imported(client, "tdms", tdms_of_two_rates(slow=slow))["groups"]
    body = {
        "name": "together",
        "sources": [fast["dataset_id"], slow_one["dataset_id"]],
        "steps": [{"kind": "resample", "rate": 100}, {"kind": "cut", "start": 0, "end": 0.9}],
        "combine": "side_by_side",
    }
    reply = client.post("/v1/processings", json=body)
    assert reply.status_code == 201, reply.text
    made = reply.json()
    assert (made["sample_rate"], made["sample_count"]) == (100, 91)
    expected = scipy.signal.resample_poly(slow, 10, 1, padtype="line")[:91]
    found = values(client, made, "temperature")
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("version", ["3.30", "4.10"])
def test_groups_of_mdf_become_recordings(client, tmp_path, version):
    content = mdf_of_two_rates(tmp_path, version)
    first = imported(client, "mdf", content)
    assert first["status"] == "ready", first["error"]
    second = client.get(f"/v1/datasets/{first['groups'][1]['dataset_id']}").json()
    assert (first["sample_rate"], second["sample_rate"]) == (pytest.approx(1000), pytest.approx(10))
    assert [channel["name"] for channel in first["channels"]] == ["force", "twice"]
    np.testing.assert_array_equal(values(client, first, "force"), FAST)
    np.testing.assert_array_equal(values(client, second, "temperature"), SLOW)
    np.testing.assert_array_equal(values(client, second, "switch"), SWITCH.astype(float))
    if version.startswith("4"):
        np.testing.assert_array_equal(values(client, first, "twice"), np.where(FAST > 0, np.nan, 2 * FAST))


def test_a_group_without_a_rate_is_refused_by_name_and_can_be_asked_for(client):
    content = matlab(a={"t": np.arange(50) / 10, "x": np.ones(50)}, b={"y": np.arange(40.0)})
    first = imported(client, "mat", content)
    assert (first["status"], first["sample_count"], first["groups"]) == ("ready", 50, [])
    assert "sample_rate must be given in import" in first["report"]["refused"]["b"]
    second = imported(client, "mat", content, group="b", sample_rate=5)
    assert (second["sample_rate"], second["sample_count"]) == (5, 40)


def test_a_file_whose_second_group_is_bad_leaves_nothing(client):
    before = {one["id"] for one in client.get("/v1/datasets", params={"limit": 1000}).json()["items"]}
    bad = imported(client, "tdms", tdms_of_two_rates(slow=np.where(np.arange(77) == 5, np.inf, SLOW)))
    assert (bad["status"], bad["groups"]) == ("failed", [])
    assert "channel 'temperature' must be finite or missing, got an infinity at sample 5" in bad["error"]["detail"]
    after = {one["id"] for one in client.get("/v1/datasets", params={"limit": 1000}).json()["items"]}
    assert after - before == {bad["id"]}


def test_columns_of_labview_text_with_their_own_instants_become_recordings(client):
    uneven = np.cumsum(RNG.uniform(0.5, 1.5, size=30)) * 0.001
    channels = {"fast": (np.arange(80) * 0.001, RNG.normal(size=80)), "late": (uneven, RNG.normal(size=30))}
    first = imported(client, "lvm", file_of(channels, kind="Multi", step=0.001).encode())
    assert first["status"] == "ready", first["error"]
    fast, late = first["groups"]
    assert (fast["sample_rate"], fast["sample_count"], fast["channels"]) == (1000, 80, ["fast"])
    assert (late["sample_rate"], late["sample_count"], late["channels"]) == (None, 30, ["time", "late"])
    second = client.get(f"/v1/datasets/{late['dataset_id']}").json()
    assert second["uneven"]
    np.testing.assert_allclose(values(client, second, "late"), channels["late"][1], atol=5e-7)
    np.testing.assert_allclose(values(client, second, "time"), uneven - uneven[0], atol=1.1e-6)
