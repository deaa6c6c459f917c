"""The recipes of CONTRIBUTING.md work: their files, put where they say, pass the tests that find new parts by themselves."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text()
RECIPES = dict(re.findall(r"```python\n# (\S+\.py)\n(.*?)```", PAGE, flags=re.DOTALL))
CONFORMANCE = {
    "engine/elements": ("tests/contract/test_catalogue_elements.py", "tests/reference/test_batch_elements.py"),
    "engine/metrics": ("tests/contract/test_catalogue_metrics.py",),
    "optimizers/methods": ("tests/contract/test_catalogue_methods.py",),
}
PACKAGES = ("agent", "api", "bench", "engine", "optimizers", "rig_simulator", "servotune", "storage", "tests")


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the packages with the new files in it; compiled kernels come along, as their files are as old as before."""
    place = tmp_path_factory.mktemp("house")
    leave = shutil.ignore_patterns("static", "databases", "node_modules")
    for package in PACKAGES:
        shutil.copytree(ROOT / package, place / package, ignore=leave)
    shutil.copy2(ROOT / "pyproject.toml", place)
    for path, text in RECIPES.items():
        assert not (place / path).exists(), path
        (place / path).write_text(text)
    return place


def run(house: Path, *command: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(house), "NO_COLOR": "1", "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.run(
        [sys.executable, "-m", *command], cwd=house, env=environment, capture_output=True, text=True, check=False
    )


def test_there_is_a_recipe_for_each() -> None:
    assert {path.rpartition("/")[0] for path in RECIPES} == set(CONFORMANCE)


@pytest.mark.parametrize("path", RECIPES)
def test_a_new_file_passes_what_finds_it(house: Path, path: str) -> None:
    folder, _, name = path.removesuffix(".py").rpartition("/")
    done = run(house, "pytest", "-q", "-p", "no:cacheprovider", "-k", name, *CONFORMANCE[folder])
    assert done.returncode == 0, done.stdout[-6000:]
    passed = int(re.findall(r"(\d+) passed", done.stdout)[-1])
    assert passed >= 5, done.stdout[-2000:]


def test_new_files_are_in_form(house: Path) -> None:
    done = run(house, "ruff", "check", "--config", str(ROOT / "pyproject.toml"), *RECIPES)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    "path", sorted(set(re.findall(r"`((?:api|docs|engine|optimizers|storage|tests|web)/[\w/.-]+)`", PAGE)))
)
def test_what_a_recipe_names_exists(path: str) -> None:
    assert (ROOT / path).exists()
