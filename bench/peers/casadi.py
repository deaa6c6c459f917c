"""casadi at the pneumatic loop: the state equations as symbols, integrated by CVODES or by a Runge-Kutta map of our own."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import numpy as np
import numpy.typing as npt

from bench.pneumatic_loop import DURATION, FILTER, GAINS, MOTOR_DENOMINATOR, MOTOR_NUMERATOR, SAMPLES, Gains, Sets
from bench.sampled import step_metrics

Real = npt.NDArray[np.float64]

STATES = 5
LEVELS = (0.1, 0.9)


class Casadi:
    """Curves of the loop, differentiable in the gains; metrics read off the samples."""

    remark = "curve and 4 step metrics; equations by hand, no margins"
    derivation = "of the rise time alone: slopes of the curve, moved to the crossings by hand"

    def __init__(self, integrator: str) -> None:
        import casadi  # noqa: PLC0415  a peer that is not installed is a row of the table, not an error

        self._casadi = casadi
        self.name = f"casadi {version('casadi')}, {integrator}"
        self._time = np.linspace(0.0, DURATION, SAMPLES)
        self._curve = self._cvodes() if integrator == "CVODES" else self._runge_kutta()
        gains = casadi.MX.sym("gains", 3)
        self._slope = casadi.Function("slope", [gains], [casadi.jacobian(self._curve(gains), gains)])
        self._map = self._curve.map(1)

    def metrics(self, gains: Gains) -> dict[str, float]:
        """Simulate and read the metrics off the samples."""
        return step_metrics(self._time, self._simulate(gains))

    def many(self, sets: Sets) -> dict[str, Real]:
        """Simulate all sets in one call of the mapped function, and read the metrics off."""
        count = len(sets["kp"])
        if self._map.size2_in(0) != count:
            self._map = self._curve.map(count)
        curves = np.asarray(self._map(np.stack([sets[gain] for gain in GAINS]))).reshape(count, SAMPLES)
        each = [step_metrics(self._time, curve) for curve in curves]
        return {name: np.array([found[name] for found in each]) for name in each[0]}

    def rise_elasticities(self) -> list[float]:
        """Return the slopes of the curve moved to the crossings: dt/dp = -(dy/dp)/(dy/dt)."""
        curve = self._simulate(GAINS)
        slope = np.asarray(self._slope(list(GAINS.values())))
        rate = np.gradient(curve, self._time)
        moved, times = [], []
        for level in LEVELS:
            first = int(np.argmax(curve >= level)) - 1
            share = (level - curve[first]) / (curve[first + 1] - curve[first])
            at = [
                column[first] + share * (column[first + 1] - column[first]) for column in (*slope.T, rate, self._time)
            ]
            moved.append([-value / at[3] for value in at[:3]])
            times.append(at[4])
        rise = times[1] - times[0]
        return [float((late - early) * gain / rise) for early, late, gain in zip(*moved, GAINS.values(), strict=True)]

    def _simulate(self, gains: Gains) -> Real:
        return np.asarray(self._curve(list(gains.values()))).ravel()

    def _equations(self) -> tuple[Any, Any, Any, Any]:
        """Return the states, the gains, their rates, and the output; the reference is 1."""
        symbol = self._casadi.MX.sym
        x, gains = symbol("x", STATES), symbol("gains", 3)
        lead, damping, spring, _ = MOTOR_DENOMINATOR
        position = MOTOR_NUMERATOR[0] / lead * x[0]
        error = 1.0 - position
        filtered = FILTER * (error - x[4])
        command = gains[0] * error + gains[1] * x[3] + gains[2] * filtered
        jerk = command - damping / lead * x[2] - spring / lead * x[1]
        return x, gains, self._casadi.vertcat(x[1], x[2], jerk, error, filtered), position

    def _cvodes(self) -> Any:
        x, gains, rates, position = self._equations()
        system = {"x": x, "p": gains, "ode": rates}
        solve = self._casadi.integrator("solve", "cvodes", system, 0.0, self._time)
        free = self._casadi.MX.sym("gains", 3)
        read = self._casadi.Function("read", [x], [position]).map(SAMPLES)
        return self._casadi.Function("curve", [free], [read(solve(x0=0, p=free)["xf"])])

    def _runge_kutta(self) -> Any:
        casadi = self._casadi
        x, gains, rates, position = self._equations()
        rate = casadi.Function("rate", [x, gains], [rates])
        step = DURATION / (SAMPLES - 1)
        k1 = rate(x, gains)
        k2 = rate(x + step / 2 * k1, gains)
        k3 = rate(x + step / 2 * k2, gains)
        k4 = rate(x + step * k3, gains)
        advance = casadi.Function("advance", [x, gains], [x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
        walk = advance.mapaccum(SAMPLES - 1)
        free = casadi.MX.sym("gains", 3)
        states = casadi.horzcat(
            casadi.DM.zeros(STATES), walk(casadi.DM.zeros(STATES), casadi.repmat(free, 1, SAMPLES - 1))
        )
        read = casadi.Function("read", [x], [position]).map(SAMPLES)
        return casadi.Function("curve", [free], [read(states)])
