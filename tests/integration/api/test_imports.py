"""Files become recordings over HTTP: a look first, then the import; bad files are refused and leave nothing; exports come back."""

from __future__ import annotations

import io
import json
import struct
import zlib
from datetime import UTC, datetime, timedelta

import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest
import scipy.io
from nptdms import ChannelObject, TdmsWriter
from sqlalchemy import func, select

from api.schemas.replies import DatasetReply, PreviewReply
from storage import open_database
from storage.blobs import forget_unused
from storage.models import Blob, ChannelBlock, Dataset, Job
from storage.repositories import DatasetRepository
from tests.integration.api.conftest import finished
from tests.integration.api.documents import RAW, lag_recording, sha256, upload

DAQ = b"""Header Size:  7
Sampling Rate:  1000
Sample Number, Date/Time, force [N], x [mm], Events
1, 06/29/2022 04:05:36.674 PM, -0.0209, 1.5, DAQ Start
2, 06/29/2022 04:05:36.675 PM, -0.0221, 2.5
3, 06/29/2022 04:05:36.676 PM, -0.0221, 3.5
4, 06/29/2022 04:05:36.679 PM, -0.0221, 4.5
5, 06/29/2022 04:05:36.680 PM, -0.0231, 5.5
"""
RNG = np.random.default_rng(2)


@pytest.fixture(scope="module")
def client(sqlite_service, sqlite_worker):
    with sqlite_service.client() as client:
        yield client


def imported(client, format_, content, **description):
    """Import a file; return the dataset as it is then."""
    body = (
        {"name": "recording"}
        | ({"format": format_} if format_ else {})
        | ({"import": description} if description else {})
    )
    reply = upload(client, body, content, segment=1 << 22)
    assert reply.status_code == 202, reply.text
    job = finished(client, reply.json()["job"])
    dataset = client.get(f"/v1/datasets/{reply.json()['id']}").json()
    DatasetReply.model_validate(dataset)
    assert (job["status"] == "succeeded") == (dataset["status"] == "ready"), (job, dataset)
    return dataset


def values(client, dataset, name):
    found = client.get(f"/v1/datasets/{dataset['id']}/channels/{name}").json()["values"]
    return [np.nan if value is None else value for value in found]


def test_a_table_is_looked_at_then_confirmed(client):
    where = client.post("/v1/datasets", json={"name": "bench", "format": "csv"}).headers["Location"]
    manifest = {"segments": [sha256(DAQ)], "sha256": sha256(DAQ)}
    early = client.post(f"{where}/preview", json={"segments": manifest["segments"]})
    assert (early.status_code, early.json()["missing"]) == (409, manifest["segments"])
    client.put(f"{where}/segments/{sha256(DAQ)}", content=DAQ)
    reply = client.post(f"{where}/preview", json={"segments": manifest["segments"]})
    assert reply.status_code == 202, reply.text
    PreviewReply.model_validate(reply.json())
    assert finished(client, reply.json()["job"])["status"] == "succeeded"
    found = client.get(f"/v1/jobs/{reply.json()['job']['id']}/result").json()
    proposed = found["import"]
    assert proposed == {
        "delimiter": ",", "decimal": ".", "header_lines": 3, "missing": ["", "NaN"], "sample_rate": 1000,
        "columns": [{"index": 2, "name": "force", "unit": "N"}, {"index": 3, "name": "x", "unit": "mm"}],
        "time": {"index": 1, "unit": "s"}, "gaps": "fill", "uneven": "keep", "time_zone": "UTC",
    }  # fmt: skip
    assert (found["sample_rate"], found["sample_count"], found["uneven"]) == (1000, 7, pytest.approx(0, abs=1e-6))
    assert [one["role"] for one in found["series"]] == ["counter", "time", "channel", "channel"]
    assert found["header"] == DAQ.decode().splitlines()[:3]
    assert found["channels"][1]["first"] == [1.5, 2.5, 3.5, 4.5, 5.5]
    assert client.get(where).json()["status"] == "open"
    proposed["columns"][0] |= {"scale": 1000, "sensor": {"model": "U9C", "serial": "12"}}
    proposed["time_zone"] = "Europe/Bucharest"
    done = client.post(f"{where}/commit", json=manifest | {"import": proposed})
    assert done.status_code == 202, done.text
    assert finished(client, done.json()["job"])["status"] == "succeeded"
    dataset = client.get(where).json()
    assert (dataset["sample_rate"], dataset["sample_count"]) == (1000, 7)
    assert dataset["start_time"] == "2022-06-29T13:05:36.674000+00:00"
    assert dataset["channels"][0] == {
        "name": "force",
        "unit": "N",
        "scale": 1000,
        "sensor": {"model": "U9C", "serial": "12"},
    }
    np.testing.assert_array_equal(values(client, dataset, "x"), [1.5, 2.5, 3.5, np.nan, np.nan, 4.5, 5.5])
    report = dataset["report"]
    assert report["time"] == {
        "requested": 1000, "first": pytest.approx(57936.674), "actual": 1000, "uneven": pytest.approx(0, abs=1e-6), "gap_count": 1, "filled": 2,
        "gaps": [{"sample": 3, "missing": 2, "step": pytest.approx(0.003)}],
    }  # fmt: skip
    assert "time has 1 gaps" in report["remarks"][0]
    assert client.get(f"{where}/original").content == DAQ


