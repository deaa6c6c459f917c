"""What makes the agent a service: judged as the service will find it, with any path, and never with a key in it."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from agent.errors import SettingsError
from agent.installing import Installed, content, judged, next_commands, target, write
from tests.support.windows import Windows

GOOD = """
[service]
url = "http://one"
key_file = "key"
[rig]
name = "bench-1"
[daq]
driver = "file"
folder = "/srv/bench-1"
[spool]
folder = "/var/lib/servotune-agent"
[[outputs]]
name = "valve"
channel = "Y0"
amplitude = 4.0
slew = 8.0
safe = 1.0
soft_stop = 0.5
[[outputs]]
name = "brake"
channel = "Y1"
amplitude = 1.0
soft_stop = 3.0
"""
HARD = 'Prüfstand 1 & 2\'s <100%> $HOME "x"'
WINDOWS = Installed(
    python=r"D:\Programme & Daten\Prüfstand <1>\Scripts\python.exe",
    settings=rf"D:\Prüfstand 1\{'lang' * 60}\agent.toml",
    folder=rf"D:\Prüfstand 1\{'lang' * 60}",
    spool=r"D:\Daten",
    stop=120,
)


def written(folder: Path, given: str = GOOD, *, key: str = "st_secret\n") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "key").write_text(key)
    path = folder / "agent.toml"
    path.write_text(given)
    return path


def values(text: str, name: str) -> list[str]:
    """Return what a unit says of a name, its specifiers and variables undone."""
    return [value.replace("%%", "%") for value in re.findall(rf"^{name}=(.*)$", text, flags=re.MULTILINE)]


def test_a_unit_starts_this_python_with_these_settings(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("SERVOTUNE_AGENT_KEY", "st_of_this_terminal")
    made = judged(written(tmp_path), {"service.url": None})
    text = content(made, platform="linux")
    (start,) = values(text, "ExecStart")
    command = [sys.executable, "-P", "-m", "servotune", "agent", "--settings", str(tmp_path / "agent.toml")]
    assert shlex.split(start) == command
    assert values(text, "WorkingDirectory") == [str(tmp_path)]
    assert values(text, "StateDirectory") == ["servotune-agent"]
    assert values(text, "Restart") == ["always"]
    # two answers of the service (30 s), three deadlines (10 s), ways home: pi/2 (4 + 1) / 8 s, and 3 s
    assert values(text, "TimeoutStopSec") == ["94"]
    assert "st_secret" not in text
    assert "st_of_this_terminal" not in text


@pytest.mark.parametrize("name", ["bench", "Prüfstand 1", HARD])
@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
def test_systemd_takes_any_path(tmp_path, monkeypatch, name) -> None:
    folder = tmp_path / name
    spool = tmp_path / "spool"
    path = written(folder, GOOD.replace("/var/lib/servotune-agent", str(spool)))
    python = tmp_path / re.sub("[$'\"]", "", name) / "python"
    python.parent.mkdir(exist_ok=True)
    python.symlink_to(sys.executable)
    monkeypatch.setattr(sys, "executable", str(python))
    text = content(judged(path, {}), platform="linux")
    assert "StateDirectory" not in text
    (start,) = values(text, "ExecStart")
    assert shlex.split(start.replace("$$", "$"))[0] == str(python)
    assert shlex.split(start.replace("$$", "$"))[-1] == str(path)
    unit = tmp_path / "servotune-agent.service"
    unit.write_text(text)
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(unit)], capture_output=True, text=True, check=False
    )
    ours = [line for line in done.stderr.splitlines() if "servotune-agent" in line]
    assert ours == []
    unit.write_text(text.replace("/python", "/no-such-python"))
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(unit)], capture_output=True, text=True, check=False
    )
    assert "servotune-agent" in done.stderr  # else the line above would prove nothing


def test_winsw_gets_any_path() -> None:
    root = ET.fromstring(content(WINDOWS, platform="windows").encode())
    assert root.tag == "service"
    told = {element.tag: element.text for element in root}
    assert told["executable"] == WINDOWS.python
    assert told["arguments"] == f'-P -m servotune agent --settings "{WINDOWS.settings}"'
    assert told["workingdirectory"] == WINDOWS.folder
    assert (told["startmode"], told["delayedAutoStart"], told["stoptimeout"]) == ("Automatic", "true", "120 sec")
    assert [element.attrib for element in root.iter("onfailure")] == [{"action": "restart", "delay": "5 sec"}]
    log = root.find("log")
    assert log is not None
    assert (log.get("mode"), log.findtext("sizeThreshold"), log.findtext("keepFiles")) == ("roll-by-size", "10240", "8")
    assert {element.get("name"): element.get("value") for element in root.iter("env")}["PYTHONUTF8"] == "1"


def test_the_file_is_written_where_windows_lets_it(tmp_path, monkeypatch) -> None:
    Windows(monkeypatch, tmp_path)
    made = judged(written(tmp_path / "Prüfstand 1"), {}, platform="windows")
    path = target(made, platform="windows")
    assert path == tmp_path / "Prüfstand 1" / "servotune-agent.xml"
    text = content(made, platform="windows")
    write(path, text, force=False)
    assert path.read_bytes().decode() == text
    commands = next_commands(made, path, platform="windows")
    program = path.with_suffix(".exe")
    assert commands[1:3] == [f'& "{program}" install', f'& "{program}" start']
    with pytest.raises(SettingsError, match=r"nul.xml must be writable: The filename, directory name"):
        write(tmp_path / "nul.xml", text, force=False)


def test_a_file_that_is_there_stays_without_force(tmp_path) -> None:
    path = tmp_path / "servotune-agent.service"
    path.write_text("mine")
    with pytest.raises(SettingsError, match="is there already: give --force"):
        write(path, "new", force=False)
    assert path.read_text() == "mine"
    write(path, "new", force=True)
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o644
    with pytest.raises(SettingsError, match=r"x.service must be writable: No such file or directory; run it as root"):
        write(tmp_path / "none" / "x.service", "new", force=False)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (GOOD.replace('key_file = "key"', ""), "service.key_file must be given in the settings: .* no key is written"),
        (GOOD.replace('key_file = "key"', 'key = "st_x"'), "service.key_file must be given"),
        (GOOD.replace('"key"', '"none"'), "key_file must be readable, got none: No such file"),
        (
            GOOD.replace("/var/lib/servotune-agent", "spool"),
            "spool.folder must be a whole path for a service, got spool",
        ),
        (GOOD.replace("[rig]", "[rig]\nconfirm = true"), "rig.confirm must be false for a service"),
        (GOOD.replace("amplitude = 4.0", ""), r"outputs\[0\].amplitude must be given"),
        (GOOD.replace('"file"', '"magic"'), "daq.driver must be one of "),
    ],
)
def test_a_service_that_could_not_start_is_refused_with_the_reason(tmp_path, monkeypatch, given, says) -> None:
    monkeypatch.setenv("SERVOTUNE_AGENT_KEY", "st_of_this_terminal")
    with pytest.raises(SettingsError, match=says):
        judged(written(tmp_path, given), {})


def test_what_is_given_beside_the_settings_is_refused(tmp_path) -> None:
    path = written(tmp_path)
    with pytest.raises(SettingsError, match=r"service.url must be given in the settings"):
        judged(path, {"service.url": "http://two"})
    with pytest.raises(SettingsError, match="--settings must be given"):
        judged(None, {})
    with pytest.raises(SettingsError, match=r"--settings must be a file, got .*none.toml"):
        judged(tmp_path / "none.toml", {})
    with pytest.raises(SettingsError, match="key_file must hold a key, key is empty"):
        judged(written(tmp_path, key="\n"), {})


@pytest.mark.parametrize(
    ("name", "platform", "says"),
    [
        ("a\nb", "linux", "no control characters"),
        ("100%", "windows", "must hold no %"),
    ],
)
def test_a_path_that_a_file_cannot_hold_is_refused(tmp_path, name, platform, says) -> None:
    with pytest.raises(SettingsError, match=says):
        judged(written(tmp_path / name), {}, platform=platform)


@pytest.mark.parametrize("name", ["$x", "x's", 'x"', "x\\"])
def test_a_python_that_systemd_would_not_find_is_refused(tmp_path, monkeypatch, name) -> None:
    monkeypatch.setattr(sys, "executable", f"/opt/{name}/bin/python")
    with pytest.raises(SettingsError, match=r"Python must hold no \$, quotes and"):
        judged(written(tmp_path), {})


def test_the_next_commands_are_the_ones_of_systemd(tmp_path) -> None:
    made = judged(written(tmp_path / "Prüfstand 1"), {})
    commands = next_commands(made, target(made, platform="linux"), platform="linux")
    assert shlex.split(commands[2])[:3] == ["sudo", "-u", "servotune"]
    assert shlex.split(commands[2])[3:] == made.command("check")
    assert commands[3:5] == ["sudo systemctl daemon-reload", "sudo systemctl enable --now servotune-agent"]
    elsewhere = next_commands(made, tmp_path / "x.service", platform="linux")
    assert elsewhere[4].endswith(f"enable --now {tmp_path / 'x.service'}")
