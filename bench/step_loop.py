"""One loop, the same metrics: this engine beside python-control.

The loop is a PID (100, 20, 5; filter 100 rad/s) round the seed paper's mid-range pneumatic motor, 1000 points on 0 to 15 s.
python-control is used in its documented way: `step_response`, `step_info`, `stability_margins`, `bandwidth`; its elasticities are
central differences with 1 % steps. Times are process CPU milliseconds (the median of several runs), because the
machine may be shared; errors are relative to 40-digit values.
"""

from __future__ import annotations

import statistics
import time
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from engine.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.linear.screening import Screening
from engine.signals import make
from engine.study import MetricRequest, frequency_response, measure, simulate

GAINS = {"kp": 100.0, "ki": 20.0, "kd": 5.0}
FILTER = 100.0
SETS = 1000
PER_SI = 1e-4  # 1 cm3/s per cm in m3/s per m

Gains = Mapping[str, np.ndarray]

EXACT = {
    "rise_time": 1.12926550584625,
    "settling_time": 10.2149965109608,
    "overshoot": 0.0873231787804261,
    "peak_time": 3.0654123189545,
    "gain_margin": 2.93536534998578,
    "phase_margin": 1.47325789684602,
    "bandwidth": 1.70918875182118,
}
EXACT_RISE_ELASTICITY = (-0.2383634865477, -0.0985015700989508, 0.0120495301082388)


def process_ms(work: Callable[[], Any], *, runs: int) -> float:
    """Return the median CPU milliseconds of one call, after one call that warms up."""
    work()
    times = []
    for _ in range(runs):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return 1e3 * statistics.median(times)


def pneumatic_loop() -> Diagram:
    """Return the loop as a diagram with the three gains as parameters."""
    motor = {
        "area": 65e-4,
        "volume": 750e-6,
        "pressure": 5e5,
        "adiabatic_index": 1.4,
        "leakage": 0.4e-11,
        "mass": 300.0,
        "viscous_friction": 1200.0,
    }
    gains = {"kp": "=kp", "ki": "=ki", "kd": "=kd", "filter_frequency": FILTER}
    wires = [
        ("reference", "error.in1"),
        ("motor.position", "error.in2"),
        ("error", "controller"),
        ("controller", "motor.flow"),
    ]
    return compile_system(
        System(
            name="pneumatic position loop",
            parameters={name: Parameter(value=value * PER_SI) for name, value in GAINS.items()},
            blocks={
                "reference": Block(kind="input", values={}),
                "error": Block(kind="sum", values={"signs": "+-"}),
                "controller": Block(kind="pid", values=gains),
                "motor": Block(kind="linear_pneumatic_motor", values=motor),
            },
            connections=tuple(Connection(source=source, target=target) for source, target in wires),
            outputs={"position": "motor.position"},
        )
    )


class Ours:
    """The exact path of this engine: what every number that a user is shown comes from."""

    name = "this engine"

    def __init__(self) -> None:
        self.diagram = pneumatic_loop()
        self.step = {"reference": make("step", {})}
        self.screening = Screening(self.diagram, [self.request(name) for name in EXACT])

    def metrics(self, gains: Mapping[str, float] = GAINS) -> dict[str, float]:
        """Simulate, measure and take the margins of one set of gains."""
        overrides = {name: value * PER_SI for name, value in gains.items()}
        step = simulate(
            self.diagram,
            signals=self.step,
            overrides=overrides,
            duration=15.0,
            samples=1000,
            metrics=["rise_time", "settling_time", "overshoot", "peak_time"],
        )
        study = frequency_response(
            self.diagram,
            overrides=overrides,
            open_at="error",
            source="reference",
            target="position",
            metrics=["gain_margin", "phase_margin", "bandwidth"],
        )
        found = {**step.metrics["position"], **study.metrics}
        return {name: float(found[name].value) for name in EXACT}

    def elasticities(self) -> dict[str, list[float]]:
        """Return d ln metric/d ln gain of every metric, exactly."""
        requests = [self.request(name) for name in EXACT]
        out = {}
        for name, (measured, gradient) in zip(
            EXACT, measure(self.diagram, requests, gradient=list(GAINS)), strict=True
        ):
            assert measured.value is not None
            assert gradient is not None
            at = [self.diagram.parameters[gain].value for gain in GAINS]
            out[name] = [float(g) * p / measured.value for g, p in zip(gradient.values, at, strict=True)]
        return out

    def screen(self, gains: Gains) -> dict[str, np.ndarray]:
        """Measure many sets of gains at once, as an optimiser does: metric -> (sets,)."""
        found = self.screening({name: column * PER_SI for name, column in gains.items()})
        return dict(zip(EXACT, found.values.T, strict=True))

    def request(self, metric: str) -> MetricRequest:
        """Say where one of the metrics is measured."""
        loop, path = metric.endswith("margin"), metric == "bandwidth"
        return MetricRequest(
            metric=metric,
            signals={} if loop or path else self.step,
            output=None if loop or path else "position",
            open_at="error" if loop else None,
            source="reference" if path else None,
            target="position" if path else None,
        )