def test_the_format_of_a_file_that_nobody_named_is_told_from_its_beginning(client):
    where = client.post("/v1/datasets", json={"name": "bench", "file": "run 7.txt"}).headers["Location"]
    assert client.get(where).json()["format"] == "unknown"
    segments = {"segments": [sha256(DAQ)]}
    assert client.post(f"{where}/preview", json=segments).status_code == 409
    client.put(f"{where}/segments/{sha256(DAQ)}", content=DAQ)
    job = client.post(f"{where}/preview", json=segments).json()["job"]
    assert finished(client, job)["status"] == "succeeded"
    found = client.get(f"/v1/jobs/{job['id']}/result").json()
    said = "the format txt is told from its first bytes, which are text, and its name"
    assert (found["format"], found["remarks"][0]) == ("txt", said)
    done = client.post(f"{where}/commit", json=segments | {"sha256": sha256(DAQ)})
    assert finished(client, done.json()["job"])["status"] == "succeeded"
    dataset = client.get(where).json()
    assert (dataset["format"], dataset["report"]["remarks"][0]) == ("txt", said)
    assert dataset["document"]["recognised"]["format"] == "txt"
    mat = imported(client, None, matlab(x=np.arange(50.0), Ts=0.01))
    assert (mat["status"], mat["format"], mat["sample_rate"]) == ("ready", "mat", 100)


def test_a_file_whose_format_nothing_tells_is_refused_before_it_is_committed(client):
    content = b"PK\x03\x04" + bytes(100)
    where = client.post("/v1/datasets", json={"name": "run.xlsx"}).headers["Location"]
    client.put(f"{where}/segments/{sha256(content)}", content=content)
    body = {"segments": [sha256(content)]}
    for asked in ("preview", "commit"):
        reply = client.post(f"{where}/{asked}", json=body | ({"sha256": sha256(content)} if asked == "commit" else {}))
        assert reply.status_code == 422, reply.text
        assert "csv, frd, hdf5, lvm, mat, mcap, mdf, parquet, tdms, touchstone, txt, uff, wav" in reply.json()["detail"]
        assert "a spreadsheet: send what is in it, saved as CSV" in reply.json()["detail"]
    assert client.get(where).json()["status"] == "open"
    for field in ("channels", "sample_rate"):
        wrong = client.post("/v1/datasets", json={"name": "x", field: RAW[field]})
        assert (wrong.status_code, wrong.json()["errors"][0]["pointer"]) == (422, f"/{field}")
    assert client.post("/v1/datasets", json=RAW | {"file": "x.bin"}).json()["errors"][0]["pointer"] == "/file"


