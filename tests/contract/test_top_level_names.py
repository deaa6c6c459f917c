"""The names api, engine, optimizers, storage are generic: no other distribution may own one of them here.

Two distributions that own the same top-level package overwrite each other's files on installation and remove them
on uninstallation, silently; this test is the guard (docs/adr/0028).
"""

from __future__ import annotations

import importlib
import importlib.metadata
import subprocess
import sys
from pathlib import Path

import pytest

from servotune.main import ELSEWHERE, GROUP
from tests.support.distributions import OWNER, PROJECTS

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", OWNER)
def test_only_one_distribution_owns(name: str) -> None:
    owners = set(importlib.metadata.packages_distributions().get(name, []))
    assert owners <= {OWNER[name]}, f"{name} is also installed by {sorted(owners - {OWNER[name]})}"


def test_what_is_installed_for_development_is_this_checkout(tmp_path: Path) -> None:
    # Elsewhere than in the checkout, whose folder Python would search first: no copy of a package is installed.
    code = f"from importlib.util import find_spec; print(*(find_spec(name).origin for name in {list(OWNER)}))"
    found = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert found.stdout.split() == [str(ROOT / name / "__init__.py") for name in OWNER]


@pytest.mark.parametrize("name", OWNER)
def test_the_imported_package_is_the_one_of_this_checkout(name: str) -> None:
    module = importlib.import_module(name)
    assert module.__file__ is not None
    assert Path(module.__file__).resolve() == (ROOT / name / "__init__.py").resolve()


def test_the_distribution_is_installed_with_its_command() -> None:
    scripts = importlib.metadata.entry_points(group="console_scripts", name="servotune")
    assert [script.value for script in scripts] == ["servotune.main:main"]


def test_every_subcommand_can_be_loaded() -> None:
    commands = importlib.metadata.entry_points(group=GROUP)
    assert {"serve", "worker", "agent", "rig-simulator"} <= {command.name for command in commands}
    for command in commands:
        assert callable(command.load()), command


def test_the_command_knows_what_the_other_distributions_bring() -> None:
    brought = {name: tuple(project["entry-points"][GROUP]) for name, project in PROJECTS.items() if name != "servotune"}
    assert brought == ELSEWHERE
