"""No wheel is built without the browser client."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
#: What a wheel is made from, here with packages that are empty.
_PACKAGES = ("agent", "api", "engine", "optimizers", "rig_simulator", "storage", "servotune")


def build(project: Path) -> subprocess.CompletedProcess[str]:
    """Build the wheel of a project where npm is not to be found, with nothing from the network."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(project / "dist")]
    return subprocess.run(command, cwd=project, env={"PATH": str(project)}, capture_output=True, text=True, check=False)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    for name in ("pyproject.toml", "hatch_build.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path)
    for package in _PACKAGES:
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").touch()
    return tmp_path


def test_no_wheel_is_built_without_the_pages(project: Path) -> None:
    done = build(project)
    assert done.returncode != 0
    assert "index.html must exist in a wheel, got none: run `make web` first" in done.stderr
    assert list(project.glob("dist/*.whl")) == []
