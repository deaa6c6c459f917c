"""Test files that what has changed since a commit can reach first: those that changed, and those that import what changed.

    python -m tests.affected [commit]

prints them, one a line. Only direct imports count: what is reached through three others is for `make test`. Tests of the
running service, of browsers and at random are left out, as they take minutes.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
PACKAGES = ("agent", "api", "engine", "optimizers", "rig_simulator", "servotune", "storage", "tests")
SLOW = ("tests/integration/", "tests/browser/", "tests/property/")


def changed(since: str) -> list[str]:
    """Return the paths that differ from a commit, new ones included, those of files that are gone left out."""
    commands = (["diff", "--name-only", "--diff-filter=d", since], ["ls-files", "--others", "--exclude-standard"])
    return [
        path
        for command in commands
        for path in subprocess.run(
            ["git", *command], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout.splitlines()
    ]


def module(path: str) -> str:
    """Return the module that a path is."""
    return path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def affected(paths: list[str]) -> list[str]:
    """Return the test files for changed paths."""
    graph = grimp.build_graph(*PACKAGES)
    modules = {module(path) for path in paths if path.endswith(".py")} & graph.modules
    reached = {name for one in modules for name in graph.find_modules_that_directly_import(one)} | modules
    found = {name.replace(".", "/") + ".py" for name in reached if name.rpartition(".")[2].startswith("test_")}
    return sorted(path for path in found if not path.startswith(SLOW) and (ROOT / path).exists())


if __name__ == "__main__":
    since = sys.argv[1] if len(sys.argv) > 1 else "HEAD"
    sys.stdout.write("".join(f"{path}\n" for path in affected(changed(since))))
