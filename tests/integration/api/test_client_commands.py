"""The commands of the client as a user types them, against a real service and a worker: what they print, and their exit codes."""

from __future__ import annotations

import csv
import json
import os
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.integration.api.conftest import Service
from tests.integration.api.documents import LAG, OPTIMIZATION
from tests.integration.api.test_reply_objects import AXIS


@pytest.fixture
def run(sqlite_service: Service, tmp_path: Path) -> Any:
    """Return what runs a command as somebody with a home of their own."""

    def command(
        *arguments: str, key: str | None = "admin", text: str = "", **more: str
    ) -> subprocess.CompletedProcess[str]:
        environment = {name: value for name, value in os.environ.items() if not name.startswith("SERVOTUNE_")}
        environment |= {
            "HOME": str(tmp_path),
            "XDG_CONFIG_HOME": str(tmp_path / "config"),
            "PYTHON_KEYRING_BACKEND": "keyring.backends.null.Keyring",
        }
        if key is not None:
            environment |= {"SERVOTUNE_URL": sqlite_service.url, "SERVOTUNE_KEY": sqlite_service.keys[key]}
        return subprocess.run(
            [sys.executable, "-m", "servotune", *arguments], env=environment | more, input=text, capture_output=True,
            text=True, timeout=240, check=False, cwd=tmp_path,
        )  # fmt: skip

    return command


def done(found: subprocess.CompletedProcess[str]) -> str:
    assert found.returncode == 0, found.stdout + found.stderr
    return found.stdout


@pytest.fixture
def axis(tmp_path: Path) -> str:
    (tmp_path / "axis.json").write_text(json.dumps(AXIS))
    return "axis.json"


@pytest.fixture
def files(axis: str, tmp_path: Path) -> None:
    """Files that are not what a command asks for."""
    (tmp_path / "bad.json").write_text("{")
    (tmp_path / "list.json").write_text("[]")
    (tmp_path / "two.json").write_text(json.dumps({"blocks": {"a": {"kind": "input"}, "b": {"kind": "input"}}}))


def test_a_system_is_stored_changed_shown_and_deleted(run, axis, tmp_path) -> None:
    system = done(run("systems", "store", axis)).split()[0]
    assert system.startswith("sys_")
    (tmp_path / axis).write_text(json.dumps(AXIS | {"name": "axis, longer"}))
    assert "revision 2" in done(run("systems", "store", axis, "--update", system))
    assert json.loads(done(run("systems", "show", system)))["name"] == "axis, longer"
    assert json.loads(done(run("systems", "show", system, "--revision", "1")))["name"] == "axis"
    listed = done(run("systems", "list"))
    assert system in listed
    assert "axis, longer" in listed
    assert [one["id"] for one in json.loads(done(run("systems", "list", "--json")))].count(system) == 1
    done(run("systems", "delete", system))
    assert system not in done(run("systems", "list"))


def test_a_simulation_is_a_table_a_file_and_json(run, axis, tmp_path) -> None:
    table = done(
        run("simulate", axis, "--with", "amplitude=0.1", "--set", "kp=5", "--csv", "curve.csv", "--samples", "50")
    )
    row = next(line for line in table.splitlines() if "overshoot" in line)
    reply = json.loads(done(run("simulate", axis, "--with", "amplitude=0.1", "--set", "kp=5 1/s", "--json")))
    assert f"{reply['variants'][0]['metrics']['position']['overshoot']['value']:.6g}" in row
    with (tmp_path / "curve.csv").open() as file:
        head, *rows = csv.reader(file)
    assert head == ["time [s]", "position"]
    assert len(rows) == 50
    assert abs(float(rows[-1][1]) - 0.1) < 0.01


def test_a_search_is_started_watched_and_repeated_from_its_request(run, sqlite_worker, tmp_path) -> None:
    (tmp_path / "search.json").write_text(json.dumps(OPTIMIZATION | {"system": LAG}))
    job = done(run("optimize", "search.json", "--no-wait")).strip()
    watched = done(run("watch", job))
    assert "certificate: valid" in watched
    assert watched == done(run("jobs", "result", job))
    assert job in done(run("jobs", "list", "--kind", "optimization"))
    (tmp_path / "again.json").write_text(done(run("jobs", "request", job)))
    again = run("optimize", "again.json", "--json")
    first = json.loads(done(run("jobs", "result", job, "--json")))
    assert json.loads(done(again))["best"] == first["best"]
    assert "is queued" in again.stderr or "is running" in again.stderr
    assert run("jobs", "cancel", job).returncode == 0  # it had ended: nothing to stop
    assert "import servotune" in done(run("jobs", "script", job))
    assert f"report_{job}.html: " in done(run("jobs", "report", job))
    assert job in (tmp_path / f"report_{job}.html").read_text(encoding="utf-8")
    done(run("jobs", "report", job, "--pdf", "-o", "found.pdf"))
    assert (tmp_path / "found.pdf").read_bytes().startswith(b"%PDF-")
    missing = run("jobs", "report", "job_nothing", "-o", "nothing.html")
    assert missing.returncode == 1
    assert "job_nothing" in missing.stderr
    assert not (tmp_path / "nothing.html").exists()
    folder = run("jobs", "report", job, "-o", str(tmp_path))
    assert folder.returncode == 2
    assert "the file must be a file that can be written, got the folder" in folder.stderr


