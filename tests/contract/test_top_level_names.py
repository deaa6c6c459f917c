"""The names api, engine, optimizers, storage are generic: no other distribution may own one of them here.

Two distributions that own the same top-level package overwrite each other's files on installation and remove them
on uninstallation, silently; this test is the guard (docs/adr/0028).
"""

from __future__ import annotations

import importlib
import importlib.metadata
from pathlib import Path

import pytest

from servotune.main import ELSEWHERE, GROUP
from tests.support.distributions import OWNER, PROJECTS

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", OWNER)
def test_only_one_distribution_owns(name: str) -> None:
    owners = set(importlib.metadata.packages_distributions().get(name, []))
    assert owners <= {OWNER[name]}, f"{name} is also installed by {sorted(owners - {OWNER[name]})}"


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
