"""`make bench`: this engine beside its peers, in one run and one table."""

from __future__ import annotations

import argparse
import os
import platform
import warnings
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

from rich.console import Console

from bench import batch, cold_start, identification, imports, latency, loop, nonlinear_batch, throughput
from bench.table import Job, markdown, render

SIZES = {
    "runs": 15,
    "sets": 1000,
    "candidates": 4096,
    "most": 1_000_000,
    "simulations": 60,
    "megabytes": 51.2,
    "samples": 100_000_000,
}
SMALL = {"runs": 1, "sets": 4, "candidates": 4, "most": 1000, "simulations": 2, "megabytes": 1.0, "samples": 100_000}


def jobs(
    *, runs: int, sets: int, candidates: int, most: int, megabytes: float, samples: int, simulations: int
) -> Iterator[Job]:
    """Measure all jobs, one after the other.

    Parameters
    ----------
    simulations : int
        Of an identification, for each start.
    runs : int
        Repetitions of which the median counts.
    sets, candidates, most : int
        Sizes of the batches: sets of gains, candidates, and candidates on one and two threads.
    megabytes, samples : float, int
        Size of the file that is imported, and of the recording that is plotted.
    """
    yield from loop.jobs(runs=runs, sets=sets)
    yield from batch.jobs(runs=runs, candidates=candidates)
    yield throughput.job(most)
    yield from latency.jobs(runs=runs)
    yield from nonlinear_batch.jobs(runs=runs, candidates=sets)
    yield from imports.jobs(runs=max(3, runs // 3) if runs > 1 else 1, megabytes=megabytes, samples=samples)
    yield from identification.jobs(most=simulations)
    yield cold_start.job(runs=max(1, runs // 5))


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__)
    parser.add_argument("--small", action="store_true", help="the same jobs in seconds; the times say nothing")
    parser.add_argument(
        "--markdown", action="store_true", help="print the table as Markdown, as in docs/benchmarks/peers.md"
    )
    options = parser.parse_args()
    sizes = SMALL if options.small else SIZES
    warnings.simplefilter("ignore")  # the peers' own
    title = (
        f"Python {platform.python_version()}, numpy {version('numpy')}, scipy {version('scipy')}; {os.cpu_count()} cores of {processor()}. "
        "Ratio: time over that of the job's first row. Errors are relative."
    )
    console = Console(stderr=options.markdown)
    with console.status("measuring ...") as status:
        measured = []
        for job in jobs(**sizes):
            measured.append(job)
            status.update(f"measured: {job.title}")
    if options.markdown:
        print(markdown(measured, title=title))
    else:
        Console(width=max(console.width, 150)).print(render(measured, title=title))


def processor() -> str:
    """Return the name of the processor, where the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


if __name__ == "__main__":
    main()
