"""Originals are left out once their channels hold all that was in them, where the operator wants it; nothing else is."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator

import h5py
import httpx
import numpy as np
import pytest
from sqlalchemy import select

import servotune
from api.services.recordings import raw_samples
from servotune.repeating import repeat
from storage import open_database
from storage.models import AuditEntry, DatasetSegment
from storage.originals import Comparison
from tests.integration.api.conftest import Service, finished, serving, working
from tests.integration.api.documents import RAW, lag_recording, sha256, upload

TEXT = b"x\n" + b"".join(b"%d\n" % (number % 7) for number in range(5000))


@pytest.fixture(scope="module")
def sparing(module_database_url: str) -> Iterator[Service]:
    """A service, with a worker, that keeps originals until they are verified."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SERVOTUNE_KEEP_ORIGINALS", "until-verified")
        with serving(module_database_url) as running, working(module_database_url):
            yield running


@pytest.fixture(scope="module")
def client(sparing: Service) -> Iterator[httpx.Client]:
    with sparing.client() as client:
        yield client


def kept_segments(service: Service, dataset: str) -> int:
    database = open_database(service.database_url)
    with database.session() as session:
        found = session.scalars(select(DatasetSegment.sha256).where(DatasetSegment.dataset_id == dataset)).all()
    database.dispose()
    return len(found)


def stored(client: httpx.Client) -> int:
    return int(client.get("/v1/workspaces/ws_default").json()["used"]["stored_bytes"])


def sent(client: httpx.Client, body, data: bytes) -> str:
    """Send a recording, wait until it is read, and return its id."""
    reply = upload(client, body, data)
    assert reply.status_code in {200, 202}, reply.text
    if reply.status_code == 202:
        assert finished(client, reply.json()["job"])["status"] == "succeeded"
    dataset = str(reply.json()["id"])
    assert client.get(f"/v1/datasets/{dataset}").json()["status"] == "ready"
    return dataset


@pytest.mark.parametrize("by_a_job", [False, True])
def test_raw_samples_are_kept_once_and_come_back_byte_for_byte(client, sparing, monkeypatch, by_a_job) -> None:
    data = lag_recording()
    if by_a_job:
        monkeypatch.setattr(raw_samples, "AT_ONCE", len(data) - 1)
    before = stored(client)
    dataset = sent(client, RAW, data)
    assert kept_segments(sparing, dataset) == 0
    assert client.get(f"/v1/datasets/{dataset}/original").content == data
    assert client.get(f"/v1/datasets/{dataset}").json()["sha256"] == sha256(data)
    assert stored(client) - before == pytest.approx(len(data), abs=1000)  # counted once, beside the job's result
    for name, column in zip("uy", np.frombuffer(data, "<f8").reshape(-1, 2).T, strict=True):
        assert client.get(f"/v1/datasets/{dataset}/channels/{name}").json()["values"] == column.tolist()
    etag = client.get(f"/v1/datasets/{dataset}").headers["ETag"]
    assert client.delete(f"/v1/datasets/{dataset}", headers={"If-Match": etag}).status_code == 204
    assert stored(client) - before == pytest.approx(0, abs=1000)


def test_who_did_not_hear_that_a_recording_is_there_may_send_it_again(client) -> None:
    data = lag_recording()
    dataset = sent(client, RAW, data)
    pieces = [data[i : i + 32_000] for i in range(0, len(data), 32_000)]
    for piece in pieces:
        assert client.put(f"/v1/datasets/{dataset}/segments/{sha256(piece)}", content=piece).status_code == 200
    manifest = {"segments": [sha256(piece) for piece in pieces], "sha256": sha256(data)}
    again = client.post(f"/v1/datasets/{dataset}/commit", json=manifest)
    assert (again.status_code, again.json()["status"]) == (200, "ready")
    other = data[:32_000][::-1]
    refused = client.put(f"/v1/datasets/{dataset}/segments/{sha256(other)}", content=other)
    assert refused.status_code == 409


def test_a_file_whose_channels_hold_all_of_it_is_left_out_and_says_so(client, sparing) -> None:
    before = stored(client)
    body = {"name": "steps", "format": "csv", "import": {"sample_rate": 100}}
    dataset = sent(client, body, TEXT)
    assert kept_segments(sparing, dataset) == 0
    gone = client.get(f"/v1/datasets/{dataset}/original")
    assert (gone.status_code, gone.json()["type"]) == (410, "urn:servotune:problem:original-left-out")
    assert dataset in gone.json()["detail"]
    assert sha256(TEXT) in gone.json()["detail"]
    values = client.get(f"/v1/datasets/{dataset}/channels/x").json()["values"]
    assert values == [float(number % 7) for number in range(5000)]
    assert stored(client) - before == pytest.approx(8 * 5000, abs=3000)  # its samples, and the job's result
    database = open_database(sparing.database_url)
    with database.session() as session:
        entry = session.scalars(select(AuditEntry).where(AuditEntry.target == dataset)).all()[-1]
    database.dispose()
    assert (entry.action, entry.detail) == ("dataset.leave-out", {"sha256": sha256(TEXT)})


