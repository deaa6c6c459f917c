"""What the client costs by itself: its wheel, an installation, and `import servotune`; run as `python -m bench.client`.

Installations are made by pip into new environments, first with nothing kept from earlier ones, then with what the first has kept.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from bench.table import Job, Row

ROOT = Path(__file__).parents[1]
RUNS = 15


def jobs() -> list[Job]:
    """Build the wheel, install it twice, and import it there."""
    with tempfile.TemporaryDirectory(prefix="servotune-client-") as folder:
        wheel = _built(Path(folder))
        cold, warm = (_installed(Path(folder), name, wheel) for name in ("first", "second"))
        place = Path(folder) / "second"
        bytes_ = sum(path.stat().st_size for path in place.glob("lib/**/*") if path.is_file())
        installing = Job(
            title="installation of the client, with all that it needs",
            clock="wall",
            rows=[
                Row(who="nothing kept", milliseconds=cold, remark=f"wheel of {wheel.stat().st_size / 1e6:.2f} MB"),
                Row(who="from pip's cache", milliseconds=warm, remark=f"{bytes_ / 1e6:.1f} MB on the disk, compiled"),
            ],
        )
        python = str(place / "bin" / "python")
        importing = Job(
            title="new process of Python",
            rows=[
                Row(who=what or "nothing", milliseconds=_cpu(lambda code=what: _run(python, "-c", code)), remark=remark)  # type: ignore[misc]
                for what, remark in (("", "the interpreter"), ("import servotune", ""), ("import httpx", ""))
            ],
        )
        return [installing, importing]


def _built(folder: Path) -> Path:
    project = ROOT / "distributions" / "servotune"
    _run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder), cwd=project)
    (wheel,) = folder.glob("*.whl")
    return wheel


def _installed(folder: Path, name: str, wheel: Path) -> float:
    """Install the wheel into a new environment, with a cache of this benchmark's own; return the milliseconds of both."""
    begin = time.perf_counter()
    _run(sys.executable, "-m", "venv", "--without-pip", str(folder / name))
    python = str(folder / name / "bin" / "python")
    cache = str(folder / "cache")
    _run(sys.executable, "-m", "pip", "--python", python, "install", "-q", "--cache-dir", cache, str(wheel))
    return 1e3 * (time.perf_counter() - begin)


def _cpu(work: Callable[[], object]) -> float:
    """Return the median milliseconds of processor time of a process that is waited for."""
    found = []
    for _ in range(RUNS + 1):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        work()
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        found.append(1e3 * (after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime))
    return statistics.median(found[1:])


def _run(*command: str, cwd: Path | None = None) -> None:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    subprocess.run(command, check=True, cwd=cwd, env=environment, stdout=subprocess.DEVNULL)  # noqa: S603 - our own


if __name__ == "__main__":
    from rich.console import Console

    from bench.table import render

    Console(width=None if sys.stdout.isatty() else 120).print(render(jobs(), title="The client by itself"))
