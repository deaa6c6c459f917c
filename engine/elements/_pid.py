"""The family of P, PI, PD and PID laws: declared parameters and one realisation for all of them.

u = kp (b r - y) + ki ∫(r - y) dt + kd s/(1 + s/w) (c r - y)

Without setpoint weights the input is the error e = r - y (b = c = 1). Source: K. J. Åström and T. Hägglund,
Advanced PID Control, ISA 2006, chapter 3.
"""

from __future__ import annotations

from typing import Final

from engine.elements._base import Ports, Reading, Realization, Values, absent, exclusive, matrix, vanishing
from engine.model.parameters import Param, Scalar

SOURCE: Final = "K. J. Åström and T. Hägglund, Advanced PID Control, ISA 2006, chapter 3."

PROPORTIONAL: Final = (Param(name="kp", symbol="K_p", scale="log", doc="proportional gain"),)
INTEGRAL: Final = (
    Param(name="ki", symbol="K_i", default=0.0, doc="integral gain: output per second for an error of 1"),
    Param(
        name="integral_time", symbol="T_i", unit="s", required=False, lower=0.0, lower_open=True, scale="log",
        doc="ideal form, in place of ki = kp/integral_time",
    ),
)  # fmt: skip
DERIVATIVE: Final = (
    Param(name="kd", symbol="K_d", default=0.0, doc="derivative gain: output for an error that grows by 1 per second"),
    Param(
        name="derivative_time", symbol="T_d", unit="s", required=False, lower=0.0,
        doc="ideal form, in place of kd = kp·derivative_time",
    ),
    Param(
        name="filter_frequency", symbol="w", unit="rad/s", default=100.0, lower=0.0, lower_open=True, scale="log",
        doc="corner of the derivative's filter, without which the law is improper",
    ),
)  # fmt: skip
WEIGHT_P: Final = (
    Param(
        name="setpoint_weight_p", symbol="b", unit="1", required=False,
        doc="weight of the reference in the proportional part; given, the inputs are reference and measurement",
    ),
)  # fmt: skip
WEIGHT_D: Final = (
    Param(
        name="setpoint_weight_d", symbol="c", unit="1", required=False,
        doc="weight of the reference in the derivative part; given, the inputs are reference and measurement",
    ),
)  # fmt: skip


def check(given: frozenset[str]) -> None:
    """Refuse both forms of a gain at once."""
    exclusive(given, "ki", "integral_time")
    exclusive(given, "kd", "derivative_time")


def assumed(given: frozenset[str]) -> dict[str, str]:
    """Return what is told of a derivative whose filter is not given."""
    if given.isdisjoint({"kd", "derivative_time"}) or "filter_frequency" in given:
        return {}
    return {"filter_frequency": "is taken to be 100 rad/s, since it is not given: a derivative needs a filter"}


def weighted(values: Values) -> bool:
    """Return whether the reference has weights of its own."""
    return any(values.get(f"setpoint_weight_{part}") is not None for part in "pd")


def ports(values: Values) -> Ports:
    """Return the error as input, or reference and measurement where a setpoint weight is given."""
    return Ports(inputs=("reference", "measurement") if weighted(values) else ("in",))


def gains(values: Values) -> tuple[Scalar, Scalar, Scalar]:
    """Return kp, ki and kd, whichever form they are given in."""
    kp = values["kp"]
    ki: Scalar = values.get("ki", 0.0)
    kd: Scalar = values.get("kd", 0.0)
    if values.get("integral_time") is not None:
        ki = ki + kp / values["integral_time"]
    if values.get("derivative_time") is not None:
        kd = kd + kp * values["derivative_time"]
    return kp, ki, kd


def realize(values: Values) -> Realization:
    """Return the integral part and the filtered derivative's input as states, each only where it is needed."""
    kp, ki, kd = gains(values)
    both = weighted(values)
    b = _weights(values.get("setpoint_weight_p"), weighted=both)
    c = _weights(values.get("setpoint_weight_d"), weighted=both)
    error = _weights(None, weighted=both)

    inputs: list[list[Scalar]] = []
    rates: list[Scalar] = []
    outputs: list[Scalar] = []
    proportional = direct = [kp * weight for weight in b]
    integral: list[Scalar] = []
    derived: list[Scalar] = []
    if not absent(ki):
        # x' = ki e: the state is the integral part of the output itself.
        rates.append(-vanishing(ki))
        inputs.append([ki * weight for weight in error])
        outputs.append(1.0)
        integral.append(1.0)
        derived.append(0.0)
    if not absent(kd):
        # x' = w (c r - y - x), and the derivative part is kd x'.
        w = values["filter_frequency"]
        rates.append(-w)
        inputs.append([w * weight for weight in c])
        outputs.append(-kd * w)
        integral.append(0.0)
        derived.append(kd)
        direct = [gain + kd * w * weight for gain, weight in zip(direct, c, strict=True)]
    if not rates:
        return Realization.static(matrix([direct]))
    a = matrix([[rate if i == j else 0.0 for j in range(len(rates))] for i, rate in enumerate(rates)])
    reading = Reading(c=matrix([integral]), d=matrix([proportional]), k=matrix([derived])) if not absent(kd) else None
    return Realization(a=a, b=matrix(inputs), c=matrix([outputs]), d=matrix([direct]), reading=reading)


def _weights(reference: Scalar | None, *, weighted: bool) -> list[Scalar]:
    if not weighted:
        return [1.0]
    return [1.0 if reference is None else reference, -1.0]
