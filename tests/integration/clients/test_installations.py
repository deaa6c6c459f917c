"""Each wheel in an environment of its own, with what the registry has: what comes with it, and that it starts."""

from __future__ import annotations

import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.distributions import OWNER, PROJECTS, ROOT, build

#: What the client may bring: Python alone.
SMALL = {"anyio", "certifi", "click", "h11", "httpcore", "httpx", "idna", "servotune", "tqdm", "typing-extensions"}
#: Nothing of this process's environment, and nothing that a person has set for services.
CLEAN = {name: value for name, value in os.environ.items() if not name.startswith(("SERVOTUNE_", "PYTHON"))}

STEP = """
import httpx, servotune
with servotune.local() as client:
    loop = servotune.feedback(servotune.gain(25) >> servotune.tf([1], [0.02, 1, 0])).system("axis")
    reply = client.simulate(loop, input={"port": "r", "signal": {"kind": "step"}})
    print(reply.metrics["y"].overshoot.value, "<title>Servotune" in httpx.get(client.url, headers={"Accept": "text/html"}).text)
"""


class Environment:
    """A virtual environment without pip, filled by this one's."""

    def __init__(self, place: Path, constraints: Path, *wanted: str) -> None:
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(place)], check=True, env=CLEAN)
        self.place = place
        pip(
            "--python", str(place / "bin" / "python"), "install", "-q", "-c", str(constraints), *wanted
        ).check_returncode()

    def run(self, program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        environment = {**CLEAN, "HOME": str(self.place), "XDG_CONFIG_HOME": str(self.place / "config")}
        return subprocess.run(
            [str(self.place / "bin" / program), *arguments],
            cwd=self.place, env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip

    def has(self, *modules: str) -> set[str]:
        """Return those of the modules that can be imported there."""
        code = f"from importlib.util import find_spec; print(*(name for name in {modules!r} if find_spec(name)))"
        return set(self.run("python", "-c", code).stdout.split())

    def site(self) -> Path:
        (found,) = self.place.glob("lib/python*/site-packages")
        return found

    def distributions(self) -> set[str]:
        found = (path.name.split("-")[0] for path in self.site().glob("*.dist-info"))
        return {re.sub(r"[-_.]+", "-", name).lower() for name in found}


def pip(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", *arguments]
    return subprocess.run(command, env=CLEAN, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def constraints(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The versions of the lock; without a registry there is nothing to install."""
    place = tmp_path_factory.mktemp("constraints")
    pinned = re.findall(
        r"^([a-z0-9._-]+)(?:\[[^\]]*\])?(==[^ ]+)", (ROOT / "requirements.lock").read_text(), flags=re.MULTILINE
    )
    file = place / "constraints.txt"
    file.write_text("".join(f"{name}{version}\n" for name, version in pinned))
    asked = [
        "--no-deps",
        "--no-cache-dir",
        "--retries",
        "1",
        "--timeout",
        "20",
        "-c",
        str(file),
        "-d",
        str(place),
        "h11",
    ]
    answered = pip("download", "-q", *asked)
    if answered.returncode:
        pytest.skip(f"pip reaches no registry: {answered.stderr.strip().splitlines()[-1]}")
    return file


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    target = tmp_path_factory.mktemp("dist")
    return {name: str(build(name, target)) for name in PROJECTS}


def test_the_client_alone(tmp_path: Path, wheels, constraints: Path) -> None:
    found = Environment(tmp_path / "client", constraints, wheels["servotune"])
    assert found.distributions() == SMALL
    assert found.has(*OWNER, "numpy", "pydantic", "fastapi", "sqlalchemy") == {"servotune"}
    files = [path for path in found.site().rglob("*") if path.is_file()]
    assert [path for path in files if path.suffix in {".so", ".pyd"}] == []
    assert any(path.suffix == ".pyc" for path in files)  # what pip has compiled counts, too
    assert sum(path.stat().st_size for path in files) <= 10e6

    assert found.run("python", "-W", "error", "-c", "import servotune").stderr == ""
    shown = found.run("servotune", "--help")
    assert (shown.returncode, shown.stderr) == (0, "")
    assert re.search(r"^  simulate ", shown.stdout, flags=re.MULTILINE)
    refused = found.run("servotune", "serve")
    assert refused.returncode == 2
    assert "pip install servotune-server" in refused.stderr
    without = found.run("python", "-c", "import servotune; servotune.local()")
    assert "pip install servotune-server" in without.stderr


def test_the_agent_with_its_driver(tmp_path: Path, wheels, constraints: Path) -> None:
    wanted = f"servotune-agent[nidaqmx] @ {Path(wheels['servotune-agent']).as_uri()}"
    found = Environment(tmp_path / "agent", constraints, "--no-compile", wheels["servotune"], wanted)
    assert found.has(*OWNER, "nidaqmx", "grpc") == {"servotune", "agent", "nidaqmx", "grpc"}
    shown = found.run("servotune", "agent", "--help")
    assert (shown.returncode, shown.stderr) == (0, "")
    assert "--settings" in shown.stdout
    loaded = found.run("python", "-c", "from agent.drivers.loading import load; print(load('nidaqmx').__name__)")
    assert (loaded.stdout.strip(), loaded.stderr) == ("Nidaqmx", "")


def test_the_server_answers_and_shows_its_pages(tmp_path: Path, wheels, constraints: Path) -> None:
    # What is not imported need not be compiled: that was most of the time.
    found = Environment(
        tmp_path / "server", constraints, "--no-compile", wheels["servotune"], wheels["servotune-server"]
    )
    assert found.has(*OWNER) == set(OWNER) - {"agent"}
    shown = found.run("servotune", "--help").stdout
    for command in PROJECTS["servotune-server"]["entry-points"]["servotune.commands"]:
        assert re.search(rf"^  {command} ", shown, flags=re.MULTILINE), command
    answered = found.run("python", "-c", STEP)
    assert answered.returncode == 0, answered.stderr
    overshoot, pages = answered.stdout.split()
    assert float(overshoot) == pytest.approx(math.exp(-math.pi), rel=1e-9)  # damping ratio 1/√2
    assert pages == "True"