def test_a_file_with_fewer_samples_than_it_says_is_read_and_that_is_said(client):
    content = b"Sample Count: 61500\nt,x\n" + b"".join(b"%d,1.5\n" % i for i in range(20))
    dataset = imported(client, "csv", content)
    assert dataset["sample_count"] == 20
    assert "the file says that it has 61500 samples, 20 are there: is it cut?" in dataset["report"]["remarks"]


def test_a_file_that_cannot_be_read_as_described_is_read_again_as_it_should(client):
    content = b"x\n1,5\n2,5\n"
    description = {"sample_rate": 10, "delimiter": ";", "columns": [{"index": 3, "name": "x"}]}
    failed = imported(client, "csv", content, **description)
    assert failed["status"] == "failed"
    assert "a column 3" in failed["error"]["detail"]
    manifest = {"segments": [sha256(content)], "sha256": sha256(content)}
    description["columns"] = [{"source": "x", "name": "x"}]
    again = client.post(f"/v1/datasets/{failed['id']}/commit", json=manifest | {"import": description})
    assert finished(client, again.json()["job"])["status"] == "succeeded"
    assert values(client, failed, "x") == [1.5, 2.5]


def tdms(**channels):
    target = io.BytesIO()
    with TdmsWriter(target) as writer:
        objects = [
            ChannelObject("rig 1/north", name, data, {"wf_increment": 1e-3, "unit_string": "Volts"})
            for name, data in channels.items()
        ]
        writer.write_segment(objects)
    return target.getvalue()


def test_a_binary_file_and_its_exports(client, tmp_path):
    x, y = RNG.normal(size=5000), RNG.normal(size=5000)
    y[500:600] = np.nan
    content = tdms(**{"force/left": x, "y": y})
    columns = [
        {"source": "force/left", "name": "force/left", "unit": "N", "scale": 2.0, "offset": 1.0, "quantity": "force"},
        {"source": "y", "name": "y"},
    ]
    dataset = imported(client, "tdms", content, columns=columns)
    assert [(one["name"], one["unit"]) for one in dataset["channels"]] == [("force/left", "N"), ("y", "volts")]
    force = 2.0 * x + 1.0
    np.testing.assert_array_equal(values(client, dataset, "force/left"), force)
    noticed = dataset["report"]["channels"]["y"]
    assert (noticed["missing"], noticed["missing_stretches"]) == (100, [[500, 600]])
    where = f"/v1/datasets/{dataset['id']}/export"

    text = client.get(where, params={"format": "csv"})
    assert text.headers["Content-Type"] == "text/csv; charset=utf-8"
    assert text.text.partition("\n")[0] == "time [s],force/left [N],y [volts]"
    rows = np.genfromtxt(io.StringIO(text.text), delimiter=",", skip_header=1)
    np.testing.assert_array_equal(rows[:, 1], force)
    np.testing.assert_array_equal(rows[:, 2], y)
    np.testing.assert_array_equal(rows[:, 0], np.arange(5000) / 1000)

    mat = scipy.io.loadmat(io.BytesIO(client.get(where, params={"format": "mat"}).content))
    np.testing.assert_array_equal(mat["force_left"][:, 0], force)
    np.testing.assert_array_equal(mat["y"][:, 0], y)
    assert (mat["sample_rate"].item(), mat["channels"].item()) == (1000, "force_left: force/left [N]\ny: y [volts]")

    table = pq.read_table(io.BytesIO(client.get(where, params={"format": "parquet"}).content))
    np.testing.assert_array_equal(table["force/left"].to_numpy(), force)
    assert table.schema.field("force/left").metadata == {b"unit": b"N", b"quantity": b"force"}
    assert table.schema.metadata[b"sample_rate"] == b"1000.0"

    window = {"format": "hdf5", "channel": ["y"], "start": 0.4, "end": 0.7}
    with h5py.File(io.BytesIO(client.get(where, params=window).content)) as file:
        assert list(file) == ["y"]
        np.testing.assert_array_equal(file["y"][:], y[400:701])
        assert (file.attrs["sample_rate"], file.attrs["t0"], file["y"].attrs["unit"]) == (1000, 0.4, "volts")

    for format_ in ("csv", "mat", "parquet", "hdf5"):
        again = imported(client, format_, client.get(where, params={"format": format_}).content)
        assert (again["status"], again["sample_rate"], again["sample_count"]) == ("ready", 1000, 5000)
        np.testing.assert_array_equal(values(client, again, again["channels"][0]["name"]), force)
    assert client.get(where, params={"channel": "ghost"}).status_code == 404
    assert client.get(where, params={"start": 1e6}).status_code == 422
    assert client.get(where, params={"format": "wav"}).status_code == 422


