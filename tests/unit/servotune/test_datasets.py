"""Uploads: cut into segments, each under its checksum, resumed where they stopped."""

from __future__ import annotations

import asyncio
import hashlib
from pathlib import Path

import pytest

import servotune
from servotune.datasets import SEGMENT_BYTES
from tests.unit.servotune.conftest import Answer, Asked, Service


def digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


class Store:
    """The service's side of an upload, as the API describes it."""

    def __init__(self, service: Service, document: dict[str, object], *, pieces: list[bytes]) -> None:
        self.service = service
        self.segments: dict[str, bytes] = {}
        self.manifest: dict[str, object] = {}
        self.sent: list[str] = []
        service.on("POST /v1/datasets", Answer({"id": "ds_1", "status": "open", **document}, status=201))
        service.on("GET /v1/datasets/ds_1", lambda _: Answer({"id": "ds_1", "status": "ready", **document}))
        service.on("GET /v1/datasets/ds_1/segments", lambda _: Answer(self._listing()))
        service.on("POST /v1/datasets/ds_1/commit", self._commit)
        for piece in pieces:
            service.on(f"PUT /v1/datasets/ds_1/segments/{digest(piece)}", self._store)

    def _listing(self) -> dict[str, object]:
        return {
            "items": [{"sha256": name, "bytes": len(held)} for name, held in self.segments.items()],
            "next_cursor": None,
        }

    def _store(self, asked: Asked) -> Answer:
        name = asked.path.rpartition("/")[2]
        assert digest(asked.body) == name
        self.segments[name] = asked.body
        self.sent.append(name)
        return Answer({"sha256": name}, status=201)

    def _commit(self, asked: Asked) -> Answer:
        self.manifest = asked.json
        missing = [name for name in asked.json["segments"] if name not in self.segments]
        if missing:
            return Answer({"title": "Segments missing", "missing": missing}, status=409)
        return Answer({"id": "ds_1", "status": "ready"})


TWO = [bytes(SEGMENT_BYTES), b"the rest"]
FILE = {"name": "recording", "format": "txt"}


def test_a_file_arrives_whole(service: Service, client: servotune.Client, tmp_path: Path):
    store = Store(service, FILE, pieces=TWO)
    path = tmp_path / "recording.txt"
    path.write_bytes(b"".join(TWO))
    fractions: list[float] = []
    dataset = client.datasets.upload(FILE, path, progress=lambda fraction, _: fractions.append(fraction))
    assert dataset["status"] == "ready"
    assert b"".join(store.segments[name] for name in store.manifest["segments"]) == b"".join(TWO)
    assert store.manifest["sha256"] == digest(b"".join(TWO))
    assert fractions == [0.5, 1.0]


def test_what_has_arrived_is_not_sent_again(service: Service, client: servotune.Client):
    store = Store(service, FILE, pieces=TWO)
    store.segments[digest(TWO[0])] = TWO[0]
    client.datasets.send("ds_1", b"".join(TWO))
    assert store.sent == [digest(TWO[1])]


def test_a_segment_that_the_service_lost_is_sent_again(service: Service, client: servotune.Client):
    store = Store(service, FILE, pieces=TWO)
    forgetful = [True]

    def lose_one(asked: Asked) -> Answer:
        if forgetful.pop() if forgetful else False:
            del store.segments[digest(TWO[1])]
        return store._commit(asked)

    service.on("POST /v1/datasets/ds_1/commit", lose_one)
    assert client.datasets.send("ds_1", b"".join(TWO))["status"] == "ready"
    assert store.sent == [digest(TWO[0]), digest(TWO[1]), digest(TWO[1])]


def test_an_interrupted_segment_is_sent_again(service: Service, client: servotune.Client):
    store = Store(service, FILE, pieces=[b"short"])
    broken = [True]
    service.on(
        f"PUT /v1/datasets/ds_1/segments/{digest(b'short')}",
        lambda asked: Answer(cut=True) if broken and broken.pop() else store._store(asked),
    )
    assert client.datasets.send("ds_1", b"short")["status"] == "ready"
    assert len(service.of("PUT")) == 2


def test_raw_segments_hold_whole_samples(service: Service, client: servotune.Client):
    # Three channels of float64 are 24 bytes; 8 MiB is no multiple of 24, and the largest one below it is 8388600.
    raw = {"name": "raw", "format": "raw", "channels": [{"name": n} for n in "abc"]}
    content = bytes(24 * 400_000)
    store = Store(service, raw, pieces=[content[:8_388_600], content[8_388_600:]])
    client.datasets.send("ds_1", content)
    assert [len(store.segments[name]) for name in store.manifest["segments"]] == [8_388_600, 1_211_400]


