"""What a sampler takes at the instant of a jump: the signal behind the limits, relays and steps that it comes through, not in front of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from engine.analysis.study import simulate
from engine.diagram.diagram import compile_system
from engine.signals import make
from tests.unit.engine.diagrams import block, document

PERIOD = 0.002
LAWS = {
    "saturation": (block("saturation", lower=-1.5, upper=1.5), 1.5),
    "relay": (block("relay", low=-0.7, high=0.7), 0.7),
    "quantizer": (block("quantizer", step=0.5), 12.0),
    "dead zone": (block("dead_zone", lower=-2.0, upper=2.0), 10.1),
    "limited PID": (block("pid", kp=6.0, lower=-1.5, upper=1.5), 1.5),
    "table": (block("lookup_table", points=[-1.0, 0.0, 1.0, 20.0], values=[0.0, 0.0, 2.0, 2.0]), 2.0),
}


@pytest.mark.parametrize("start", [0.0, 0.02, 0.021, 0.0207])
@pytest.mark.parametrize("law", LAWS)
def test_a_sample_at_the_instant_of_a_jump(law, start) -> None:
    made, level = LAWS[law]
    blocks = {"r": block("input"), "law": made, "hold": block("zero_order_hold", sample_time=PERIOD)}
    system = compile_system(document(blocks, ("r -> law", "law -> hold"), {"u": "hold"}))
    step = make("step", {"amplitude": 12.1, "start": start})
    found = simulate(system, signals={"r": step}, duration=0.05, samples=501, metrics=())
    taken = np.ceil(start / PERIOD - 1e-9) * PERIOD
    rest = {"relay": -0.7}.get(law, 0.0)
    late, early = found.time > taken + 1e-9, found.time < taken - 1e-9
    np.testing.assert_allclose(found.curves["u"][late], level, atol=1e-12)
    assert set(np.round(found.curves["u"][early], 12)) <= {rest, -rest, 0.0}


def test_one_sampler_takes_what_another_has_just_made_behind_a_limit() -> None:
    blocks = {
        "r": block("input"), "a": block("zero_order_hold", sample_time=PERIOD), "g": block("gain", gain=5.0),
        "s": block("saturation", lower=-2.0, upper=2.0), "b": block("zero_order_hold", sample_time=PERIOD),
    }  # fmt: skip
    wires = ("r -> a", "a -> g", "g -> s", "s -> b")
    system = compile_system(document(blocks, wires, {"u": "b"}))
    found = simulate(system, signals={"r": make("step", {"amplitude": 1.0})}, duration=0.02, samples=201, metrics=())
    assert set(np.round(found.curves["u"], 12)) <= {0.0, 2.0}  # never the 5 in front of the limit
    np.testing.assert_allclose(found.curves["u"][found.time > PERIOD + 1e-9], 2.0)


@pytest.mark.parametrize("inner", ["back_calculation", "clamping", "none"])
@pytest.mark.parametrize("delay", [0.0005, 0.001])
def test_a_cascade_whose_limits_both_act(inner, delay) -> None:
    """x'' = u;  an outer PI within ±1.5 that follows its limit, an inner one, sampled, within ±8: both by hand between the samples."""
    tracking = {"tracking_time": 0.05} if inner == "back_calculation" else {}
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "d": block("sum", signs="+-"), "v": block("integrator"),
        "x": block("integrator"),
        "outer": block("pid", kp=6.0, ki=4.0, lower=-1.5, upper=1.5, anti_windup="back_calculation", tracking_time=0.2),
        "inner": block(
            "sampled_pid", kp=20.0, ki=200.0, sample_time=PERIOD, delay=delay, lower=-8.0, upper=8.0, anti_windup=inner,
            **tracking,
        ),
    }  # fmt: skip
    wires = (
        "r -> e.in1",
        "x -> e.in2",
        "e -> outer",
        "outer -> d.in1",
        "v -> d.in2",
        "d -> inner",
        "inner -> v",
        "v -> x",
    )
    system = compile_system(document(blocks, wires, {"x": "x"}))
    found = simulate(system, signals={"r": make("step", {"amplitude": 2.0})}, duration=0.8, samples=401, metrics=())

    def rates(_, q, u):
        raw = 6.0 * (2.0 - q[0]) + q[2]
        return [q[1], u, 4.0 * (2.0 - q[0]) + (np.clip(raw, -1.5, 1.5) - raw) / 0.2]

    state, integral, u, positions = np.zeros(3), 0.0, 0.0, [0.0]
    for _ in range(400):
        error = np.clip(6.0 * (2.0 - state[0]) + state[2], -1.5, 1.5) - state[1]
        before, integral = integral, integral + 200.0 * PERIOD * error
        asked = 20.0 * error + integral
        wanted = np.clip(asked, -8.0, 8.0)
        if inner == "back_calculation":
            integral += PERIOD / 0.05 * (wanted - asked)
        elif inner == "clamping" and wanted != asked and (asked - wanted) * (integral - before) > 0:
            integral = before
        for width in (delay, PERIOD - delay):
            state = solve_ivp(rates, (0, width), state, args=(u,), method="DOP853", rtol=1e-10, atol=1e-13).y[:, -1]
            u = wanted
        positions.append(state[0])
    np.testing.assert_allclose(found.curves["x"], positions, atol=2e-9)
