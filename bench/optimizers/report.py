"""The stored benchmark of the optimisers: one JSON file, and the page that is made from it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from bench.optimizers.outcome import Outcome

HERE = Path(__file__).parents[2] / "docs" / "benchmarks"
STORED = HERE / "optimizers.json"
PAGE = HERE / "optimizers.md"


@dataclass(frozen=True, kw_only=True)
class Contender:
    """One way to solve the servo job: settling times reached from several seeds or starts, and what that cost.

    ``settling_time`` is the best, ``within`` counts the seeds that end within 1 % of the best known one; times are the median
    of a run.
    """

    name: str
    runs: int
    within: int | None
    settling_time: float
    slowest: float | None
    evaluations: int
    seconds: float
    cpu_seconds: float


@dataclass(frozen=True, kw_only=True)
class Benchmark:
    """Everything that was measured, and where."""

    machine: str
    outcomes: tuple[Outcome, ...]
    servo: tuple[Contender, ...]

    def store(self, path: Path = STORED) -> None:
        """Write the JSON file."""
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(asdict(self), indent=1, ensure_ascii=False) + "\n")

    @staticmethod
    def stored(path: Path = STORED) -> Benchmark:
        """Read the JSON file."""
        document = json.loads(path.read_text())
        return Benchmark(
            machine=document["machine"],
            outcomes=tuple(Outcome(**entry) for entry in document["outcomes"]),
            servo=tuple(Contender(**entry) for entry in document["servo"]),
        )

    def page(self) -> str:
        """Return the page."""
        lines = [
            "# Optimisers against published optima",
            "",
            "Made from [optimizers.json](optimizers.json), which `make bench-optimizers` writes, this page with it.",
            f"Measured on {self.machine}.",
            "",
            "## Published optima",
            "",
            "What was reached is the exact value at the optimum, every goal re-evaluated on the continuous response and the",
            "continuous frequency axis; the violation is the largest relative one in that certificate. A gap is how far the method",
            "stays behind what is published, relative; a negative one is better than published.",
            "",
            "| case | method | published | reached | gap | allowed | violation | evaluations | CPU s | |",
            "|---|---|--:|--:|--:|--:|--:|--:|--:|---|",
        ]
        lines += [
            f"| {one.case} | {one.method} | {one.published:.7g} | {one.reached:.7g} | {one.gap:+.1e} | {one.tolerance:.0e} | "
            f"{one.violation:.0e} | {one.evaluations:,} | {one.cpu_seconds:.1f} | {'met' if one.met else '**not met**'} |"
            for one in self.outcomes
        ]
        lines += ["", "Sources:", ""]
        sources = {one.case: one.source for one in self.outcomes}
        lines += [f"- {case}: {source}." for case, source in sources.items()]
        ours, *others = self.servo
        lines += [
            "",
            "## The servo job beside its peer",
            "",
            "Least settling time of a position loop with an inner velocity loop (8 states, 5 variables) under 1 % overshoot,",
            "|S| ≤ 1.6 and a largest acceleration of 1500; the best that is known is 0.0757 s. Ours is run from several seeds, the",
            "peer, which searches locally, from several starts in one run; CPU time, because the machine may be shared.",
            "",
            "| | runs | within 1 % of 0.0757 s | best, s | worst run, s | evaluations | wall s | CPU s | CPU over ours |",
            "|---|--:|--:|--:|--:|--:|--:|--:|--:|",
        ]
        lines += [
            f"| {one.name} | {one.runs} | {'-' if one.within is None else one.within} | {one.settling_time:.5f} | "
            f"{'-' if one.slowest is None else f'{one.slowest:.5f}'} | {one.evaluations:,} | {one.seconds:.2f} | "
            f"{one.cpu_seconds:.2f} | {one.cpu_seconds / ours.cpu_seconds:.0f}x |"
            for one in (ours, *others)
        ]
        return "\n".join(lines) + "\n"
