"""`make bench-optimizers`: every published optimum, by every method that covers it, and the servo job beside a peer."""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import warnings
from collections.abc import Iterator
from importlib.metadata import version

from rich.console import Console
from rich.markdown import Markdown

from bench.__main__ import processor
from bench.optimizers import cases_convex, cases_integrals, cases_servo
from bench.optimizers.cases_convex import Case
from bench.optimizers.outcome import Outcome, solve
from bench.optimizers.peer import slsqp
from bench.optimizers.report import PAGE, Benchmark, Contender

SEEDS = 10
STARTS = 4
"""Of the peer: a local search needs several."""


def jobs() -> Iterator[tuple[Case, str]]:
    """Yield every case with every method that covers it."""
    convex = cases_convex.cases()
    for case in (cases_servo.settling(), cases_servo.tracking(), *convex[1:], *cases_integrals.cases()):
        yield case, "gradient"
    for case in (cases_servo.settling(), cases_integrals.parabola()):
        yield case, "global"
    for case in convex:
        yield case, "convex"


def contenders(console: Console, *, seeds: int, starts: int) -> Iterator[Contender]:
    """Yield the servo job by the methods of this engine, then by the peer."""
    case = cases_servo.settling()
    for method, options, count in (("gradient", {"starts": 4}, seeds), ("global", {}, max(1, seeds // 3))):
        runs = [solve(case, method, {"seed": seed, **options}) for seed in range(count)]
        limit = case.published * (1 + case.tolerance)
        yield Contender(
            name=f"this engine, {method}",
            runs=count,
            within=sum(run.reached <= limit and run.met for run in runs),
            settling_time=min(run.reached for run in runs),
            slowest=max(run.reached for run in runs),
            evaluations=round(statistics.median(run.evaluations for run in runs)),
            seconds=statistics.median(run.seconds for run in runs),
            cpu_seconds=statistics.median(run.cpu_seconds for run in runs),
        )
    try:
        peer = slsqp(starts=starts)
    except ModuleNotFoundError:
        console.print("python-control is not installed: no peer")
        return
    yield Contender(
        name=f"{peer.name}, {starts} starts", runs=1, within=None, settling_time=peer.settling_time, slowest=None,
        evaluations=peer.evaluations, seconds=peer.seconds, cpu_seconds=peer.cpu_seconds,
    )  # fmt: skip


def main() -> None:
    """Measure, store, write the page and print it."""
    parser = argparse.ArgumentParser(prog="make bench-optimizers", description=__doc__)
    parser.add_argument("--page", action="store_true", help="only write the page again, from what is stored")
    options = parser.parse_args()
    console = Console()
    if not options.page:
        warnings.simplefilter("ignore")  # the peer's own
        outcomes: list[Outcome] = []
        with console.status("measuring ...") as status:
            servo = tuple(contenders(console, seeds=SEEDS, starts=STARTS))
            for case, method in jobs():
                status.update(f"{method}: {case.name}")
                outcomes.append(solve(case, method, {"seed": 1}))
        machine = (
            f"{os.cpu_count()} cores of {processor()}, Python {platform.python_version()}, scipy {version('scipy')}"
        )
        Benchmark(machine=machine, outcomes=tuple(outcomes), servo=servo).store()
    benchmark = Benchmark.stored()
    PAGE.write_text(benchmark.page())
    Console(width=max(console.width, 150)).print(Markdown(benchmark.page()))
    if not all(one.met for one in benchmark.outcomes):
        raise SystemExit("not every published optimum was reached")


if __name__ == "__main__":
    main()
