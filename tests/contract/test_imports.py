"""Who may know whom, and what a process must not load."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def run(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, env={**os.environ, "NO_COLOR": "1"}
    )


def test_import_contracts_hold() -> None:
    done = run(str(Path(sys.executable).with_name("lint-imports")), "--no-logo")
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        # control, cvxpy and matplotlib cost seconds each: only the function that needs one imports it.
        ("api.main", ("control", "cvxpy", "matplotlib", "nidaqmx", "mpmath", "servotune")),
        # A worker computes; it serves no HTTP.
        ("optimizers.problem", ("fastapi", "pydantic", "sqlalchemy", "pint", "control", "matplotlib")),
        # A lab PC has the base install only.
        ("servotune", ("numpy", "scipy", "fastapi", "pydantic", "sqlalchemy", "engine", "api", "storage")),
        ("servotune.main", ("numpy", "scipy", "fastapi", "pydantic", "sqlalchemy", "engine", "api", "storage")),
    ],
)
def test_a_fresh_process_does_not_load(module: str, absent: tuple[str, ...]) -> None:
    code = f"import sys, {module}; print(*sorted(set({absent!r}) & set(sys.modules)))"
    done = run(sys.executable, "-c", code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []
