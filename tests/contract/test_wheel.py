"""The wheel holds all of the house and nothing else; it is built by the locked hatchling, without a network."""

from __future__ import annotations

import email
import json
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
OURS = ("agent", "api", "engine", "optimizers", "rig_simulator", "storage", "servotune")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[zipfile.ZipFile]:
    target = tmp_path_factory.mktemp("dist")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(target)],
        cwd=ROOT, check=True, capture_output=True,
    )  # fmt: skip
    (path,) = target.glob("*.whl")
    with zipfile.ZipFile(path) as archive:
        yield archive


def test_top_level_is_our_packages_alone(wheel: zipfile.ZipFile) -> None:
    top = {name.split("/")[0] for name in wheel.namelist()}
    assert {name for name in top if not name.endswith(".dist-info")} == set(OURS)


def test_every_source_file_is_inside(wheel: zipfile.ZipFile) -> None:
    # Migrations, their template and py.typed are what packaging most easily forgets.
    wanted = {
        str(path.relative_to(ROOT))
        for package in OURS
        for path in (ROOT / package).rglob("*")
        if path.is_file() and path.suffix in {".py", ".mako", ".typed", ".html", ".j2", ".sql"}
    }
    assert wanted - set(wheel.namelist()) == set()


def test_migrations_are_inside(wheel: zipfile.ZipFile) -> None:
    assert any(name.startswith("storage/migrations/versions/") and name.endswith(".py") for name in wheel.namelist())


def test_the_pages_are_inside_with_their_scripts(wheel: zipfile.ZipFile) -> None:
    names = set(wheel.namelist())
    page = wheel.read("api/static/index.html").decode()
    asked = re.findall(r'(?:src|href)="/(assets/[^"]+)"', page)
    assert any(name.endswith(".js") for name in asked)
    assert {f"api/static/{name}" for name in asked} - names == set()
    # What the first script loads later is named in the manifest of the build.
    built = json.loads(wheel.read("api/static/.vite/manifest.json"))
    assert {f"api/static/{chunk['file']}" for chunk in built.values()} - names == set()


@pytest.mark.parametrize("package", OURS)
def test_types_are_published(wheel: zipfile.ZipFile, package: str) -> None:
    assert f"{package}/py.typed" in wheel.namelist()


def test_metadata_names_licence_command_and_extras(wheel: zipfile.ZipFile) -> None:
    (info,) = {name.split("/")[0] for name in wheel.namelist() if ".dist-info/" in name}
    metadata = email.message_from_bytes(wheel.read(f"{info}/METADATA"))
    assert metadata["License-Expression"] == "Apache-2.0"
    assert {"server", "agent", "demo", "dev"} <= set(metadata.get_all("Provides-Extra", []))
    base = [r for r in metadata.get_all("Requires-Dist", []) if "extra ==" not in r]
    assert sorted(requirement.split(">")[0] for requirement in base) == ["click", "httpx", "rich"]
    assert "servotune = servotune.main:main" in wheel.read(f"{info}/entry_points.txt").decode()
    assert f"{info}/licenses/LICENSE" in wheel.namelist()