def test_a_recording_is_sent(run, sqlite_worker, tmp_path) -> None:
    (tmp_path / "run 7.csv").write_text("t [s];x [mm]\n" + "".join(f"{k / 10};{k}\n" for k in range(20)))
    sent = done(run("upload", "run 7.csv"))
    assert "20 samples at 10.0 per second" in sent
    assert "mm" in sent
    cut = (tmp_path / "run 7.csv").read_text()[:-3]
    (tmp_path / "cut.csv").write_text(cut)
    refused = run("upload", "cut.csv", "--sample-rate", "10")
    assert refused.returncode == 1
    assert "allow_truncated" in refused.stderr


def test_a_file_without_a_recording_is_told_as_that(run, sqlite_worker, sqlite_service, tmp_path) -> None:
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "begun.csv").write_text("t [s],x [mm]\n")
    with sqlite_service.client() as client:
        before = len(client.get("/v1/datasets?limit=200").json()["items"])
        empty = run("upload", "empty.csv")
        assert empty.returncode == 1
        assert "file 'empty.csv' must hold at least one byte, it is empty" in empty.stderr
        assert len(client.get("/v1/datasets?limit=200").json()["items"]) == before
    begun = run("upload", "begun.csv")
    assert begun.returncode == 1
    assert (
        "must hold rows of numbers, got none in its beginning ('t [s],x [mm]' ...): was nothing recorded"
        in begun.stderr
    )


def test_a_page_is_named(run, sqlite_service) -> None:
    assert done(run("open", "sys_1@3", "--print")).strip() == f"{sqlite_service.url}/systems/sys_1"
    assert done(run("open", "--print")).strip() == sqlite_service.url
    assert run("open", "nothing", "--print").returncode == 2


def test_whoever_is_logged_in_needs_neither_address_nor_key(run, sqlite_service, tmp_path) -> None:
    key = sqlite_service.keys["read"]
    told = done(run("login", "--url", sqlite_service.url, "--key-stdin", key=None, text=f"{key}\n"))
    assert key not in told
    (file,) = tmp_path.rglob("profiles.json")
    assert str(file) in told
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    done(run("systems", "list", key=None))
    # the key goes to no other address than the one that it was kept with
    other = run("systems", "list", "--url", sqlite_service.url.replace("127.0.0.1", "localhost"), key=None)
    assert other.returncode == 1
    assert "401" in other.stderr
    assert run("systems", "list", "--profile", "work", key=None).returncode == 1
    done(run("logout", key=None))
    assert run("systems", "list", "--url", sqlite_service.url, key=None).returncode == 1


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["systems", "show", "sys_none"], 1, "404"),
        (["systems", "store", "missing.json"], 2, "missing.json"),
        (["systems", "store", "bad.json"], 2, "must be JSON"),
        (["systems", "store", "list.json"], 2, "must be a JSON object, got list"),
        (["simulate", "axis.json", "--set", "kp"], 2, "must be NAME=VALUE"),
        (["simulate", "axis.json", "--set", "no=1"], 1, "no"),
        (["simulate", "two.json"], 2, "--input must name one of a, b"),
        (["jobs", "list", "--status", "lost"], 2, "lost"),
        (["watch", "job_none"], 1, "404"),
        (["systems", "list", "--url", "ftp://x"], 1, "must begin with http"),
        (["systems", "list", "--url", "http://127.0.0.1:1"], 4, "no answer from"),
        (["sytems"], 2, "there is no command 'sytems'"),
    ],
)
def test_what_is_wrong_is_named_and_never_a_stack_trace(run, files, arguments, code, said) -> None:
    found = run(*arguments)
    assert found.returncode == code, found.stderr
    assert said in found.stderr
    assert "Traceback" not in found.stderr


def test_a_shell_completes_commands_options_and_ids(run, axis) -> None:
    system = done(run("systems", "store", axis)).split()[0]

    def completed(*words: str) -> list[str]:
        asked = {
            "_SERVOTUNE_COMPLETE": "bash_complete",
            "COMP_WORDS": " ".join(["servotune", *words]),
            "COMP_CWORD": str(len(words)),
        }
        return done(run(**asked)).split()

    assert "plain,simulate" in completed("sim")
    assert any("--allow-truncated" in one for one in completed("upload", "--al"))
    assert any(system in one for one in completed("systems", "show", system[:6]))
    assert "_SERVOTUNE_COMPLETE=bash_complete" in done(run("completion", "bash"))