@pytest.mark.parametrize("format_", ["mat", "parquet", "hdf5"])
def test_what_leaves_comes_back_with_its_units_and_its_start(client, format_):
    """A stretch from 0.4 s on: its first sample was taken 0.4 s after the start of the whole."""
    described = [{"name": "force/left", "unit": "N"}, {"name": "units", "unit": "mm"}, {"name": "plain"}]
    body = {"name": "whole", "format": "raw", "sample_rate": 1000, "start_time": "2026-11-28T05:00:00.25+00:00"}
    data = RNG.normal(size=(1000, 3)).astype("<f8")
    reply = upload(client, body | {"channels": described}, data.tobytes())
    where = f"/v1/datasets/{reply.json()['id']}/export"
    for start, began in ((None, "05:00:00.250000"), (0.4, "05:00:00.650000")):
        asked = {"format": format_} | ({} if start is None else {"start": start})
        again = imported(client, format_, client.get(where, params=asked).content)
        assert again["start_time"] == f"2026-11-28T{began}+00:00"
        named = {one["unit"]: one["name"] for one in again["channels"]}  # HDF5 sorts channels, MATLAB changes names
        first = 0 if start is None else 400
        for unit, column in zip(("N", "mm", ""), data.T, strict=True):
            np.testing.assert_array_equal(values(client, again, named[unit]), column[first:])


def test_matlab_reads_the_units_of_an_export_as_a_structure(client):
    channels = [{"name": "a long name that is no variable, " * 3, "unit": "m/s**2"}, {"name": "b"}]
    reply = upload(client, {"name": "r", "format": "raw", "sample_rate": 10, "channels": channels}, bytes(160))
    found = client.get(f"/v1/datasets/{reply.json()['id']}/export", params={"format": "mat"})
    read = scipy.io.loadmat(io.BytesIO(found.content), simplify_cells=True)
    (name,) = read["units"]
    assert (read["units"], len(read[name])) == ({name: "m/s**2"}, 10)


def matlab(**variables):
    target = io.BytesIO()
    scipy.io.savemat(target, variables)
    return target.getvalue()


def bomb():
    """Return a MATLAB file of 1.5 MB whose one variable unpacks to 320 MB of zeros."""
    size = 320 << 20
    head = (
        struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<IIii", 5, 8, size // 8, 1) + struct.pack("<HH4s", 1, 1, b"x")
    )
    squeezer = zlib.compressobj(1)
    data = squeezer.compress(struct.pack("<II", 14, len(head) + 8 + size) + head + struct.pack("<II", 9, size))
    data += squeezer.flush(zlib.Z_FULL_FLUSH)
    # after a full flush equal content is compressed to equal bytes: the million zeros need be squeezed but once
    piece = squeezer.compress(bytes(1 << 20)) + squeezer.flush(zlib.Z_FULL_FLUSH)
    data += piece * (size >> 20) + squeezer.flush()
    return matlab()[:128] + struct.pack("<II", 15, len(data)) + data