class PythonControl:
    """python-control in the way that its documentation shows."""

    def __init__(self) -> None:
        import control  # noqa: PLC0415  costs seconds; only this class needs it

        self.control = control
        self.name = f"python-control {control.__version__}"
        compliance = 750.0 / (1.4 * 5.0)
        bracket = [compliance * 0.3, compliance * 1.2 + 0.3 * 0.4, 65.0**2 + 0.4 * 1.2, 0.0]
        self.motor = control.tf([65.0], bracket)
        self.time = np.linspace(0.0, 15.0, 1000)

    def metrics(self, gains: Mapping[str, float] = GAINS) -> dict[str, float]:
        """Simulate, measure and take the margins of one set of gains."""
        control, kp, ki, kd = self.control, gains["kp"], gains["ki"], gains["kd"]
        pid = control.tf([kp + kd * FILTER, kp * FILTER + ki, ki * FILTER], [1.0, FILTER, 0.0])
        loop = pid * self.motor
        closed = control.feedback(loop, 1)
        control.step_response(closed, self.time)
        info = control.step_info(closed, T=self.time)
        gain_margin, phase_margin, *_ = control.stability_margins(loop)
        return {
            "rise_time": info["RiseTime"],
            "settling_time": info["SettlingTime"],
            "overshoot": info["Overshoot"] / 100,
            "peak_time": info["PeakTime"],
            "gain_margin": gain_margin,
            "phase_margin": np.radians(phase_margin),
            "bandwidth": control.bandwidth(closed),
        }

    def elasticities(self, change: float = 0.01) -> dict[str, list[float]]:
        """Return central differences: two evaluations for each gain and one more for the base."""
        base = self.metrics()
        out: dict[str, list[float]] = {name: [] for name in EXACT}
        for gain, value in GAINS.items():
            up, down = (self.metrics({**GAINS, gain: value * (1 + sign * change)}) for sign in (1, -1))
            for name, row in out.items():
                row.append((up[name] - down[name]) / (2 * change * base[name]))
        return out


def main() -> None:
    """Measure, compare and print."""
    warnings.simplefilter("ignore")
    console = Console()
    ours, peer = Ours(), PythonControl()

    accuracy = Table("metric", "exact", f"error, {ours.name}", f"error, {peer.name}", title="Accuracy")
    mine, theirs = ours.metrics(), peer.metrics()
    for name, exact in EXACT.items():
        errors = (abs(values[name] / exact - 1) for values in (mine, theirs))
        accuracy.add_row(name, f"{exact:.10f}", *(f"{error:.1e}" for error in errors))
    for row, exact in enumerate(EXACT_RISE_ELASTICITY):
        found = (ours.elasticities()["rise_time"][row], peer.elasticities()["rise_time"][row])
        label = f"elasticity of rise_time in {list(GAINS)[row]}"
        accuracy.add_row(label, f"{exact:.10f}", *(f"{abs(value / exact - 1):.1e}" for value in found))
    console.print(accuracy)

    speed = Table("job", f"{ours.name}, ms CPU", f"{peer.name}, ms CPU", "ratio", title="Speed")
    for job, work, other, runs in (
        ("response, 7 metrics, margins", ours.metrics, peer.metrics, 15),
        ("elasticities of 7 metrics in 3 gains", ours.elasticities, peer.elasticities, 5),
    ):
        a, b = process_ms(work, runs=runs), process_ms(other, runs=runs)
        speed.add_row(job, f"{a:.2f}", f"{b:.2f}", f"{b / a:.1f}x")
    rng = np.random.default_rng(0)
    sets = {name: value * rng.uniform(0.8, 1.2, SETS) for name, value in GAINS.items()}
    a, b = process_ms(lambda: ours.screen(sets), runs=3), SETS * process_ms(peer.metrics, runs=15)
    speed.add_row(
        f"7 metrics of {SETS} sets of gains (screening; peer: one by one)", f"{a:.0f}", f"{b:.0f}", f"{b / a:.0f}x"
    )
    console.print(speed)

    screened = ours.screen(sets)
    worst = 0.0
    for index in range(0, SETS, SETS // 20):
        exact_values = ours.metrics({name: float(column[index]) for name, column in sets.items()})
        worst = max(worst, *(abs(screened[name][index] / value - 1) for name, value in exact_values.items()))
    console.print(f"Screening against the exact path, worst relative difference of 20 sets: {worst:.1e}")


if __name__ == "__main__":
    main()
