"""Who may know whom, and what a process must not load."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def run(*command: str, **environment: str) -> subprocess.CompletedProcess[str]:
    inherited = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    return subprocess.run(
        command,
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        env={**inherited, "NO_COLOR": "1", **environment},
    )


#: Prints what a fresh process has loaded, then how many threads it has once linear algebra is there, too.
TELL = """
import json, os, sys, {module}
loaded = sorted(sys.modules)
import numpy, scipy.linalg
print(json.dumps([loaded, len(os.listdir("/proc/self/task")) if sys.platform == "linux" else None]))
"""


@cache
def fresh(module: str) -> tuple[frozenset[str], int | None]:
    """Return what a fresh process that imports a module has loaded, and how many threads it has with linear algebra."""
    done = run(sys.executable, "-c", TELL.format(module=module))
    assert done.returncode == 0, done.stderr
    loaded, threads = json.loads(done.stdout)
    return frozenset(loaded), threads


def test_import_contracts_hold() -> None:
    done = run(str(Path(sys.executable).with_name("lint-imports")), "--no-logo")
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        # control, cvxpy and matplotlib cost seconds each: only the function that needs one imports it.
        (
            "api.app.main",
            ("control", "cvxpy", "distributed", "fpdf", "jinja2", "matplotlib", "nidaqmx", "mpmath", "servotune"),
        ),
        # What writes reports is loaded by the process that writes one.
        ("api.processes.large_request", ("fpdf", "jinja2", "matplotlib", "servotune")),
        # scipy.stats alone is a fifth of the service's start.
        ("api.app.main", ("scipy.signal", "scipy.stats")),
        # Each of them costs a cold start a twentieth to a fifth of a second.
        (
            "engine.batch.screening",
            ("scipy.fft", "scipy.interpolate", "scipy.optimize", "scipy.sparse", "scipy.special"),
        ),
        ("api.convert.systems", ("pint", "scipy.optimize", "scipy.sparse", "scipy.special")),
        # A worker computes; it serves no HTTP.
        ("optimizers.problem", ("fastapi", "pydantic", "sqlalchemy", "pint", "control", "matplotlib")),
        # A lab PC has the base install only.
        ("servotune", ("numpy", "scipy", "fastapi", "pydantic", "sqlalchemy", "engine", "api", "storage")),
        ("servotune.main", ("numpy", "scipy", "fastapi", "pydantic", "sqlalchemy", "engine", "api", "storage")),
    ],
)
def test_a_fresh_process_does_not_load(module: str, absent: tuple[str, ...]) -> None:
    assert set(absent) & fresh(module)[0] == set()


@pytest.mark.skipif(sys.platform != "linux", reason="threads must be countable in /proc")
@pytest.mark.parametrize("module", ["api.commands.service", "api.app.main", "api.processes.worker"])
def test_the_service_computes_with_one_thread_of_linear_algebra(module: str) -> None:
    assert fresh(module)[1] == 1


def test_threads_that_a_user_asks_for_are_left() -> None:
    done = run(sys.executable, "-c", "import os, api; print(os.environ['OMP_NUM_THREADS'])", OMP_NUM_THREADS="3")
    assert done.stdout.split() == ["3"]
