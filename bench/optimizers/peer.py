"""The peer: scipy's SLSQP over python-control, with the differences that served it best, from several starts."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize
from scipy.stats import qmc

from bench.optimizers.cases_servo import ACCELERATION, BOX, OVERSHOOT, SENSITIVITY

Vector = npt.NDArray[np.float64]

_TIME = np.linspace(0.0, 1.0, 1001)
_FREQUENCIES = np.logspace(-1, 4, 200)
_LONGEST = 2.0


@dataclass(frozen=True, kw_only=True)
class Peer:
    """What the peer found: the point, the evaluations, wall and CPU seconds of all starts together."""

    name: str
    best: Mapping[str, float]
    settling_time: float
    evaluations: int
    seconds: float
    cpu_seconds: float


def slsqp(*, starts: int, step: float = 1e-2) -> Peer:
    """Solve the servo job from Latin hypercube starts, with differences of ``step`` in the logarithms.

    Raises
    ------
    ModuleNotFoundError
        Without python-control.
    """
    import control  # noqa: PLC0415  a peer that is not installed is a remark in the table, not an error

    evaluations = 0
    known: dict[bytes, Vector] = {}

    def metrics(x: Vector) -> Vector:
        """Return settling time, overshoot, ln |S| and ln of the acceleration."""
        nonlocal evaluations
        key = x.tobytes()
        if key not in known:
            evaluations += 1
            known.clear()
            known[key] = _metrics(control, np.exp(x))
        return known[key]

    lower, upper = (np.log([bounds[end] for bounds in BOX.values()]) for end in (0, 1))
    limits = np.array([OVERSHOOT, np.log(SENSITIVITY), np.log(ACCELERATION)])
    scales = np.array([0.1, 1.0, 1.0])
    begin, cpu = time.perf_counter(), time.process_time()
    best: tuple[float, Vector] = (np.inf, lower)
    for start in lower + (upper - lower) * qmc.LatinHypercube(len(BOX), rng=3).random(starts):
        found = minimize(
            lambda x: float(metrics(x)[0]), start, method="SLSQP", bounds=list(zip(lower, upper, strict=True)),
            constraints={"type": "ineq", "fun": lambda x: (limits - metrics(x)[1:]) / scales},
            options={"maxiter": 100, "eps": step, "ftol": 1e-6},
        )  # fmt: skip
        values = metrics(np.asarray(found.x))
        if (values[1:] <= limits + 1e-3 * np.abs(limits)).all() and values[0] < best[0]:
            best = float(values[0]), np.asarray(found.x)
    return Peer(
        name=f"scipy {version('scipy')} SLSQP over python-control {version('control')}",
        best=dict(zip(BOX, np.exp(best[1]).tolist(), strict=True)),
        settling_time=best[0],
        evaluations=evaluations,
        seconds=time.perf_counter() - begin,
        cpu_seconds=time.process_time() - cpu,
    )


def _metrics(control: Any, values: Vector) -> Vector:
    """Return settling time, overshoot, ln |S| and ln of the acceleration of one candidate, by transfer functions."""
    kp, td1, td2, tf, kv = (float(value) for value in values)
    law = control.tf([kp * td2, kp * td1, kp], [tf**2, 2 * tf, 1.0])
    valve = control.tf([9e4], [1.0, 420.0, 9e4])
    velocity = control.tf([1600.0], [1.0, 16.0, 1600.0])
    forward = law * control.feedback(valve * velocity, control.tf([kv], [1.0])) * control.tf([1.0], [1.0, 0.0])
    sensor = control.tf([1.0], [0.002, 1.0])
    closed = control.feedback(forward, sensor)
    _, y = control.step_response(closed, T=_TIME)
    _, acceleration = control.step_response(closed * control.tf([1.0, 0.0, 0.0], [1.0]), T=_TIME)
    info = control.step_info(y, T=_TIME, yfinal=float(control.dcgain(closed)))
    sensitivity = np.abs(1 / (1 + (forward * sensor)(1j * _FREQUENCIES))).max()
    settling = info["SettlingTime"]
    return np.array(
        [
            min(settling, _LONGEST) if np.isfinite(settling) else _LONGEST,
            min(info["Overshoot"] / 100, 10.0),
            np.log(min(sensitivity, 1e3)),
            np.log(min(np.abs(acceleration).max(), 1e9)),
        ]
    )
