"""No wheel is built without the browser client."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.distributions import FOLDER, PACKAGES


def build(project: Path) -> subprocess.CompletedProcess[str]:
    """Build the wheel of a project where npm is not to be found, with nothing from the network."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(project / "dist")]
    return subprocess.run(command, cwd=project, env={"PATH": str(project)}, capture_output=True, text=True, check=False)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """The server's distribution, with packages that are empty."""
    made = shutil.copytree(FOLDER / "servotune-server", tmp_path / "distributions" / "servotune-server")
    shutil.copy(FOLDER / "hatch_build.py", tmp_path / "distributions")
    for package in PACKAGES["servotune-server"]:
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").touch()
    return made


def test_no_wheel_is_built_without_the_pages(project: Path) -> None:
    done = build(project)
    assert done.returncode != 0
    assert "index.html must exist in a wheel, got none: run `make web` first" in done.stderr
    assert list(project.glob("dist/*.whl")) == []