def test_an_exported_lineage_has_the_samples_in_its_place(client, tmp_path) -> None:
    file = sent(client, {"name": "steps", "format": "csv", "import": {"sample_rate": 100}}, TEXT)
    raw = sent(client, RAW, lag_recording())
    for dataset, there in ((file, "channels/0.f64"), (raw, "original")):
        reply = client.get(f"/v1/lineage/{dataset}/bundle")
        assert reply.status_code == 200, reply.text
        (tmp_path / "bundle.zip").write_bytes(reply.content)
        with zipfile.ZipFile(tmp_path / "bundle.zip") as archive:
            content = archive.read(f"datasets/{dataset}/{there}")
        expected = np.array([number % 7 for number in range(5000)], dtype="<f8").tobytes()
        assert content == (expected if dataset == file else lag_recording())


def whole_numbers(kind: str) -> tuple[dict[str, str], bytes, str]:
    """Return a recording of whole numbers, a file with such ones, and the channel that has more bits than float64."""
    ticks = np.arange(1000, dtype=np.uint64) + 2**63
    if kind == "csv":
        rows = "".join(f"{number / 1000!r},{tick}\n" for number, tick in enumerate(ticks))
        return {"name": "ticks", "format": "csv"}, f"t [s],tick\n{rows}".encode(), "tick"
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        file["tick"] = ticks
        file["tick"].attrs["sample_rate"] = 1000.0
    return {"name": "ticks", "format": "hdf5"}, content.getvalue(), "tick"


@pytest.mark.parametrize("kind", ["hdf5", "csv"])
def test_whole_numbers_that_are_rounded_are_said_and_their_file_is_kept(client, sparing, kind) -> None:
    body, data, name = whole_numbers(kind)
    dataset = sent(client, body, data)
    said = client.get(f"/v1/datasets/{dataset}").json()["report"]["remarks"]
    # of 2^63 ... 2^63 + 999 those are held that are multiples of 2048: the first one
    assert any(f"{name}: 999 of 1000 values are rounded" in one and "2^53" in one for one in said), said
    assert not any("is its sensor connected?" in one for one in said), said
    assert kept_segments(sparing, dataset) > 0
    assert client.get(f"/v1/datasets/{dataset}/original").content == data


def test_a_zero_keeps_the_sign_that_the_file_has(client) -> None:
    data = b"x\n" + b"-0.0\n0.0\n-0\n0.5\n" * 100
    dataset = sent(client, {"name": "signs", "format": "csv", "import": {"sample_rate": 100}}, data)
    assert client.get(f"/v1/datasets/{dataset}/original").status_code == 410  # so the channel is all that is left of it
    values = client.get(f"/v1/datasets/{dataset}/channels/x").json()["values"]
    exported = client.get(f"/v1/datasets/{dataset}/export", params={"format": "csv"}).text.splitlines()[1:]
    for found in (values, [float(line.split(",")[1]) for line in exported]):
        assert np.signbit(found).tolist() == [True, False, True, False] * 100


