"""The spool on a file system that refuses what Windows refuses, and texts as programs of Windows write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agent import spool as spooling
from agent.errors import AttemptError, SettingsError
from agent.settings_file import read
from agent.spool import Recorder, Run, Spool, held, write_whole
from tests.support.windows import Windows

CLAIM = {"acquisition": "acq_01m8cspv9egsk9t5rmsq9jjmf7", "attempt": 1}


@pytest.fixture
def windows(tmp_path, monkeypatch) -> Windows:
    monkeypatch.setattr(spooling, "_BETWEEN", 0.0)
    return Windows(monkeypatch, tmp_path)


def recorded(spool: Spool) -> Run:
    run = spool.open(CLAIM)
    run.write("begin", {"channels": [{}, {}]})
    recorder = Recorder(run, channels=2, samples=100)
    recorder.add(np.arange(500.0).reshape(2, 250))
    recorder.close()
    run.write("end", {"facts": {}, "error": None})
    return run


def test_the_rules_refuse_what_windows_refuses(windows, tmp_path) -> None:
    """Else the tests below would prove nothing."""
    path = tmp_path / "a"
    path.write_bytes(b"x")
    with path.open("rb"):
        for change in (path.unlink, lambda: path.replace(tmp_path / "b"), lambda: path.rename(tmp_path / "b")):
            with pytest.raises(PermissionError, match="used by another process"):
                change()
    for name in ("a:b", "nul.txt", "what?", "end.", "x" * 260):
        with pytest.raises(OSError, match=r"incorrect|too long"):
            (tmp_path / name).write_bytes(b"x")
    path.unlink()


def test_a_recording_goes_its_whole_way(windows, tmp_path) -> None:
    with held(tmp_path):
        spool = Spool(tmp_path, limit=1e9, reserve=0.0)
        run = recorded(spool)
        assert [segment.samples for segment in run.segments()] == [100, 100, 50]
        longest = max(len(str(path.relative_to(tmp_path))) for path in tmp_path.rglob("*"))
        # `.part` while it is written; 259 are allowed to a path, the manual leaves 190 to the folder
        assert longest + len(".part") <= 66
        spoilt = run.replace_spoilt(run.segments()[1], channels=2)
        assert np.isnan(np.frombuffer(spoilt.path.read_bytes())).all()
        assert Spool(tmp_path, limit=1e9, reserve=0.0).runs()[0].ended
        run.remove()
        assert spool.runs() == []
        assert not run.folder.exists()
    assert windows.refused == 0


def test_a_scanner_that_looks_at_a_new_file_loses_no_sample(windows, tmp_path) -> None:
    run = Spool(tmp_path, limit=1e9, reserve=0.0).open(CLAIM)
    windows.hold(run.folder / "000000.f64.part", 3)
    segment = run.append(0, bytes(160), samples=10)
    assert windows.refused == 3
    assert segment.path.read_bytes() == bytes(160)
    assert run.segments() == [segment]


def test_a_file_that_is_never_let_go_of_is_named_and_no_full_disk(windows, tmp_path) -> None:
    path = tmp_path / "x"
    write_whole(path, b"before")
    with path.open("rb"), pytest.raises(AttemptError, match=r"x is held by another program .*virus scans") as stopped:
        write_whole(path, b"after")
    assert stopped.value.code == "file_held"
    assert path.read_bytes() == b"before"
    write_whole(path, b"after")
    assert path.read_bytes() == b"after"


def test_what_cannot_be_deleted_yet_is_forgotten_and_goes_at_the_next_start(windows, tmp_path) -> None:
    spool = Spool(tmp_path, limit=1e9, reserve=0.0)
    run = recorded(spool)
    with run.segments()[0].path.open("rb"):
        run.remove()
        assert spool.runs() == []
        assert run.folder.exists()
        assert Spool(tmp_path, limit=1e9, reserve=0.0).runs() == []
    Spool(tmp_path, limit=1e9, reserve=0.0)
    assert not run.folder.exists()


def test_what_cannot_even_be_forgotten_says_so_and_stays_whole(windows, tmp_path) -> None:
    spool = Spool(tmp_path, limit=1e9, reserve=0.0)
    run = recorded(spool)
    windows.hold(run.folder / "run.json", 10**6)
    with pytest.raises(AttemptError, match="has arrived and must be removable"):
        run.remove()
    windows.hold(run.folder / "run.json", 0)
    (again,) = spool.runs()
    assert len(again.segments()) == 3
    again.remove()
    assert spool.runs() == []


def test_a_part_that_another_program_holds_does_not_keep_the_agent_from_starting(windows, tmp_path) -> None:
    run = recorded(Spool(tmp_path, limit=1e9, reserve=0.0))
    part = run.folder / "000003.f64.part"
    part.write_bytes(b"half")
    with part.open("rb"):
        Spool(tmp_path, limit=1e9, reserve=0.0)
        assert part.exists()
    Spool(tmp_path, limit=1e9, reserve=0.0)
    assert not part.exists()


def test_a_spool_is_one_process_s_alone(tmp_path) -> None:
    with (
        held(tmp_path),
        pytest.raises(SettingsError, match="must be one agent's alone, another process has"),
        held(tmp_path),
    ):
        pass
    with held(tmp_path):
        pass
    (tmp_path / "file").write_text("")
    with pytest.raises(SettingsError, match="must be a writable folder"), held(tmp_path / "file"):
        pass


def written(path: Path, text: str, encoding: str) -> Path:
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_settings_and_keys_of_notepad_are_read(tmp_path, encoding) -> None:
    key = written(tmp_path / "key", "st_key\r\n", encoding)
    text = f"[rig]\r\nname = \"bench-µ\"\r\n[service]\r\nkey_file = '{key}'\r\n"
    made = read(written(tmp_path / "agent.toml", text, encoding), {}, {})
    assert made.rig.name == "bench-µ"
    assert made.key() == "st_key"


@pytest.mark.parametrize("encoding", ["utf-16", "cp1252"])
def test_other_encodings_are_named(tmp_path, encoding) -> None:
    """Of `echo key > file` in Windows PowerShell, and of editors of old."""
    path = written(tmp_path / "agent.toml", "[rig]\nname = 'bench-µ'", encoding)
    with pytest.raises(SettingsError, match=r"agent\.toml must be UTF-8"):
        read(path, {}, {})
    key = written(tmp_path / "key", "st_kéy", encoding)
    good = written(tmp_path / "good.toml", f"[rig]\nname = 'one'\n[service]\nkey_file = '{key}'", "utf-8")
    with pytest.raises(SettingsError, match=r"key_file must be UTF-8, got .*key"):
        read(good, {}, {}).key()


def test_a_backslash_in_double_quotes_is_explained(tmp_path) -> None:
    path = written(tmp_path / "agent.toml", '[spool]\nfolder = "C:\\ProgramData\\Servotune"', "utf-8")
    with pytest.raises(SettingsError, match=r"must be TOML: .*a path of Windows stands in single quotes"):
        read(path, {}, {})
