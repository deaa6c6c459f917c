"""python-control at both loops, in the way that its documentation shows."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

import numpy as np

from bench import inner_velocity_loop as inner
from bench.pneumatic_loop import DURATION, FILTER, GAINS, MOTOR_DENOMINATOR, MOTOR_NUMERATOR, SAMPLES, Gains


class PythonControl:
    """Transfer functions: `step_response`, `step_info`, `stability_margins`, `bandwidth`; elasticities by differences."""

    remark = "curve, 7 metrics, margins; metrics from its grid"
    derivation = "of all 7 metrics, central differences with 1 % steps"

    def __init__(self) -> None:
        import control  # noqa: PLC0415  a peer that is not installed is a row of the table, not an error

        self._control = control
        self.name = f"python-control {version('control')}"
        self._motor = control.tf(MOTOR_NUMERATOR, MOTOR_DENOMINATOR)
        self._time = np.linspace(0.0, DURATION, SAMPLES)

    def metrics(self, gains: Gains) -> dict[str, float]:
        """Simulate, measure and take the margins of one set of gains."""
        control, kp, ki, kd = self._control, gains["kp"], gains["ki"], gains["kd"]
        pid = control.tf([kp + kd * FILTER, kp * FILTER + ki, ki * FILTER], [1.0, FILTER, 0.0])
        loop = pid * self._motor
        closed = control.feedback(loop, 1)
        control.step_response(closed, self._time)
        info = control.step_info(closed, T=self._time)
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

    def rise_elasticities(self, change: float = 0.01) -> list[float]:
        """Return central differences: two evaluations of all metrics for each gain and one more for the base."""
        base = self.metrics(GAINS)["rise_time"]
        found = []
        for gain, value in GAINS.items():
            up, down = (self.metrics({**GAINS, gain: value * (1 + sign * change)}) for sign in (1, -1))
            found.append((up["rise_time"] - down["rise_time"]) / (2 * change * base))
        return found


class Interconnected:
    """The inner velocity loop by `interconnect`, once closed and once cut at the sensor."""

    remark = "metrics from its grid"

    def __init__(self) -> None:
        import control  # noqa: PLC0415  as above

        self._control = control
        self.name = f"python-control {version('control')}, interconnect"
        valve = control.tf([9e4], [1.0, 420.0, 9e4])
        self._valve = control.ss(valve, inputs="q", outputs="flow", name="valve")
        dynamics = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1600.0, -16.0]]
        self._plant = control.ss(
            dynamics, [[0.0], [0.0], [1600.0]], np.eye(3), np.zeros((3, 1)),
            inputs="flow", outputs=["z", "v", "a"], name="plant",
        )  # fmt: skip
        self._sensor = control.ss(control.tf([1.0], [0.002, 1.0]), inputs="z", outputs="zm", name="sensor")
        self._velocity_error = control.summing_junction(["u", "-uv"], "q")
        self._error = control.summing_junction(["r", "-zm"], "e")
        self._time = np.linspace(0.0, inner.DURATION, inner.SAMPLES)

    def metrics(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the metrics of one candidate."""
        control = self._control
        closed, loop = self._closed(values), self._open(values)
        response = control.step_response(closed, self._time)
        info = control.step_info(response.outputs[0, 0], T=self._time, yfinal=float(control.dcgain(closed)[0, 0]))
        gain_margin, phase_margin, distance, *_ = control.stability_margins(loop)
        return {
            "rise_time": info["RiseTime"],
            "settling_time": info["SettlingTime"],
            "overshoot": info["Overshoot"] / 100,
            "max_acceleration": float(np.abs(response.outputs[1, 0]).max()),
            "steady_state_error": 1.0 - float(control.dcgain(closed)[0, 0]),
            "gain_margin": gain_margin,
            "phase_margin": np.radians(phase_margin),
            "sensitivity_peak": 1 / distance,
            "bandwidth": control.bandwidth(closed[0, 0]),
            "stable": float(closed.poles().real.max() < 0),
        }

    def _controller(self, values: Mapping[str, float], source: str) -> Any:
        kp, td1, td2, tf = (values[name] for name in ("kp", "td1", "td2", "tf"))
        law = self._control.tf([kp * td2, kp * td1, kp], [tf**2, 2 * tf, 1.0])
        return self._control.ss(law, inputs=source, outputs="u", name="controller")

    def _closed(self, values: Mapping[str, float]) -> Any:
        blocks = [self._error, self._controller(values, "e"), *self._inside(values)]
        return self._control.interconnect(blocks, inputs=["r"], outputs=["z", "a"])

    def _open(self, values: Mapping[str, float]) -> Any:
        blocks = [self._controller(values, "r"), *self._inside(values)]
        return self._control.interconnect(blocks, inputs=["r"], outputs=["zm"])

    def _inside(self, values: Mapping[str, float]) -> list[Any]:
        feedback = self._control.ss([], [], [], [[values["kv"]]], inputs="v", outputs="uv", name="velocity_feedback")
        return [self._velocity_error, feedback, self._valve, self._plant, self._sensor]