INSTANTS = {
    "even": ([number / 1000 for number in range(1000)], True),
    "even, from an instant of its own": ([12.345 + number / 1000 for number in range(1000)], True),
    "with a gap": ([number / 1000 for number in range(1000) if not 100 <= number < 103], True),
    "uneven, kept as a channel": ([number / 1000 + (number % 7) / 10_000 for number in range(1000)], True),
    "one that repeats another": ([0.299 if number == 300 else number / 1000 for number in range(1000)], False),
    "of a coarse clock": ([number // 10 / 100 for number in range(1000)], False),
    "off by less than the axis shows": ([number / 1000 + (number % 7) * 1e-8 for number in range(1000)], False),
}


@pytest.mark.parametrize("case", INSTANTS)
def test_a_file_goes_only_where_each_of_its_instants_can_be_told_from_what_is_kept(client, sparing, case) -> None:
    instants, goes = INSTANTS[case]
    data = ("t [s],x\n" + "".join(f"{instant:.9g},{number % 7}\n" for number, instant in enumerate(instants))).encode()
    dataset = sent(client, {"name": "stamped", "format": "csv"}, data)
    assert (kept_segments(sparing, dataset) == 0) == goes
    found = client.get(f"/v1/datasets/{dataset}").json()
    if goes:  # told again: the first instant, and the places on the axis or the instants beside the samples
        every = client.get(f"/v1/datasets/{dataset}/channels/x").json()
        there = [time for time, value in zip(every["time"], every["values"], strict=True) if value is not None]
        again = [f"{found['report']['time']['first'] + time:.9g}" for time in there]
        assert again == [f"{instant:.9g}" for instant in instants]


@pytest.mark.parametrize("case", ["closed gaps", "another rate", "a last row that may be cut"])
def test_a_file_whose_times_or_rows_were_left_out_is_kept(client, sparing, tmp_path, case) -> None:
    rows = [f"{number / 1000!r},{number % 7}.5" for number in range(1000) if not 100 <= number < 103]
    data, format_, description = ("t [s],x\n" + "\n".join(rows) + "\n").encode(), "csv", {"gaps": "close"}
    if case == "another rate":
        with h5py.File(tmp_path / "rate.h5", "w") as file:
            file["x"] = np.arange(100.0)
            file["x"].attrs["sample_rate"] = 1000.0
        data, format_, description = (tmp_path / "rate.h5").read_bytes(), "hdf5", {"sample_rate": 500}
    elif case.startswith("a last row"):
        data, description = b"x\n" + b"1.5\n" * 500 + b"1", {"sample_rate": 100, "allow_truncated": True}
    dataset = sent(client, {"name": "less", "format": format_, "import": description}, data)
    assert kept_segments(sparing, dataset) > 0


@pytest.mark.parametrize("case", ["a column that was not taken", "a group that was not taken"])
def test_a_file_with_more_in_it_is_kept(client, sparing, tmp_path, case) -> None:
    if case.startswith("a column"):
        data = b"x,y\n" + b"1,2\n3,4\n" * 500
        description = {"sample_rate": 100, "columns": [{"source": "x", "name": "x"}]}
        body = {"name": "half", "format": "csv", "import": description}
    else:
        with h5py.File(tmp_path / "two.h5", "w") as file:
            file["slow/x"] = np.arange(100.0)
            file["fast/y"] = np.arange(1000.0)
        data = (tmp_path / "two.h5").read_bytes()
        body = {"name": "two", "format": "hdf5", "import": {"sample_rate": 100}}
    dataset = sent(client, body, data)
    assert kept_segments(sparing, dataset) > 0
    assert client.get(f"/v1/datasets/{dataset}/original").content == data


def test_originals_are_kept_unless_the_operator_says_otherwise(sqlite_template, tmp_path, monkeypatch) -> None:
    monkeypatch.delenv("SERVOTUNE_KEEP_ORIGINALS", raising=False)
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with serving(f"sqlite:///{path}") as usual, usual.client() as client:
        dataset = sent(client, RAW, lag_recording())
        assert kept_segments(usual, dataset) > 0


def test_a_sample_that_differs_a_missing_one_and_one_too_many_are_seen(client, sparing) -> None:
    data = lag_recording()
    u, y = np.frombuffer(data, "<f8").reshape(-1, 2).T
    dataset = sent(client, RAW, data)
    database = open_database(sparing.database_url)
    changed = y.copy()
    changed[-1] = np.nextafter(changed[-1], np.inf)
    for second, expected in ((y, True), (changed, False), (y[:-1], False), (np.append(y, 0.0), False)):
        compared = Comparison(database.session, dataset)
        for start in range(0, len(u), 1500):
            compared.add(0, u[start : start + 1500])
            compared.add(1, second[start : start + 1500])
        if len(second) > len(u):
            compared.add(1, second[len(u) :])
        assert compared.same == expected
    database.dispose()


def test_a_repeated_lineage_sends_raw_samples_again_and_passes_over_a_file_that_is_gone(
    client, sparing, tmp_path
) -> None:
    raw = sent(client, RAW, lag_recording())
    file = sent(client, {"name": "steps", "format": "csv", "import": {"sample_rate": 100}}, TEXT)
    said = {}
    with servotune.connect(sparing.url, key=sparing.keys["admin"]) as connected:
        for dataset in (raw, file):
            path = tmp_path / f"{dataset}.zip"
            path.write_bytes(client.get(f"/v1/lineage/{dataset}/bundle").content)
            (said[dataset],) = repeat(connected._transport, path)
    assert said[raw].largest == 0.0
    again = str(said[raw].new_id)
    assert client.get(f"/v1/datasets/{again}/original").content == lag_recording()
    assert said[file].new_id is None
    assert "its file was left out where it came from" in said[file].note
