"""What the image and the compose file name exists here; that they build and start only a container engine can tell."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from api.commands import maintenance
from api.commands import service as serving
from api.settings import Settings
from tests.support.distributions import OWNER

ROOT = Path(__file__).parents[2]
IMAGE = (ROOT / "Containerfile").read_text()
COMPOSE: dict[str, Any] = yaml.safe_load((ROOT / "compose.yaml").read_text())
OURS = {**vars(maintenance), **vars(serving)}
UNITS = sorted((ROOT / "deploy").glob("*.service"))
KNOWN = {f"SERVOTUNE_{name.upper()}" for name in Settings.model_fields}
OWN = [name for name, service in COMPOSE["services"].items() if service["image"] == COMPOSE["x-servotune"]["image"]]

COMMANDS = [
    json.loads(re.findall(r"^CMD (.*)$", IMAGE, flags=re.MULTILINE)[-1]),
    *(COMPOSE["services"][name]["command"] for name in OWN),
]


def test_everything_that_is_copied_into_the_image_is_there() -> None:
    copied = [line.split()[1:-1] for line in re.findall(r"^COPY (?!--from).*$", IMAGE, flags=re.MULTILINE)]
    assert len(copied) > 5
    for source in (name for names in copied for name in names):
        assert (ROOT / source).exists(), source


def test_what_the_pages_import_from_elsewhere_is_copied_to_where_they_are_built() -> None:
    stage = IMAGE.split("\nFROM ")[1]
    copied = [target for _, target in re.findall(r"^COPY (\S+) \.\./(\S+)$", stage, flags=re.MULTILINE)]
    web = ROOT / "web"
    imported = {
        (source.parent / name).resolve().relative_to(ROOT)
        for source in [*(web / "src").rglob("*.ts"), *(web / "src").rglob("*.tsx")]
        for name in re.findall(r'from "(\.\.?/[^"]+)"', source.read_text())
        if not (source.parent / name).resolve().is_relative_to(web)
    }
    assert imported
    for path in imported:
        assert any(path.is_relative_to(target) for target in copied), path


@pytest.mark.parametrize("ignoring", [".dockerignore", ".containerignore"])
def test_what_is_copied_is_not_ignored(ignoring: str) -> None:
    kept = [Path(line[1:]) for line in (ROOT / ignoring).read_text().splitlines() if line.startswith("!")]
    for line in re.findall(r"^COPY (?!--from).*$", IMAGE, flags=re.MULTILINE):
        for source in line.split()[1:-1]:
            assert any(Path(source).is_relative_to(path) for path in kept), source


def test_every_package_that_is_installed_is_copied_into_the_image() -> None:
    installed = set(re.findall(r"\./distributions/(\S+)", IMAGE))
    assert installed == {"servotune", "servotune-server"}  # the agent is a lab PC's
    for package, distribution in OWNER.items():
        copied = re.search(rf"^COPY {package} {package}$", IMAGE, flags=re.MULTILINE) is not None
        assert copied == (distribution in installed), package


def test_what_runs_is_installed_by_the_lock_of_the_image_alone() -> None:
    final = IMAGE.split("\nFROM ")[-1]
    (home,) = re.findall(r"^COPY --from=build (\S+) ", final, flags=re.MULTILINE)
    installing = f"pip --python {home}/bin/python install"
    into = [line for line in IMAGE.replace("\\\n", " ").splitlines() if installing in line]
    locks = {name for line in into for name in re.findall(r"-r (\S+\.lock)", line)}
    assert locks == {"requirements-image.lock"}
    assert all("--no-compile" in command for line in into for command in line.split("&&") if installing in command)
    assert f"{home}/bin/pip" not in IMAGE
    (kept,) = re.findall(r"PYTHONPYCACHEPREFIX=(\S+)", final)
    assert any(Path(kept).is_relative_to(volume) for volume in re.findall(r"^VOLUME (\S+)$", final, flags=re.MULTILINE))


def test_what_the_image_leaves_out_of_its_parts_is_there() -> None:
    # a later version may name it otherwise, and then the image would not be built, or would be larger than it says
    installed = Path(np.__file__).parents[1]
    (left_out,) = re.findall(r"&& rm -r (.*?) && find", IMAGE.replace("\\\n", " "))
    patterns = left_out.split()
    assert len(patterns) > 10
    for pattern in patterns:
        found = list(installed.glob(pattern))
        assert found, pattern
        # what is left has each of the names that programs ask for
        assert all(path.name not in {"libhighs.so.1", "libarrow_python.so.2600"} for path in found), pattern


def test_what_a_container_gets_from_another_stage_is_made_there() -> None:
    stages = re.findall(r"^FROM \S+ AS (\w+)$", IMAGE, flags=re.MULTILINE)
    assert set(re.findall(r"--from=(\w+)", IMAGE)) <= set(stages)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_is_one_of_ours(command, capsys) -> None:
    takes_its_arguments(command, capsys)


def takes_its_arguments(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Make sure that a container's command is one of ours and takes the arguments that it is given."""
    program, name, *arguments = command
    assert program == "servotune"
    with pytest.raises(SystemExit) as ended:
        OURS[name]([*arguments, "--help"])
    assert ended.value.code == 0
    shown = capsys.readouterr().out
    assert [argument for argument in arguments if argument.startswith("--") and argument not in shown] == []


def test_every_setting_that_is_given_is_one() -> None:
    given = {key for name in OWN for key in COMPOSE["services"][name]["environment"]}
    given |= {key for unit in UNITS for key in re.findall(r"Environment=\"?(SERVOTUNE_\w+)", unit.read_text())}
    given |= set(re.findall(r"\b(SERVOTUNE_[A-Z_]+)=", IMAGE))
    assert "SERVOTUNE_DATABASE_URL" in given
    assert {key for key in given if key.startswith("SERVOTUNE_")} <= KNOWN


def test_services_and_volumes_that_are_named_are_there() -> None:
    services = COMPOSE["services"]
    for service in services.values():
        assert set(service.get("depends_on", {})) <= set(services)
        named = [volume.split(":")[0] for volume in service.get("volumes", [])]
        assert set(named) <= set(COMPOSE["volumes"])
        for needed, how in service.get("depends_on", {}).items():
            assert how["condition"] != "service_healthy" or "healthcheck" in services[needed]


def test_who_runs_it_may_write_where_the_kernels_are_kept() -> None:
    final = IMAGE.split("\nFROM ")[-1]
    (user,) = re.findall(r"^USER (\w+)$", final, flags=re.MULTILINE)
    volumes = re.findall(r"^VOLUME (\S+)$", final, flags=re.MULTILINE)
    assert volumes
    for volume in volumes:
        assert f"install --directory --owner {user} --group {user} {volume}" in final.split(f"USER {user}")[0]
    for unit in UNITS:
        (kept,) = re.findall(r"XDG_CACHE_HOME=/var/cache/(\S+)", unit.read_text())
        assert f"\nCacheDirectory={kept}\n" in unit.read_text(), unit


def test_units_start_what_is_there() -> None:
    assert len(UNITS) == 2
    for unit in UNITS:
        (start,) = re.findall(r"^ExecStart=(.*)$", unit.read_text(), flags=re.MULTILINE)
        program, name, *_ = shlex.split(start)
        assert Path(program).name == "servotune"
        assert name in OURS
