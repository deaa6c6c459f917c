"""A settling time jumps where a turning point touches the band; its elasticity is then one-sided, and said to be."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from engine.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.influence import influence
from engine.signals import make
from engine.study import MetricRequest, measure
from engine.verdicts import Verdict


def second_order(damping: float) -> Diagram:
    blocks = {
        "u": Block(kind="input", values={}),
        "lag": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": [1.0, "=2*zeta", 1.0]}),
    }
    return compile_system(
        System(
            name="second order",
            parameters={"zeta": Parameter(value=damping)},
            blocks=blocks,
            connections=(Connection(source="u", target="lag"),),
            outputs={"y": "lag"},
        )
    )


REQUEST = {"settling_time": MetricRequest(metric="settling_time", signals={"u": make("step", {})}, output="y")}
TOUCHING = brentq(lambda z: np.exp(-np.pi * z / np.sqrt(1 - z * z)) - 0.02, 0.7, 0.85, xtol=1e-15)
"""Damping at which the overshoot is exactly 2 %: 0.7797."""


def test_settling_time_jumps_at_the_damping_whose_overshoot_is_the_band() -> None:
    # simulation literature: ω t_s = 5.09 at ζ = 0.7795, 3.60 at ζ = 0.7800
    values = [measure(second_order(z), [REQUEST["settling_time"]])[0][0].value for z in (0.7795, 0.7800)]
    assert values == pytest.approx([5.09, 3.60], abs=0.01)


@pytest.mark.parametrize(("damping", "one_sided"), [(TOUCHING, True), (0.7, False), (0.9, False)])
def test_only_at_the_jump_the_elasticity_is_one_sided(damping: float, one_sided: bool) -> None:
    cell = influence(second_order(damping), REQUEST, ["zeta"]).elasticities["settling_time"]["zeta"]
    assert cell.one_sided is one_sided
    assert cell.verdict is (Verdict.DISCONTINUOUS if one_sided else Verdict.OK)
    assert cell.value is not None
