"""Samples on disk: whole or not at all, in their order, and bounded."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pytest

from agent import spool as spooling
from agent.errors import AttemptError
from agent.spool import Recorder, Spool, write_whole

CLAIM = {"acquisition": "acq_1", "attempt": 1}


@pytest.fixture
def spool(tmp_path) -> Spool:
    return Spool(tmp_path, limit=1e9, reserve=0.0)


def test_blocks_become_segments_sample_by_sample(spool) -> None:
    run = spool.open(CLAIM)
    recorder = Recorder(run, channels=2, samples=100)
    values = np.arange(500.0).reshape(2, 250)
    for part in np.array_split(values, 7, axis=1):
        recorder.add(part)
    recorder.close()
    segments = run.segments()
    assert [segment.samples for segment in segments] == [100, 100, 50]
    data = b"".join(segment.path.read_bytes() for segment in segments)
    # All channels of a sample together, as the service keeps them.
    assert np.array_equal(np.frombuffer(data, "<f8").reshape(-1, 2), values.T)
    assert all(hashlib.sha256(s.path.read_bytes()).hexdigest() == s.sha256 for s in segments)


def test_what_a_dead_process_left_is_found_again(spool, tmp_path) -> None:
    run = spool.open(CLAIM)
    run.write("begin", {"channels": [{}, {}]})
    segment = run.append(0, bytes(160), samples=10)
    segment.path.with_suffix(".json").unlink()  # killed between the samples and their sidecar
    (run.folder / "000001.f64.part").write_bytes(b"half")  # killed while it wrote
    again = Spool(tmp_path, limit=1e9, reserve=0.0)
    (found,) = again.runs()
    assert found.segments() == []
    found.repair()
    assert found.segments() == [segment]
    assert not list(tmp_path.rglob("*.part"))
    assert again.instance() == spool.instance() == Spool(tmp_path, limit=1, reserve=0).instance()


def test_windows_opens_no_folder(tmp_path, monkeypatch) -> None:
    """Its file system refuses to open a folder; the name of a file is in its journal."""
    real = os.open

    def refusing(path, flags, *rest, **options):
        if Path(path).is_dir():
            raise PermissionError(13, "Permission denied", str(path))
        return real(path, flags, *rest, **options)

    monkeypatch.setattr(os, "open", refusing)
    with pytest.raises(AttemptError, match="Permission denied"):
        write_whole(tmp_path / "x", b"data")
    monkeypatch.setattr(spooling, "WINDOWS", True)
    write_whole(tmp_path / "x", b"data")
    monkeypatch.undo()
    assert (tmp_path / "x").read_bytes() == b"data"


def test_a_file_is_never_half_there(tmp_path, monkeypatch) -> None:
    path = tmp_path / "x"
    write_whole(path, b"before")

    def full(_) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("agent.spool.os.fsync", full)
    with pytest.raises(AttemptError, match="No space left on device") as stopped:
        write_whole(path, b"after")
    assert stopped.value.code == "disk_full"
    assert path.read_bytes() == b"before"


def test_the_disk_is_bounded(tmp_path) -> None:
    spool = Spool(tmp_path, limit=1000.0, reserve=0.0)
    spool.admit(1000)
    spool.open(CLAIM).append(0, bytes(80), samples=10)
    spool.admit(920)
    with pytest.raises(AttemptError, match="must hold at most 1000 bytes, it has 80 and would get 921"):
        spool.admit(921)
    with pytest.raises(AttemptError, match="must keep 1e"):
        Spool(tmp_path, limit=1e30, reserve=1e25).admit(1)


def test_a_spoilt_piece_becomes_missing_values(spool) -> None:
    run = spool.open(CLAIM)
    segment = run.append(0, bytes(160), samples=10)
    made = run.replace_spoilt(segment, channels=2)
    assert np.isnan(np.frombuffer(made.path.read_bytes())).sum() == 20
    assert made.path.with_suffix(".spoilt").read_bytes() == bytes(160)
    assert json.loads(made.path.with_suffix(".json").read_text())["sha256"] == made.sha256 != segment.sha256
