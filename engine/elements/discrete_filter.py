"""Filter of a digital controller: a Butterworth low-pass or high-pass, or a lead-lag, by Tustin's rule exact at its frequency.

y/u = F(s), s = w/tan(w T/2) (z - 1)/(z + 1);   w: the corner, of a lead-lag the geometric mean of both corners
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from engine.elements._base import Ports, Realization, Values
from engine.elements._butterworth import butterworth
from engine.elements._canonical import rational
from engine.elements._discrete import Discrete
from engine.elements._sampler import TIMING
from engine.model.errors import DiagramError
from engine.model.parameters import Param

_CORNERS = {
    "low_pass": ("frequency",),
    "high_pass": ("frequency",),
    "lead_lag": ("zero_frequency", "pole_frequency"),
}
_OWNERS = {
    "frequency": ("low_pass", "high_pass"), "order": ("low_pass", "high_pass"), "gain": ("lead_lag",),
    "zero_frequency": ("lead_lag",), "pole_frequency": ("lead_lag",),
}  # fmt: skip


class DiscreteFilter(Discrete):
    """A Butterworth filter has -3 dB at its corner, exactly; a lead-lag its largest phase at the mean of its corners."""

    kind = "discrete_filter"
    title = "Discrete filter"
    equation = "F(s) with s = w/tan(w T/2) (z - 1)/(z + 1): Butterworth of order 1 to 8, or K (1 + s/w_z)/(1 + s/w_p)"
    source = "K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 3rd ed., section 8.2 (prewarping)."
    parameters = (
        Param(
            name="design", symbol="F", shape="text", choices=tuple(_CORNERS), default="low_pass",
            doc="Butterworth low-pass or high-pass, or lead-lag",
        ),
        Param(
            name="frequency", symbol="w", unit="rad/s", required=False, lower=0.0, lower_open=True, scale="log",
            doc="corner frequency of a low-pass or high-pass",
        ),
        Param(
            name="order", symbol="n", shape="integer", default=2, lower=1, upper=8,
            doc="number of poles of a low-pass or high-pass",
        ),
        Param(name="gain", symbol="K", default=1.0, doc="gain at rest of a lead-lag"),
        Param(
            name="zero_frequency", symbol="w_z", unit="rad/s", required=False, lower=0.0, lower_open=True, scale="log",
            doc="corner of the numerator of a lead-lag",
        ),
        Param(
            name="pole_frequency", symbol="w_p", unit="rad/s", required=False, lower=0.0, lower_open=True, scale="log",
            doc="corner of the denominator of a lead-lag",
        ),
        *TIMING,
    )  # fmt: skip
    example = {"frequency": 100.0, "order": 1, "sample_time": 0.005}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse what another design has, a corner that is missing, and one at the Nyquist frequency or beyond."""
        super().check(given, values)
        design = values["design"]
        for name, designs in _OWNERS.items():
            if name in given and design not in designs:
                unit = " rad/s" if name.endswith("frequency") else ""
                got = values[name] if name == "order" else f"{values[name].real:g}{unit}"
                raise DiagramError(f"{name} must be absent in a {design}, got {got}", at=(name,))
        step = values["sample_time"].real
        for name in _CORNERS[design]:
            if name not in given:
                raise DiagramError(f"{name} must be given for a {design}, got none", at=(name,))
            if values[name].real * step >= math.pi:
                raise DiagramError(
                    f"{name} must be < {math.pi / step:g} rad/s, the Nyquist frequency of a sample_time of {step:g} s, "
                    f"got {values[name].real:g}",
                    at=(name,),
                )

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def discrete(cls, values: Values) -> Realization:
        """Return the filter of a frequency of 1 by Tustin's rule."""
        if values["design"] == "lead_lag":
            zero, pole, gain = values["zero_frequency"], values["pole_frequency"], values["gain"]
            middle: Any = np.sqrt(zero * pole)
            k: Any = middle / np.tan(0.5 * middle * values["sample_time"])
            return rational([gain * (1 + k / zero), gain * (1 - k / zero)], [1 + k / pole, 1 - k / pole])
        turn: Any = np.tan(0.5 * values["frequency"] * values["sample_time"])
        law = butterworth(1.0, values["order"])
        if values["design"] == "low_pass":
            return _tustin(law, 1 / turn)
        # a high-pass is a low-pass as far below the Nyquist frequency, at -z
        found = _tustin(law, turn)
        return replace(found, a=-found.a, b=-found.b)


def _tustin(law: Realization, k: Any) -> Realization:
    """Return a law with s = k (z - 1)/(z + 1); ``k`` is a number or a batch."""
    n = law.a.shape[-1]
    scale = np.asarray(k)[..., None, None]
    inverse = np.linalg.inv(scale * np.eye(n) - law.a)
    states = inverse @ law.b
    return Realization(
        a=inverse @ (scale * np.eye(n) + law.a), b=2 * scale * states, c=law.c @ inverse, d=law.d + law.c @ states
    )
