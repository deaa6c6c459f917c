"""`make bench-coverage`: what a candidate costs for every metric under every command, and with every law, found by discovery.

A position loop with a PID controller, without and with a delay, three gains varied, batches of a thousand; beside it python-control builds
the loop, a delay as Padé's quotient, and simulates 1,500 samples. A cell is CPU microseconds a candidate, what falls back to the exact path included; `!` marks one that a fast
evaluator leaves to it, `.` a metric that does not exist there. The first number of a cell is without a duration, the second within one.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np
import numpy.typing as npt

from engine import metrics, signals
from engine.analysis.measuring import MetricRequest, measure
from engine.batch.screening import Screening
from engine.diagram.diagram import Block, Connection, Diagram, System, compile_system
from engine.metrics._base import LoopMetric, PathMetric, TimeMetric
from engine.model.errors import EngineError
from engine.model.masks import Corners, Envelope, FrequencyBounds, Polyline
from engine.model.metric_options import Options

Real = npt.NDArray[np.float64]

GAINS: Mapping[str, tuple[float, float]] = {"pid.kp": (6.0, 12.0), "pid.ki": (1.0, 3.0), "pid.kd": (0.3, 0.6)}
FILTER = 100.0
DURATION = 3.0
DELAY = 0.005
PADE = 4
SAMPLES = 1500
MANY, FEW, EXACTLY = 1000, 8, 2
SLOW = 1e-3
"""A candidate that takes so many seconds is timed in a small batch."""

_INSTANTS = (0.0, 0.5, 1.0, DURATION)
_MASKS: Mapping[str, Any] = {
    "envelope": Envelope(upper=Polyline(times=_INSTANTS, values=(1.0, 1.5, 1.3, 1.1))),
    "reference": Polyline(times=_INSTANTS, values=(0.0, 0.9, 1.0, 1.0)),
    "frequency bounds": FrequencyBounds(upper=Corners(frequencies=(0.1, 10.0, 100.0), magnitudes=(2.0, 2.0, 1.0))),
}
_OPTIONS = Options(derivative=1, recovery_band=0.05, noise_density=1e-3)


@dataclass(frozen=True, kw_only=True)
class Cell:
    """CPU seconds a candidate, whether a fast evaluator answered all of it, and whether the metric exists there."""

    metric: str
    command: str
    duration: float | None
    seconds: float
    fast: bool
    exists: bool

    @property
    def text(self) -> str:
        """How the table shows it."""
        if not self.exists:
            return "."
        return f"{1e6 * self.seconds:,.0f}{'' if self.fast else '!'}"


def diagram(delay: float = 0.0) -> Diagram:
    """Return the loop, with a delay (s) behind the controller if there is one."""
    wires = [("reference", "error.in1"), ("motor", "error.in2"), ("error", "pid")]
    wires += [("pid", "line"), ("line", "motor")] if delay else [("pid", "motor")]
    values = {"kp": 8.0, "ki": 2.0, "kd": 0.4, "filter_frequency": FILTER}
    motor = {"numerator": [4.0], "denominator": [0.1, 1.0, 0.0]}
    return compile_system(
        System(
            name="axis",
            parameters={},
            blocks={
                "reference": Block(kind="input", values={}),
                "error": Block(kind="sum", values={"signs": "+-"}),
                "pid": Block(kind="pid", values=values),
                "motor": Block(kind="transfer_function", values=motor),
            }
            | ({"line": Block(kind="delay", values={"time": delay})} if delay else {}),
            connections=tuple(Connection(source=source, target=target) for source, target in wires),
            outputs={"position": "motor"},
        )
    )


def requests() -> Iterator[tuple[str, MetricRequest]]:
    """Yield every metric under every command, without and with a duration, each with the name of its command."""
    for kind, metric in metrics.catalogue().items():
        mask = _MASKS.get(metric.mask)
        if issubclass(metric, TimeMetric):
            for name, signal in signals.catalogue().items():
                made = {"reference": signals.make(name, dict(signal.example))}
                for duration in (None, DURATION):
                    yield (
                        name,
                        MetricRequest(
                            metric=kind,
                            signals=made,
                            output="position",
                            duration=duration,
                            band=(0.0, 10.0),
                            mask=mask,
                            options=_OPTIONS,
                        ),
                    )
        elif issubclass(metric, LoopMetric):
            yield "-", MetricRequest(metric=kind, open_at="error", mask=mask)
        elif issubclass(metric, PathMetric):
            yield "-", MetricRequest(metric=kind, source="reference", target="position", mask=mask, options=_OPTIONS)
        else:
            yield "-", MetricRequest(metric=kind)


def candidates(count: int) -> dict[str, Real]:
    """Return stable candidates."""
    random = np.random.default_rng(1)
    return {name: random.uniform(*bounds, count) for name, bounds in GAINS.items()}


def cell(system: Diagram, command: str, request: MetricRequest) -> Cell:
    """Measure one cell."""
    screening = Screening(system, [request], threads=1)
    exists = bool(np.isfinite(screening(candidates(FEW)).values).any()) or _exists(system, request)
    seconds, unknown = timed(system, screening, [request], candidates(FEW)) if exists else (0.0, 0)
    if exists and seconds < SLOW:
        seconds, unknown = timed(system, screening, [request], candidates(MANY))
    return Cell(
        metric=request.metric,
        command=command,
        duration=request.duration,
        seconds=seconds,
        fast=not unknown,
        exists=exists,
    )


def timed(
    system: Diagram, screening: Screening, requests: list[MetricRequest], points: dict[str, Real]
) -> tuple[float, int]:
    """Return seconds a candidate, and how many of them went to the exact path."""
    count = len(next(iter(points.values())))
    begin = time.process_time()
    found = screening(points)
    seconds = time.process_time() - begin
    unknown = np.flatnonzero((found.doubtful & np.isnan(found.values)).any(axis=1) & ~(found.growth >= 0))
    times = []
    for k in unknown[:EXACTLY]:
        begin = time.process_time()
        measure(system, requests, overrides={name: float(column[k]) for name, column in points.items()})
        times.append(time.process_time() - begin)
    return (seconds + len(unknown) * (median(times) if times else 0.0)) / count, len(unknown)


def _exists(system: Diagram, request: MetricRequest) -> bool:
    try:
        ((measured, _),) = measure(system, [request])
    except EngineError:
        return False
    return measured.value is not None


def python_control(delay: float = 0.0) -> float:
    """Return the CPU seconds that python-control takes for a candidate: build the loop with a delay (s), simulate a step."""
    import control  # noqa: PLC0415 - a peer of the bench only

    instants = np.linspace(0.0, DURATION, SAMPLES)
    command = np.ones(SAMPLES)
    motor = control.tf([4.0], [0.1, 1.0, 0.0]) * (control.tf(*control.pade(delay, PADE)) if delay else 1)
    times = []
    points = candidates(20)
    for kp, ki, kd in zip(*points.values(), strict=True):
        begin = time.process_time()
        pid = control.tf([kp + kd * FILTER, kp * FILTER + ki, ki * FILTER], [1.0, FILTER, 0.0])
        control.forced_response(control.feedback(pid * motor, 1), instants, command)
        times.append(time.process_time() - begin)
    return median(times)


def main() -> None:
    """Measure, and print a table for each loop, and one of the elements."""
    from bench import coverage_laws  # noqa: PLC0415 - it uses this one

    for delay in (0.0, DELAY):
        _show(f"{1e3 * delay:g} ms of delay" if delay else "no delay", diagram(delay), python_control(delay))
    coverage_laws.main()


def _show(title: str, system: Diagram, peer: float) -> None:
    from rich.console import Console  # noqa: PLC0415 - only where a table is printed
    from rich.table import Table  # noqa: PLC0415

    cells = [cell(system, command, request) for command, request in requests()]
    commands = sorted({one.command for one in cells})
    table = Table(title=f"{title}, CPU microseconds a candidate: automatic / 3 s; ! exact path, . no such value")
    table.add_column("metric", no_wrap=True)
    for name in commands:
        table.add_column(name, justify="right", overflow="fold")
    for metric in dict.fromkeys(one.metric for one in cells):
        row = [[one.text for one in cells if (one.metric, one.command) == (metric, name)] for name in commands]
        table.add_row(metric, *(" / ".join(texts) for texts in row))
    console = Console()
    Console(width=max(console.width, 230)).print(table)
    console.print(summary(cells, peer))


def summary(cells: list[Cell], peer: float) -> str:
    """Say what the table comes to: python-control, the median of steps, and the cells beyond the bars."""
    there = [one for one in cells if one.exists]
    step = median(one.seconds for one in there if one.command == "step" and one.duration is None and one.fast)
    slow = [one for one in there if one.seconds > 10 * step]
    behind = [one for one in there if peer < 200 * one.seconds]
    left = [one for one in there if not one.fast]
    lines = [
        f"python-control: {1e6 * peer:,.0f} us; median of the fast step cells: {1e6 * step:.0f} us; {len(there)} cells with a value",
        f"slower than 10 times that median: {len(slow)}; less than 200 times as fast as python-control: {len(behind)}; left to the exact path: {len(left)}",
    ]
    worst = sorted(there, key=lambda one: -one.seconds)[:8]
    lines += [
        f"  {one.metric} / {one.command} / {one.duration or 'automatic'}: {1e6 * one.seconds:,.0f} us, python-control / this {peer / one.seconds:.1f}"
        for one in worst
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
