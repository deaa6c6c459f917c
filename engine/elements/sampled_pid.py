"""PID law of a digital controller: computed at regular instants from samples, held in between.

v_k = kp (b r - y)_k + I_k + D_k,   I_k = I_{k-1} + ki T e_k,   e = r - y
backward:  D_k = (D_{k-1} + w kd Δd_k)/(1 + w T),               Δd_k = (c r - y)_k - (c r - y)_{k-1}
tustin:    D_k = ((2 - w T) D_{k-1} + 2 w kd Δd_k)/(2 + w T)
u_k = v_k within lower and upper, no further than rate T from u_{k-1};   increment: v_k = u_{k-1} + Δ(v without limits)_k
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from engine.elements import _pid
from engine.elements._base import Ports, Realization, Values
from engine.elements._limited import LIMITS
from engine.elements._limiting import Limiting, Shape
from engine.elements._nonlinear import Mode, Moment, Pattern, Signals, first
from engine.elements._sampler import TIMING, Array, Sampler
from engine.model.errors import DiagramError
from engine.model.parameters import Param


class SampledPid(Sampler):
    """The output follows a sample after the time that it takes to compute; before the first one it is as near to 0 as its limits allow.

    At a limit, clamping lets the integral part wait, and back-calculation takes (u - v) T/tracking_time into it. The increment form
    has no integral part that could wind up: it goes on from the output that there was.
    """

    kind = "sampled_pid"
    title = "Sampled PID controller"
    equation = "v_k = kp (b r - y)_k + I_k + D_k;  I_k = I_{k-1} + ki T e_k;  D_k = (D_{k-1} + w kd Δd_k)/(1 + w T);  u_k = v_k in its limits"
    source = (
        "K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 3rd ed., chapter 8; K. J. Åström, T. Hägglund, Advanced PID "
        "Control, ISA 2006, sections 3.5 and 13.3."
    )
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
        Param(
            name="derivative_rule", symbol="d/dt", shape="text", choices=("backward", "tustin"), default="backward",
            doc="what stands for the filtered derivative: the backward difference, or Tustin's rule",
        ),
        *_pid.WEIGHT_P,
        *_pid.WEIGHT_D,
        Param(
            name="form", symbol="Δ", shape="text", choices=("position", "increment"), default="position",
            doc="whether the output is computed anew from an integral part, or goes on from the one before",
        ),
        *TIMING,
        *LIMITS,
        Param(
            name="rate", symbol="R", required=False, lower=0.0, lower_open=True, scale="log",
            doc="greatest change of the output per second, which gives way to lower and upper; it counts from as near to 0 as these allow; absent: none",
        ),
        Param(
            name="anti_windup", symbol="I'", shape="text", choices=("clamping", "back_calculation", "none"), default="clamping",
            doc="what the integral part does at a limit: it waits (v_k has the new one all the same), takes T/T_t (u_k - v_k), or winds up",
        ),
        Param(
            name="tracking_time", symbol="T_t", unit="s", required=False, lower=0.0, lower_open=True, scale="log",
            doc="of back_calculation: how fast the integral part follows; absent: kp/ki",
        ),
    )  # fmt: skip
    example = {"kp": 2.0, "ki": 5.0, "kd": 0.1, "filter_frequency": 200.0, "sample_time": 0.01, "delay": 0.002}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse wrong times, limits in the wrong order, and anti-windup or a form that has nothing to work on."""
        super().check(given, values)
        lower, upper, kind, ki = values["lower"], values["upper"], values["anti_windup"], values["ki"].real
        if lower is not None and upper is not None and lower.real >= upper.real:
            raise DiagramError(f"upper must be > lower ({lower.real:g}), got {upper.real:g}", at=("upper",))
        if values["form"] == "increment":
            if "anti_windup" in given:
                raise DiagramError(f"anti_windup must be absent in the increment form, got {kind}", at=("anti_windup",))
            if ki == 0:
                raise DiagramError(
                    "ki must not be 0 in the increment form, whose output would drift, got 0", at=("ki",)
                )
        limited = not (lower is None and upper is None and values["rate"] is None)
        if "anti_windup" in given and kind != "none" and not limited:
            raise DiagramError(f"lower, upper or rate must be given for {kind}, got none", at=("anti_windup",))
        if "tracking_time" in given and kind != "back_calculation":
            raise DiagramError(
                f"tracking_time must be absent unless anti_windup is back_calculation, got {kind}",
                at=("tracking_time",),
            )
        if kind == "back_calculation" and "tracking_time" not in given and values["kp"].real * ki <= 0:
            raise DiagramError(
                f"tracking_time must be given where kp/ki is not > 0 s, got kp = {values['kp'].real:g}, ki = {ki:g}",
                at=("tracking_time",),
            )

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the error as input, or reference and measurement where a setpoint weight is given."""
        return _pid.ports(values)

    @classmethod
    def initial(cls, values: Values) -> Signals:
        """Return rest; the output is the one nearest to 0 that its limits allow."""
        begins = cls._limited(0.0, values)[0]
        return [begins, begins, 0.0, 0.0, 0.0]

    @classmethod
    def feed_through(cls, values: Values) -> Pattern:
        """Return none: between samples the output does not follow the inputs."""
        return np.zeros((1, len(cls.ports(values).inputs)), dtype=bool)

    @classmethod
    def _errors(cls, m: Moment, values: Values) -> tuple[Any, Any, Any]:
        """Return what the proportional, the integral and the derivative part take."""
        if not _pid.weighted(values):
            return m.z[0], m.z[0], m.z[0]
        reference, measured = m.z
        b, c = (values.get(f"setpoint_weight_{part}") for part in "pd")
        return (
            reference * (1.0 if b is None else b) - measured,
            reference - measured,
            reference * (1.0 if c is None else c) - measured,
        )

    @classmethod
    def unrest(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the states are from those of ever the same inputs."""
        output, computed, integral, last, derivative = m.x
        proportional, error, derived = cls._errors(m, values)
        if values["form"] == "increment":
            wanted = cls._limited(computed + values["ki"] * error, values)[0]
            return [computed - output, wanted - computed, proportional - integral, derived - last, derivative]
        asked = values["kp"] * proportional + integral
        wanted = cls._limited(asked, values)[0]
        rest = values["ki"] * error if np.any(values["ki"]) else integral
        if values["anti_windup"] == "back_calculation":
            rest = rest + (wanted - asked) / cls._tracking(values)
        return [wanted - output, wanted - computed, rest, derived - last, derivative]

    @classmethod
    def limits(cls, values: Values) -> list[tuple[Any, Any]]:
        """Return the limits."""
        lower, upper = values["lower"], values["upper"]
        return [(-np.inf if lower is None else lower, np.inf if upper is None else upper)]

    @classmethod
    def linear_part(cls, values: Values) -> Values:
        """Return the values without limits; anti-windup then has nothing to do."""
        return {**values, "lower": None, "upper": None, "rate": None}

    @classmethod
    def limiting(cls, values: Values) -> Limiting | None:
        """Return its limits, and what anti-windup makes of the integral part at them."""
        if values["lower"] is None and values["upper"] is None and values["rate"] is None:
            return None
        lower, upper = cls.limits(values)[0]
        reach = np.inf if values["rate"] is None else values["rate"] * values["sample_time"]
        if values["form"] == "increment":
            return Limiting(lower, upper, reach)
        follows = values["anti_windup"] == "back_calculation"
        shape = Shape.WAITING if values["anti_windup"] == "clamping" else Shape.WITHIN
        share = values["sample_time"] / cls._tracking(values) if follows else 0.0
        return Limiting(lower, upper, reach, integral=2, share=share, shape=shape)

    @classmethod
    def free(cls, before: Array, after: Array, values: Values) -> npt.NDArray[np.bool_]:
        """Return at which samples the output wanted is within its limits, and as near to the one before as its rate lets it be."""
        limits = cls.limiting(values)
        if limits is None:
            return super().free(before, after, values)
        lower, upper, reach = limits[:3]
        return np.asarray((lower <= after[1]) & (after[1] <= upper) & (np.abs(after[1] - before[1]) <= reach))

    @classmethod
    def _limited(cls, wanted: Any, values: Values, before: Any = None) -> tuple[Any, int]:
        """Return the output within its limits, and which limit it is at: 1, -1 or 0; the rate counts from ``before``."""
        reach = None if before is None or values["rate"] is None else values["rate"] * values["sample_time"]
        found, at = wanted, 0
        limits = [] if reach is None else [(before + reach, 1), (before - reach, -1)]
        for limit, side in (*limits, (values["upper"], 1), (values["lower"], -1)):
            if limit is not None and side * (first(found) - first(limit)) > 0:
                found, at = limit + 0.0 * wanted, side
        return found, at

    @classmethod
    def _tracking(cls, values: Values) -> Any:
        """Return the tracking time, s."""
        return values["kp"] / values["ki"] if values["tracking_time"] is None else values["tracking_time"]

    @classmethod
    def sample(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the states after a sample."""
        output, computed, before, last, derivative = m.x
        proportional, error, derived = cls._errors(m, values)
        w, step = values["filter_frequency"], values["sample_time"]
        kick = w * values["kd"] * (derived - last)
        if values["derivative_rule"] == "tustin":
            now = ((2.0 - w * step) * derivative + 2.0 * kick) / (2.0 + w * step)
        else:
            now = (derivative + kick) / (1.0 + w * step)
        if values["form"] == "increment":
            change = values["kp"] * (proportional - before) + values["ki"] * step * error + now - derivative
            wanted = cls._limited(computed + change, values, computed)[0]
            return [output if np.any(values["delay"]) else wanted, wanted, proportional, derived, now]
        integral = before + values["ki"] * step * error
        asked = values["kp"] * proportional + integral + now
        wanted, side = cls._limited(asked, values, computed)
        if values["anti_windup"] == "clamping" and side * first(integral - before) > 0:
            integral = before
        elif values["anti_windup"] == "back_calculation":
            integral = integral + step / cls._tracking(values) * (wanted - asked)
        return [output if np.any(values["delay"]) else wanted, wanted, integral, derived, now]

    @classmethod
    def small_signal(cls, m: Moment, mode: Mode, values: Values) -> Realization | None:
        """Return the continuous law."""
        names = ("kp", "ki", "kd", "filter_frequency", "setpoint_weight_p", "setpoint_weight_d")
        return _pid.realize({name: values[name] for name in names})
