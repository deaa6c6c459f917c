"""`servotune agent install`: what it writes starts an agent that ends at SIGTERM, without a variable and from any folder."""

from __future__ import annotations

import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

from tests.integration.agent.lab import RIG, Lab


def install(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "servotune", "agent", "install", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def settings(lab: Lab) -> Path:
    folder = lab.folder / "Prüfstand 1"
    folder.mkdir()
    (folder / "key").write_text(lab.service.keys["acquire"])
    path = folder / "agent.toml"
    content = RIG.format(rig=lab.rig).replace("[spool]", f'[spool]\nfolder = "{lab.spool}"')
    content = content.replace("[daq]", f'[daq]\nserver = "127.0.0.1:{lab.server.port}"')
    path.write_text(f'[service]\nurl = "{lab.service.url}"\nkey_file = "key"\n{content}')
    return path


def test_the_command_of_the_unit_is_an_agent(lab) -> None:
    path, unit = settings(lab), lab.folder / "servotune-agent.service"
    done = install("--settings", str(path), "--to", str(unit), "--platform", "linux")
    assert done.returncode == 0, done.stderr
    assert "systemctl daemon-reload" in done.stdout
    content = unit.read_text()
    assert lab.service.keys["acquire"] not in content
    again = install("--settings", str(path), "--to", str(unit), "--platform", "linux")
    assert (again.returncode, again.stderr.strip().endswith("--print to see what would be in it")) == (2, True)
    assert install("--settings", str(path), "--print", "--platform", "linux").stdout == content
    (start,) = re.findall(r"^ExecStart=(.*)$", content, flags=re.MULTILINE)
    (folder,) = re.findall(r"^WorkingDirectory=(.*)$", content, flags=re.MULTILINE)
    with subprocess.Popen(
        shlex.split(start), cwd=folder, env={"PYTHONUNBUFFERED": "1"}, stderr=subprocess.PIPE, text=True
    ) as agent:
        try:
            lab.registered()
        finally:
            agent.send_signal(signal.SIGTERM)
        _, told = agent.communicate(timeout=60)
    assert agent.returncode == 0, told


def test_settings_that_make_no_service_are_refused(lab) -> None:
    path = settings(lab)
    path.write_text(path.read_text().replace('key_file = "key"', ""))
    done = install("--settings", str(path), "--to", str(lab.folder / "unit"))
    assert done.returncode == 2
    assert "service.key_file must be given" in done.stderr
    assert not (lab.folder / "unit").exists()
