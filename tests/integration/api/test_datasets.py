"""/v1/datasets: segments in any order, verified; raw samples at once, files by a job; channels in their units."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from api.schemas.replies import ChannelReply, DatasetReply
from tests.integration.api.conftest import finished
from tests.integration.api.documents import RAW, lag_recording, sha256, upload

TEXT = b"""DAQ v2
recorded 20.3.2019 4:17:03 PM
n,time,position,force
0,4:17:03 PM,0.10,1.0
1,4:17:03 PM,0.20,2.0,start
2,4:17:03 PM,-0.30,4.0
3,4:17:03 PM,0.40,8.0
"""
FILE = {
    "name": "bench",
    "format": "txt",
    "import": {
        "delimiter": ",",
        "decimal": ".",
        "header_lines": 3,
        "sample_rate": 10,
        "columns": [
            {"index": 2, "name": "position", "unit": "mm", "scale": 10},
            {"index": 3, "name": "force", "unit": "N", "scale": -2, "offset": 1},
        ],
    },
}


def create(client, **fields):
    reply = client.post("/v1/datasets", json=RAW | fields)
    assert reply.status_code == 201, reply.text
    return reply.headers["Location"]


def test_raw_samples_are_ready_at_once_and_come_back_as_sent(client) -> None:
    data = lag_recording(samples=3000)
    reply = upload(client, RAW, data)
    assert reply.status_code == 200, reply.text
    body = reply.json()
    DatasetReply.model_validate(body)
    assert (body["status"], body["sample_count"], body["size"], body["sha256"]) == (
        "ready",
        3000,
        len(data),
        sha256(data),
    )
    assert body["document"] == RAW
    assert body["start_time"] == "2026-01-01T07:00:00+00:00"
    where = f"/v1/datasets/{body['id']}"
    assert client.get(where).json()["channels"] == RAW["channels"]
    original = client.get(f"{where}/original")
    assert original.content == data
    assert original.headers["Content-Type"] == "application/octet-stream"
    samples = np.frombuffer(data, "<f8").reshape(-1, 2)
    channel = client.get(f"{where}/channels/y").json()
    ChannelReply.model_validate(channel)
    assert channel["unit"] == "mm"
    assert channel["values"] == samples[:, 1].tolist()
    assert channel["time"] == (np.arange(3000) / 1000).tolist()


def test_a_stretch_has_both_its_ends(client) -> None:
    where = f"/v1/datasets/{upload(client, RAW, lag_recording(samples=3000)).json()['id']}"
    part = client.get(f"{where}/channels/u", params={"start": 1, "end": 1.004}).json()
    assert part["time"] == [1.0, 1.001, 1.002, 1.003, 1.004]


def test_the_decimated_channel_keeps_every_peak(client) -> None:
    data = np.zeros((20_000, 2))
    data[12_345, 1] = 7.0
    data[777, 1] = -3.0
    where = f"/v1/datasets/{upload(client, RAW, data.tobytes(), segment=160_000).json()['id']}"
    whole = client.get(f"{where}/channels/y").json()["values"]
    one = client.get(f"{where}/channels/y", params={"points": 1})
    assert (one.status_code, one.json()["min"], one.json()["max"]) == (200, [min(whole)], [max(whole)]), one.text
    for points in (2, 50, 1000):
        assert 0 < len(client.get(f"{where}/channels/y", params={"points": points}).json()["min"]) <= points
    found = client.get(f"{where}/channels/y", params={"points": 50}).json()
    ChannelReply.model_validate(found)
    assert len(found["time"]) <= 50
    assert max(found["max"]) == 7.0
    assert min(found["min"]) == -3.0
    assert "values" not in found


@pytest.mark.parametrize(
    ("rate", "said"),
    [
        (1e-320, ">= 1e-06, got 1e-320"),
        (1e-300, ">= 1e-06, got 1e-300"),
        (1e13, "<= 1000000000000.0, got 10000000000000.0"),
    ],
)
def test_a_rate_of_no_recording_is_refused_when_it_is_opened(client, rate, said) -> None:
    before = client.get("/v1/datasets").json()["items"]
    for body, pointer in (
        (RAW | {"sample_rate": rate}, "/sample_rate"),
        ({"name": "x", "import": {"sample_rate": rate}}, "/import/sample_rate"),
    ):
        refused = client.post("/v1/datasets", json=body)
        assert refused.status_code == 422
        (error,) = refused.json()["errors"]
        assert (error["pointer"], error["detail"]) == (pointer, f"sample_rate must be {said}")
    assert client.get("/v1/datasets").json()["items"] == before


def test_calibration_is_applied_on_reading(client) -> None:
    channels = [{"name": "u", "unit": "V", "scale": -2.0, "offset": 1.0}, {"name": "y", "unit": "mm"}]
    data = np.array([[1.0, 0.0], [3.0, 0.0]])
    where = f"/v1/datasets/{upload(client, RAW | {'channels': channels}, data.tobytes()).json()['id']}"
    assert client.get(f"{where}/channels/u").json()["values"] == [-1.0, -5.0]
    assert client.get(f"{where}/original").content == data.tobytes()


def test_segments_may_come_twice_and_in_any_order(client) -> None:
    where = create(client)
    data = lag_recording(samples=300)
    pieces = [data[:1600], data[1600:3200], data[3200:]]
    replies = [client.put(f"{where}/segments/{sha256(p)}", content=p) for p in (pieces[2], pieces[0], pieces[0])]
    assert [reply.status_code for reply in replies] == [201, 201, 200]
    manifest = {"segments": [sha256(piece) for piece in pieces], "sha256": sha256(data)}
    early = client.post(f"{where}/commit", json=manifest)
    assert early.status_code == 409
    assert early.json()["missing"] == [sha256(pieces[1])]
    client.put(f"{where}/segments/{sha256(pieces[1])}", content=pieces[1])
    listed = client.get(f"{where}/segments").json()["items"]
    assert {row["sha256"]: row["size"] for row in listed} == {sha256(piece): len(piece) for piece in pieces}
    assert client.post(f"{where}/commit", json=manifest).json()["status"] == "ready"
    assert client.post(f"{where}/commit", json=manifest).json()["status"] == "ready"
    assert client.get(f"{where}/original").content == data
    late = client.put(f"{where}/segments/{sha256(b'x' * 16)}", content=b"x" * 16)
    assert late.status_code == 409


def test_a_file_is_parsed_by_a_job(client, worker) -> None:
    reply = upload(client, FILE, TEXT, segment=20)
    assert reply.status_code == 202, reply.text
    assert reply.json()["status"] == "parsing"
    where = f"/v1/datasets/{reply.json()['id']}"
    assert reply.headers["Location"] == f"/v1/jobs/{reply.json()['job']['id']}"
    assert finished(client, reply.json()["job"])["status"] == "succeeded"
    body = client.get(where).json()
    assert (body["status"], body["sample_count"], body["sample_rate"]) == ("ready", 4, 10)
    assert client.get(f"{where}/channels/position").json()["values"] == [1.0, 2.0, -3.0, 4.0]
    assert client.get(f"{where}/channels/force").json()["values"] == [-1.0, -3.0, -7.0, -15.0]
    assert client.get(f"{where}/original").content == TEXT


def test_a_file_that_is_not_what_its_description_says_fails_with_the_line(client, worker) -> None:
    reply = upload(client, FILE, TEXT.replace(b"-0.30", b"n/a"))
    job = finished(client, reply.json()["job"])
    assert job["status"] == "failed"
    assert job["error"]["line"] == 6
    body = client.get(f"/v1/datasets/{reply.json()['id']}").json()
    assert body["status"] == "failed"
    assert "line 6" in body["error"]["detail"]
    assert client.get(f"/v1/datasets/{body['id']}/channels/force").status_code == 409


def test_a_dataset_is_deleted_with_its_etag(client) -> None:
    where = create(client)
    tag = client.get(where).headers["ETag"]
    assert client.delete(where).status_code == 428
    assert client.delete(where, headers={"If-Match": '"9"'}).status_code == 412
    assert client.delete(where, headers={"If-Match": tag}).status_code == 204
    assert client.get(where).status_code == 404


def test_the_list_holds_the_newest_first(client) -> None:
    first, second = create(client), create(client)
    items = client.get("/v1/datasets", params={"limit": 2}).json()["items"]
    assert [f"/v1/datasets/{item['id']}" for item in items] == [second, first]


def channels(**fields):
    return [RAW["channels"][0] | fields, RAW["channels"][1]]


def file_with(**fields):
    document = copy.deepcopy(FILE)
    document["import"].update(fields)
    return document


WRONG = {
    "no name": (RAW | {"name": ""}, "/name"),
    "unknown format": (RAW | {"format": "xls"}, "/format"),
    "no channels": (RAW | {"channels": []}, "/channels"),
    "channels left out": ({key: value for key, value in RAW.items() if key != "channels"}, "/channels"),
    "no rate": ({key: value for key, value in RAW.items() if key != "sample_rate"}, "/sample_rate"),
    "rate 0": (RAW | {"sample_rate": 0}, "/sample_rate"),
    "rate a text": (RAW | {"sample_rate": "fast"}, "/sample_rate"),
    "time without zone": (RAW | {"start_time": "2026-01-01T08:00:00"}, "/start_time"),
    "no time": (RAW | {"start_time": "yesterday"}, "/start_time"),
    "unknown unit": (RAW | {"channels": channels(unit="parrot")}, "/channels/0/unit"),
    "scale 0": (RAW | {"channels": channels(scale=0)}, "/channels/0/scale"),
    "name twice": (RAW | {"channels": channels(name="y")}, "/channels/1/name"),
    "import for raw": (RAW | {"import": FILE["import"]}, "/import"),
    "unknown field": (RAW | {"colour": "red"}, "/colour"),
    "unknown sensor field": (RAW | {"channels": channels(sensor={"age": 3})}, "/channels/0/sensor/age"),
    "file with a sample rate": ({"name": "x", "format": "csv", "sample_rate": 5}, "/sample_rate"),
    "neither index nor source": (file_with(columns=[{"name": "x"}]), "/import/columns/0/index"),
    "both index and source": (file_with(time={"index": 1, "source": "t"}), "/import/time/index"),
    "time in mm": (file_with(time={"index": 1, "unit": "mm"}), "/import/time/unit"),
    "no time zone": (file_with(time_zone="Mars/Olympus"), "/import/time_zone"),
    "wrong unit": (file_with(columns=[{"index": 1, "name": "x", "unit": "parrot"}]), "/import/columns/0/unit"),
    "file with channels": (FILE | {"channels": RAW["channels"]}, "/channels"),
    "no columns": (file_with(columns=[]), "/import/columns"),
    "negative column": (file_with(columns=[{"index": -1, "name": "x"}]), "/import/columns/0/index"),
    "decimal a letter": (file_with(decimal="x"), "/import/decimal"),
    "delimiter and decimal the same": (file_with(delimiter=".", decimal="."), "/import/delimiter"),
    "negative header": (file_with(header_lines=-1), "/import/header_lines"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_dataset_is_refused_at_its_place(client, case) -> None:
    document, pointer = WRONG[case]
    reply = client.post("/v1/datasets", json=document)
    assert reply.status_code == 422, reply.text
    assert any(entry["pointer"] == pointer for entry in reply.json()["errors"]), reply.text


def test_wrong_segments_are_refused_and_nothing_is_kept(client) -> None:
    where = create(client)
    data = lag_recording(samples=10)
    assert client.put(f"{where}/segments/{'0' * 64}", content=data).status_code == 422
    assert client.put(f"{where}/segments/{'z' * 64}", content=data).status_code == 422
    assert client.put(f"{where}/segments/short", content=data).status_code == 422
    assert client.put(f"{where}/segments/{sha256(b'')}", content=b"").status_code == 422
    odd = data[:-1]
    assert client.put(f"{where}/segments/{sha256(odd)}", content=odd).status_code == 422
    large = b"x" * ((8 << 20) + 16)
    too_large = client.put(f"{where}/segments/{sha256(large)}", content=large)
    assert too_large.status_code == 413
    assert str(8 << 20) in too_large.json()["detail"]
    assert client.put(f"/v1/datasets/ds_nothing/segments/{sha256(data)}", content=data).status_code == 404
    assert client.get(f"{where}/segments").json()["items"] == []


def test_a_segment_of_eight_mebibytes_passes(client) -> None:
    where = create(client)
    data = bytes(8 << 20)
    assert client.put(f"{where}/segments/{sha256(data)}", content=data).status_code == 201


@pytest.mark.parametrize(
    "body",
    [
        {},
        {"segments": [], "sha256": "0" * 64},
        {"segments": ["xyz"], "sha256": "0" * 64},
        {"segments": ["0" * 64]},
        {"segments": ["0" * 64], "sha256": "0" * 63},
        {"segments": "0" * 64, "sha256": "0" * 64},
        {"segments": ["0" * 64], "sha256": "0" * 64, "force": True},
    ],
)
def test_a_wrong_commit_is_refused(client, body) -> None:
    assert client.post(f"{create(client)}/commit", json=body).status_code == 422


def test_a_wrong_checksum_of_the_whole_is_refused(client) -> None:
    where = create(client)
    data = lag_recording(samples=10)
    client.put(f"{where}/segments/{sha256(data)}", content=data)
    reply = client.post(f"{where}/commit", json={"segments": [sha256(data)], "sha256": "0" * 64})
    assert reply.status_code == 422
    assert client.get(where).json()["status"] == "open"


def test_a_name_is_no_formula_in_a_spreadsheet(client) -> None:
    channels = [{**RAW["channels"][0], "name": "=1+1"}, RAW["channels"][1]]
    ready = f"/v1/datasets/{upload(client, RAW | {'channels': channels}, lag_recording(samples=10)).json()['id']}"
    head = client.get(f"{ready}/export", params={"format": "csv"}).text.splitlines()[0]
    assert head.split(",")[1].startswith("'=1+1")


def test_channels_that_cannot_be_read_say_why(client) -> None:
    where = create(client)
    assert client.get(f"{where}/channels/u").status_code == 409  # still open
    assert client.get(f"{where}/original").status_code == 409
    unread = create(client, format="txt", channels=None, sample_rate=None, start_time=None)
    for place in (where, unread):
        for name in ("csv", "mat", "parquet", "hdf5"):
            reply = client.get(f"{place}/export", params={"format": name})
            assert reply.status_code == 409, reply.text
            assert "must be ready, it is open" in reply.json()["detail"]
    ready = f"/v1/datasets/{upload(client, RAW, lag_recording(samples=100)).json()['id']}"
    assert client.get(f"{ready}/channels/ghost").status_code == 404
    for query in ("start=9", "start=0.05&end=0.01", "points=0", "points=x", "start=nan", "end=inf"):
        assert client.get(f"{ready}/channels/u?{query}").status_code == 422, query