def test_a_file_that_another_process_has_committed_is_waited_for(service: Service, client: servotune.Client):
    Store(service, FILE, pieces=[b"words"])
    states = ["open", "parsing", "ready"]
    service.on("GET /v1/datasets/ds_1", lambda _: Answer({"id": "ds_1", "format": "txt", "status": states.pop(0)}))
    service.on("POST /v1/datasets/ds_1/commit", Answer({"id": "ds_1", "status": "parsing"}, status=202))
    assert client.datasets.send("ds_1", b"words")["status"] == "ready"
    assert states == []


def test_a_file_that_cannot_be_read_fails_with_the_reason(service: Service, client: servotune.Client):
    Store(service, FILE, pieces=[b"words"])
    problem = {"status": 422, "title": "Cannot read the file", "detail": "line 8: column 2 is not a number"}
    state = {"id": "job_1", "kind": "import", "status": "failed", "progress": 0.0, "error": problem}
    accepted = Answer({"id": "ds_1", "status": "parsing"}, status=202, headers={"Location": "/v1/jobs/job_1"})
    service.on("POST /v1/datasets/ds_1/commit", accepted)
    service.on("GET /v1/jobs/job_1", Answer(state))
    with pytest.raises(servotune.JobFailedError, match="line 8: column 2 is not a number"):
        client.datasets.send("ds_1", b"words")


def test_a_file_is_looked_at_before_it_is_read(service: Service, client: servotune.Client):
    proposal = {"import": {"delimiter": ";", "columns": [{"index": 1, "name": "x"}]}, "remarks": []}
    store = Store(service, FILE | {"format": "csv"}, pieces=TWO)
    job = {"id": "job_1", "kind": "preview", "status": "succeeded", "progress": 1.0, "message": ""}
    service.on(
        "POST /v1/datasets/ds_1/preview", Answer({"dataset": "ds_1", "job": job}, 202, {"Location": "/v1/jobs/job_1"})
    )
    service.on("GET /v1/jobs/job_1", Answer(job))
    service.on("GET /v1/jobs/job_1/result", Answer(proposal))
    content = b"".join(TWO)
    dataset = client.datasets.create(FILE | {"format": "csv"})["id"]
    found = client.datasets.preview(dataset, content, document={"delimiter": ";"})
    assert found == proposal
    asked = next(one for one in service.asked if one.path.endswith("/preview"))
    assert asked.json == {"segments": [digest(piece) for piece in TWO], "import": {"delimiter": ";"}}
    client.datasets.send(dataset, content, document=found["import"])
    assert store.sent == [digest(piece) for piece in TWO]  # not a second time
    assert store.manifest["import"] == proposal["import"]


def test_an_export_is_written_as_a_whole_or_not_at_all(service: Service, client: servotune.Client, tmp_path: Path):
    service.on("GET /v1/datasets/ds_1/export", Answer(b"time [s],x\n0,1\n"))
    target = tmp_path / "out.csv"
    found = client.datasets.export("ds_1", target, channels=["a", "b c"], start=0.5)
    assert (found, target.read_bytes()) == (target, b"time [s],x\n0,1\n")
    assert service.asked[-1].path == "/v1/datasets/ds_1/export?format=csv&channel=a&channel=b+c&start=0.5"
    with pytest.raises(servotune.NotFoundError):
        client.datasets.export("ds_2", tmp_path / "other.h5")
    with pytest.raises(ValueError, match=r"target must end in one of .csv, .mat, .parquet, .h5, .hdf5"):
        client.datasets.export("ds_1", tmp_path / "out.xls")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.csv"]


def test_a_channel_of_any_name_is_asked_for(service: Service, client: servotune.Client):
    service.on("GET /v1/datasets/ds_1/channels/rig%201%2Fforce%20%231", Answer({"unit": "N", "time": [], "values": []}))
    assert client.datasets.channel("ds_1", "rig 1/force #1")["unit"] == "N"


@pytest.mark.parametrize("kind", ["a file", "bytes"])
def test_what_is_empty_is_refused_before_anything_is_opened_for_it(
    service: Service, client: servotune.Client, tmp_path: Path, kind: str
):
    path = tmp_path / "empty.csv"
    path.write_bytes(b"")
    content: Path | bytes = path if kind == "a file" else b""
    said = "file 'empty.csv' must hold at least one byte" if kind == "a file" else "content must hold at least one byte"

    async def beside() -> None:
        async with servotune.AsyncClient(service.url, key="st_1") as waiting:
            await waiting.datasets.upload(FILE, content)

    for refused in (
        lambda: client.datasets.upload(FILE, content),
        lambda: client.datasets.send("ds_1", content),
        lambda: client.datasets.preview("ds_1", content),
        lambda: asyncio.run(beside()),
    ):
        with pytest.raises(servotune.DocumentError, match=said):
            refused()
    assert [asked for asked in service.asked if "datasets" in asked.path] == []
