"""The wheels hold all of the house and nothing else; they are built by the locked hatchling, without a network."""

from __future__ import annotations

import email
import json
import re
import zipfile
from collections.abc import Iterator
from email.message import Message
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.support.distributions import OWNER, PACKAGES, PROJECTS, build

ROOT = Path(__file__).parents[2]
Wheels = dict[str, zipfile.ZipFile]


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Wheels]:
    target = tmp_path_factory.mktemp("dist")
    opened = {name: zipfile.ZipFile(build(name, target)) for name in PROJECTS}
    yield opened
    for wheel in opened.values():
        wheel.close()


def metadata(wheel: zipfile.ZipFile) -> tuple[str, Message]:
    """Return the folder of a wheel's metadata, and what it says."""
    (info,) = {name.split("/")[0] for name in wheel.namelist() if ".dist-info/" in name}
    return info, email.message_from_bytes(wheel.read(f"{info}/METADATA"))


def test_every_package_of_the_house_is_in_one_of_three() -> None:
    assert set(PROJECTS) == {"servotune", "servotune-server", "servotune-agent"}
    ours = {path.parent.name for path in ROOT.glob("*/py.typed")}
    assert sorted(OWNER) == sorted(ours)
    assert sum(map(len, PACKAGES.values())) == len(ours)


@pytest.mark.parametrize("name", PROJECTS)
def test_top_level_is_its_packages_alone(wheels: Wheels, name: str) -> None:
    top = {entry.split("/")[0] for entry in wheels[name].namelist()}
    assert {entry for entry in top if not entry.endswith(".dist-info")} == set(PACKAGES[name])


@pytest.mark.parametrize("name", PROJECTS)
def test_every_source_file_is_inside(wheels: Wheels, name: str) -> None:
    # Migrations, their template and py.typed are what packaging most easily forgets.
    wanted = {
        str(path.relative_to(ROOT))
        for package in PACKAGES[name]
        for path in (ROOT / package).rglob("*")
        if path.is_file() and path.suffix in {".py", ".pyi", ".mako", ".typed", ".html", ".j2", ".sql"}
    }
    inside = wheels[name].namelist()
    assert wanted - set(inside) == set()
    assert [entry for entry in inside if entry.endswith(".pyc")] == []
    assert {f"{package}/py.typed" for package in PACKAGES[name]} <= set(inside)


def test_migrations_are_inside(wheels: Wheels) -> None:
    inside = wheels["servotune-server"].namelist()
    assert any(entry.startswith("storage/migrations/versions/") and entry.endswith(".py") for entry in inside)


def test_the_pages_are_inside_with_their_scripts(wheels: Wheels) -> None:
    wheel = wheels["servotune-server"]
    names = set(wheel.namelist())
    page = wheel.read("api/static/index.html").decode()
    asked = re.findall(r'(?:src|href)="/(assets/[^"]+)"', page)
    assert any(name.endswith(".js") for name in asked)
    assert {f"api/static/{name}" for name in asked} - names == set()
    # What the first script loads later is named in the manifest of the build.
    built = json.loads(wheel.read("api/static/.vite/manifest.json"))
    assert {f"api/static/{chunk['file']}" for chunk in built.values()} - names == set()


def test_versions_are_one(wheels: Wheels) -> None:
    (version,) = {metadata(wheel)[1]["Version"] for wheel in wheels.values()}
    for name, wheel in wheels.items():
        needed = [Requirement(text) for text in metadata(wheel)[1].get_all("Requires-Dist", [])]
        own = {str(one) for one in needed if one.name in PROJECTS}
        assert own == (set() if name == "servotune" else {f"servotune=={version}"})


@pytest.mark.parametrize("name", PROJECTS)
def test_metadata_names_licence_and_text(wheels: Wheels, name: str) -> None:
    info, said = metadata(wheels[name])
    assert said["License-Expression"] == "Apache-2.0"
    assert wheels[name].read(f"{info}/licenses/LICENSE") == (ROOT / "LICENSE").read_bytes()
    assert said.get_payload().startswith(f"# {name}\n")


def test_the_client_is_small_pure_and_needs_little(wheels: Wheels) -> None:
    wheel = wheels["servotune"]
    info, said = metadata(wheel)
    assert Path(str(wheel.filename)).name.endswith("-py3-none-any.whl")
    assert Path(str(wheel.filename)).stat().st_size < 1e6
    base = [text for text in said.get_all("Requires-Dist", []) if "extra ==" not in text]
    assert sorted(Requirement(text).name for text in base) == ["click", "httpx", "tqdm"]
    assert "servotune = servotune.main:main" in wheel.read(f"{info}/entry_points.txt").decode()