def billion():
    """Return a MATLAB file whose header claims a billion samples of a variable of two."""
    good = matlab(x=np.ones(50))
    assert good.count(struct.pack("<ii", 1, 50)) == 1
    return good.replace(struct.pack("<ii", 1, 50), struct.pack("<ii", 1, 10**9))


BAD = {
    "a bomb": ("mat", bomb(), {}, "must unpack to at most 256 MiB or 64 times the size of the file"),
    "a billion samples": ("mat", billion(), {}, "must fit into the .* got 1000000000"),
    "a cut MATLAB file": ("mat", matlab(a=np.ones(500))[:-100], {}, "the file is cut off"),
    "a cut HDF5 file": ("hdf5", b"\x89HDF\r\n\x1a\n" + bytes(600), {}, "an HDF5 file must be complete"),
    "channels of different length": ("mat", matlab(a=np.ones(50), b=np.ones(40)), {"columns": [{"source": "a", "name": "a"}, {"source": "b", "name": "b"}]}, "same number of samples, got a 50, b 40"),
    "no sample rate": ("mat", matlab(a=np.ones(50)), {}, "sample_rate must be given in import"),
    "not there": ("mat", matlab(a=np.ones(50)), {"columns": [{"source": "c", "name": "c"}]}, r"one of the file's \(a\), got 'c'"),
    "a text": ("mat", matlab(a=np.ones(50), w="hi"), {"columns": [{"source": "w", "name": "w"}]}, "w cannot be read: it is a text"),
    "a sample rate of no recording": ("mat", matlab(a=np.ones(50), Ts=1e300), {}, r"sample_rate must be 1e-06 \.\.\. 1e\+12 samples/s, got 1e-300"),
    "instants of no recording": ("csv", b"t,x\n0,1\n1e-300,2\n2e-300,3\n3e-300,4\n", {}, "got 1e.300 by the instants of the file: is the unit of time right"),
    "truncated": ("tdms", tdms(x=np.ones(5000))[:-90], {}, "the file is cut off"),
    "empty table": ("csv", b"\n", {}, "rows of numbers"),
    "not what it says": ("tdms", DAQ, {}, "must begin with TDSm"),
    "an infinity": ("tdms", tdms(x=np.array([1.0, np.inf])), {}, "channel 'x' must be finite or missing, got an infinity at sample 1"),
    "time runs backwards": ("csv", b"t,x\n0,1\n1,2\n3,4\n2,5\n", {"time": {"index": 0}}, "time must not run backwards"),
    "only text columns": ("csv", b"1;a\n2;b\n3;c\n", {"columns": [{"index": 1, "name": "x"}], "sample_rate": 1}, "must be a finite number, got 'a'"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_refused_and_leaves_nothing(client, sqlite_service, case):
    format_, content, description, message = BAD[case]
    dataset = imported(client, format_, content, **description)
    assert dataset["status"] == "failed"
    assert __import__("re").search(message, dataset["error"]["detail"]), dataset["error"]
    assert dataset["error"]["type"] == "urn:servotune:problem:unreadable-file"
    assert "Traceback" not in json.dumps(dataset)
    database = open_database(sqlite_service.database_url)
    with database.session() as session:
        blocks = select(func.count()).select_from(ChannelBlock).where(ChannelBlock.dataset_id == dataset["id"])
        assert session.scalar(blocks) == 0
    database.dispose()


def test_fifty_samples_and_a_constant_channel_are_taken_and_said(client):
    dataset = imported(client, "mat", matlab(x=np.full(50, 3.0), y=np.arange(50.0), Ts=0.01))
    assert (dataset["status"], dataset["sample_count"], dataset["sample_rate"]) == ("ready", 50, 100)
    assert "x never changes: is its sensor connected?" in dataset["report"]["remarks"]
    assert dataset["report"]["scalars"] == {"Ts": 0.01}


def test_a_look_at_what_cannot_be_taken_shows_what_there_is(client):
    content = matlab(a=np.ones(50), b=np.ones(40), w="hi")
    where = client.post("/v1/datasets", json={"name": "x", "format": "mat"}).headers["Location"]
    client.put(f"{where}/segments/{sha256(content)}", content=content)
    job = finished(client, client.post(f"{where}/preview", json={"segments": [sha256(content)]}).json()["job"])
    found = client.get(job["result"]).json()
    assert found["import"] is None
    assert [(one["name"], one["sample_count"]) for one in found["series"]] == [("a", 50), ("b", 40)]
    assert found["refused"] == {
        "w": "it is a text such as 'hi', a channel must hold numbers: write what it stands for as numbers"
    }
    assert "sample_rate must be given in import" in found["remarks"][-1]
    assert "the file holds 2 groups of channels, each with its own time: group 1, group 2" in found["remarks"][-1]


def test_raw_samples_are_looked_at_too(client):
    samples = np.frombuffer(lag_recording(samples=3000), "<f8").reshape(-1, 2).copy()
    samples[100:110, 1] = np.nan
    samples[:, 0] = 4.0
    dataset = upload(client, RAW, samples.tobytes()).json()
    assert dataset["report"]["channels"]["y"]["missing"] == 10
    assert dataset["report"]["remarks"][0] == "u never changes: is its sensor connected?"
    refused = client.post(f"/v1/datasets/{dataset['id']}/preview", json={"segments": ["0" * 64]})
    assert refused.status_code == 409


def test_a_recording_whose_job_is_cancelled_has_failed(sqlite_service):
    """Nobody works here: the job waits until it is cancelled."""
    database = open_database(sqlite_service.database_url)
    with database.session() as session:
        datasets = DatasetRepository(session, "ws_default")
        row = datasets.create(name="x", format="csv")
        job = Job(id="job_killed", workspace_id="ws_default", kind="dataset", body={}, status="running", attempts=1)
        session.add(job)
        datasets.put_segment(row.id, sha256(DAQ), DAQ)
        datasets.commit(row.id, segments=[sha256(DAQ)], sha256=sha256(DAQ)).job_id = "job_killed"
        session.flush()
        session.add(ChannelBlock(dataset_id=row.id, channel=0, level=0, number=0, sha256=sha256(DAQ)))
    with sqlite_service.client() as client:
        assert client.get(f"/v1/datasets/{row.id}").json()["status"] == "parsing"
        assert client.post("/v1/jobs/job_killed/cancel").json()["status"] == "cancelled"
        dataset = client.get(f"/v1/datasets/{row.id}").json()
    assert (dataset["status"], dataset["error"]["title"]) == ("failed", "Cancelled")
    with database.session() as session:
        assert session.scalars(select(ChannelBlock.number).where(ChannelBlock.dataset_id == row.id)).all() == []
    database.dispose()


def test_what_nothing_refers_to_is_swept(sqlite_service, client):
    dataset = imported(client, "csv", b"t,x\n" + b"".join(b"%d,%d.25\n" % (i, i * i) for i in range(3000)))
    assert dataset["status"] == "ready"
    gone = client.delete(f"/v1/datasets/{dataset['id']}", headers={"If-Match": "*"})
    assert gone.status_code == 204, gone.text
    database = open_database(sqlite_service.database_url)
    later = datetime.now(UTC) + timedelta(seconds=1)
    with database.session() as session:
        kept = session.scalar(select(func.count()).select_from(Blob))
        assert forget_unused(session, before=datetime.now(UTC) - timedelta(hours=1))[0] == 0
        assert forget_unused(session, before=later)[0] >= 3  # the file, and the samples with their extremes
        assert session.scalar(select(func.count()).select_from(Blob)) < kept
        # and nothing that is still wanted
        for row in session.scalars(select(Dataset).where(Dataset.status == "ready")):
            name = row.channels[0]["name"]
            assert DatasetRepository(session, row.workspace_id).read_channel(row.id, name).size == row.sample_count
    database.dispose()
