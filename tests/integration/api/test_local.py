"""An engine that is started with a script, and gone with it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import servotune
from tests.integration.api.documents import LAG, OPTIMIZATION
from tests.support.desk import wait_for

STEP = {"port": "u", "signal": {"kind": "step"}}


def answers(url: str) -> bool:
    with servotune.connect(url, key="any", attempts=1) as client:
        try:
            client.ready()
        except servotune.ServiceUnreachableError:
            return False
        return True


def test_it_simulates_searches_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    with servotune.local() as client:
        url = client.url
        assert client.simulate(LAG, input=STEP).metrics["y"].settling_time.verdict == "ok"
        found = client.optimize(**{"system": LAG} | OPTIMIZATION).wait(progress=False, timeout=240)
        assert found.certificate.valid
        assert list(tmp_path.glob("servotune-*/servotune.db"))
        with servotune.connect(url, key="another") as stranger, pytest.raises(servotune.UnauthorizedError):
            list(stranger.systems.list())
    assert not answers(url)
    assert not list(tmp_path.iterdir())


def test_what_is_kept_in_a_folder_is_there_again(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    with servotune.local(folder) as client:
        stored = client.systems.create(LAG).id
    with servotune.local(folder) as client:
        assert client.systems.get(stored).document["name"] == LAG["name"]


def test_it_ends_with_its_script_however_that_ends(tmp_path: Path) -> None:
    code = "import servotune, os, signal; c = servotune.local(); print(c.url, flush=True); os.kill(os.getpid(), signal.SIGKILL)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=240,
        env=os.environ | {"TMPDIR": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == -9, done.stderr
    wait_for(lambda: not answers(done.stdout.strip()), "the end of the engine")


def test_one_that_cannot_start_says_why(tmp_path: Path) -> None:
    (tmp_path / "servotune.db").write_bytes(b"no database" * 1000)
    with pytest.raises(
        servotune.ServotuneError, match=r"does not start: .* must be a SQLite database, got a file that is none"
    ):
        servotune.local(tmp_path)
