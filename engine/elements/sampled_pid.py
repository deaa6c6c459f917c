"""PID law of a digital controller: computed at regular instants from samples of the error, held in between.

u_k = kp e_k + I_k + D_k,   I_k = I_{k-1} + ki T e_k,   D_k = (D_{k-1} + w kd (e_k - e_{k-1}))/(1 + w T)
"""

from __future__ import annotations

from typing import Any

import numpy as np

from engine.elements import _pid
from engine.elements._base import Realization, Values
from engine.elements._nonlinear import Mode, Moment, Signals, first
from engine.elements._sampler import TIMING, Sampler
from engine.errors import DiagramError
from engine.parameters import Param


class SampledPid(Sampler):
    """Backward differences; with limits, the integral part waits while the output is at a limit (conditional integration).

    The output follows a sample after the time that it takes to compute.
    """

    kind = "sampled_pid"
    title = "Sampled PID controller"
    equation = "u_k = kp e_k + I_k + D_k;  I_k = I_{k-1} + ki T e_k;  D_k = (D_{k-1} + w kd (e_k - e_{k-1}))/(1 + w T)"
    source = "K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 3rd ed., chapter 8."
    note = (
        "as a continuous block (exports, describing functions) a sampled controller is its continuous law without delay"
    )
    states = ("output", "computed", "integral", "error", "derivative")
    parameters = (
        *_pid.PROPORTIONAL,
        Param(name="ki", symbol="K_i", default=0.0, doc="integral gain: output per second for an error of 1"),
        Param(name="kd", symbol="K_d", default=0.0, doc="derivative gain"),
        Param(
            name="filter_frequency", symbol="w", unit="rad/s", default=1e3, lower=0.0, lower_open=True, scale="log",
            doc="corner of the derivative's filter",
        ),
        *TIMING,
        Param(name="lower", symbol="u_min", required=False, doc="least output; absent: none"),
        Param(name="upper", symbol="u_max", required=False, doc="greatest output; absent: none"),
    )  # fmt: skip
    example = {"kp": 2.0, "ki": 5.0, "kd": 0.1, "filter_frequency": 200.0, "sample_time": 0.01, "delay": 0.002}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse a delay longer than the sample time, and limits in the wrong order."""
        super().check(given, values)
        lower, upper = values["lower"], values["upper"]
        if lower is not None and upper is not None and lower.real >= upper.real:
            raise DiagramError(f"upper must be > lower ({lower.real:g}), got {upper.real:g}", at=("upper",))

    @classmethod
    def unrest(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the states are from those of ever the same error."""
        output, computed, integral, error, derivative = m.x
        wanted = cls._limited(values["kp"] * m.z[0] + integral, values)[0]
        rest = values["ki"] * m.z[0] if np.any(values["ki"]) else integral
        return [wanted - output, wanted - computed, rest, m.z[0] - error, derivative]

    @classmethod
    def limits(cls, values: Values) -> list[tuple[Any, Any]]:
        """Return the limits."""
        lower, upper = values["lower"], values["upper"]
        return [(-np.inf if lower is None else lower, np.inf if upper is None else upper)]

    @classmethod
    def linear_part(cls, values: Values) -> Values:
        """Return the values without limits."""
        return {**values, "lower": None, "upper": None}

    @classmethod
    def _limited(cls, wanted: Any, values: Values) -> tuple[Any, int]:
        """Return the output within its limits, and which limit it is at: 1, -1 or 0."""
        for limit, side in ((values["upper"], 1), (values["lower"], -1)):
            if limit is not None and side * (first(wanted) - first(limit)) > 0:
                return limit + 0.0 * wanted, side
        return wanted, 0

    @classmethod
    def sample(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the states after a sample."""
        output, _, before, last, derivative = m.x
        error, w, step = m.z[0], values["filter_frequency"], values["sample_time"]
        integral = before + values["ki"] * step * error
        derivative = (derivative + w * values["kd"] * (error - last)) / (1.0 + w * step)
        wanted, side = cls._limited(values["kp"] * error + integral + derivative, values)
        if side * first(integral - before) > 0:
            integral = before
        return [output if np.any(values["delay"]) else wanted, wanted, integral, error, derivative]

    @classmethod
    def small_signal(cls, m: Moment, mode: Mode, values: Values) -> Realization | None:
        """Return the continuous law."""
        return _pid.realize({name: values[name] for name in ("kp", "ki", "kd", "filter_frequency")})
