"""Marches of nonlinear diagrams against equations written by hand and integrated to 1e-12, and against closed solutions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bench import nonlinear_loop
from engine.analysis.measuring import MetricRequest
from engine.batch.nonlinear.batch import NonlinearBatch
from engine.batch.nonlinear.equations import Equations
from engine.batch.nonlinear.march import Marcher, Pieces, by_input
from engine.batch.nonlinear.program import Compiled
from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.signals import make


def diagram(blocks: dict[str, Block], wires: list[tuple[str, str]], output: str, **parameters: float) -> Diagram:
    return compile_system(
        System(
            name="case", blocks=blocks, outputs={"y": output},
            parameters={name: Parameter(value=value) for name, value in parameters.items()},
            connections=tuple(Connection(source=a, target=b) for a, b in wires),
        )
    )  # fmt: skip


def test_the_loop_with_friction_and_a_damper_follows_its_equations():
    """`rates` of the benchmark is the loop as one writes it down for an integrator; DOP853 takes it to 1e-12."""
    points = nonlinear_loop.sample(3, seed=11)
    made = Compiled(Equations.of(nonlinear_loop.diagram(), list(nonlinear_loop.PARAMETERS)), [0])
    start, once, *_ = made.start(points)
    step = {"reference": make("step", {"amplitude": nonlinear_loop.STEP})}
    end = 0.1
    curves = Marcher(made, generate=False)(start, once, Pieces.of(by_input(("reference",), step), end, 2000, 3))
    times = np.linspace(0.0, end, 11)
    for k, point in enumerate(points):
        exact = solve_ivp(
            nonlinear_loop.rates, (0.0, end), np.zeros(10), method="DOP853", t_eval=times, args=tuple(point.tolist()),
            rtol=1e-12, atol=1e-14,
        ).y[nonlinear_loop.POSITION]  # fmt: skip
        found = np.interp(times, curves.times, curves.values[0, :, k])
        np.testing.assert_allclose(found, exact, atol=2e-6 * nonlinear_loop.STEP)
        speed = np.gradient(curves.values[0, :, k], curves.times)
        np.testing.assert_allclose(curves.slopes[0, 1:-1, k], speed[1:-1], atol=1e-4 * np.abs(speed).max())


@pytest.mark.parametrize("steps", [250, 500])
def test_the_method_is_of_fourth_order(steps):
    """Van der Pol's oscillator from products: halving the step divides the error by 16."""
    blocks = {
        "u": Block(kind="input", values={}), "v": Block(kind="integrator", values={}),
        "x": Block(kind="integrator", values={}), "square": Block(kind="multiplication", values={"operations": "**"}),
        "damped": Block(kind="multiplication", values={"operations": "**"}),
        "sum": Block(kind="sum", values={"signs": "+--+"}),
    }  # fmt: skip
    wires = [
        ("u", "sum.in1"), ("x", "sum.in2"), ("damped", "sum.in3"), ("v", "sum.in4"), ("sum", "v"), ("v", "x"),
        ("x", "square.in1"), ("x", "square.in2"), ("square", "damped.in1"), ("v", "damped.in2"),
    ]  # fmt: skip
    case = diagram(blocks, wires, "x")
    made = Compiled(Equations.of(case, ()), [0])
    start, once, *_ = made.start(np.zeros((1, 0)))
    signals = by_input(("u",), {"u": make("step", {"amplitude": 0.5})})

    def rates(_: float, y: np.ndarray) -> list[float]:
        return [y[1], 0.5 - y[0] - y[0] ** 2 * y[1] + y[1]]

    exact = solve_ivp(rates, (0.0, 10.0), [0.0, 0.0], method="DOP853", rtol=1e-13, atol=1e-14).y[0, -1]
    march = Marcher(made, generate=False)
    errors = [abs(march(start, once, Pieces.of(signals, 10.0, steps << k)).values[0, -1, 0] - exact) for k in range(2)]
    assert errors[1] < 1e-6
    assert 12 < errors[0] / errors[1] < 20


def test_a_limited_rate_rises_straight_and_then_decays():
    """x' = sat(k (r - x)): x = l t until k (r - x) = l, then r - x falls as e^(-k t); A. every instant in closed form."""
    blocks = {
        "r": Block(kind="input", values={}), "error": Block(kind="sum", values={"signs": "+-"}),
        "gain": Block(kind="gain", values={"gain": "=k"}),
        "limit": Block(kind="saturation", values={"lower": "=-l", "upper": "=l"}),
        "x": Block(kind="integrator", values={}),
    }  # fmt: skip
    wires = [("r", "error.in1"), ("x", "error.in2"), ("error", "gain"), ("gain", "limit"), ("limit", "x")]
    case = diagram(blocks, wires, "x", k=8.0, l=2.0)
    step = {"r": make("step", {"amplitude": 1.0})}
    asked = [
        MetricRequest(metric=m, signals=step, output="y") for m in ("rise_time", "settling_time", "ise", "overshoot")
    ]
    points = np.array([[8.0, 2.0], [20.0, 2.0], [5.0, 1.0], [3.0, 50.0]])
    found = NonlinearBatch(case, ["k", "l"], asked)(points)
    assert not found.doubtful.any()
    for (k, limit), (rise, settling, ise, overshoot) in zip(points, found.values, strict=True):
        left = min(limit / k, 1.0)  # what is left when the limit is
        leaves = (1.0 - left) / limit
        passes = [
            (1 - rest) / limit if rest >= left else leaves + math.log(left / rest) / k for rest in (0.9, 0.1, 0.02)
        ]
        assert rise == pytest.approx(passes[1] - passes[0], rel=1e-4)
        assert settling == pytest.approx(passes[2], rel=1e-4)
        assert ise == pytest.approx((1 - left**3) / (3 * limit) + left**2 / (2 * k), rel=1e-4)
        assert overshoot == pytest.approx(0.0, abs=1e-4)


def test_a_mass_on_smooth_friction_reaches_its_terminal_velocity():
    """m v' = F - F_c tanh(v/v_t) - b v: at rest F = F_c tanh(v/v_t) + b v, here with v >> v_t: v = (F - F_c)/b."""
    blocks = {
        "force": Block(kind="input", values={}), "net": Block(kind="sum", values={"signs": "+-"}),
        "mass": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": ["=m", 0.0]}),
        "friction": Block(kind="friction", values={"coulomb": "=c", "viscous": "=b", "transition_velocity": 0.01}),
    }  # fmt: skip
    wires = [("force", "net.in1"), ("friction", "net.in2"), ("net", "mass"), ("mass", "friction")]
    case = diagram(blocks, wires, "mass", m=2.0, c=3.0, b=4.0)
    asked = [MetricRequest(metric="peak", signals={"force": make("step", {"amplitude": 10.0})}, output="y")]
    found = NonlinearBatch(case, ["m", "c", "b"], asked)(np.array([[2.0, 3.0, 4.0], [1.0, 5.0, 2.0]]))
    assert not found.doubtful.any()
    np.testing.assert_allclose(found.values[:, 0], [7 / 4, 5 / 2], rtol=1e-5)


def test_a_peak_that_comes_after_passing_near_the_edge_of_rest_is_waited_for():
    """A dead zone before an integrating plant: the output passes the first place where it could rest, and still rises."""
    k, half = 7.544660140101639, 0.01
    blocks = {
        "r": Block(kind="input", values={}), "error": Block(kind="sum", values={"signs": "+-"}),
        "lead": Block(kind="transfer_function", values={"numerator": ["=0.1*k", "=k"], "denominator": [0.01, 1.0]}),
        "zone": Block(kind="dead_zone", values={"lower": -half, "upper": half}),
        "plant": Block(kind="transfer_function", values={"numerator": [2.5], "denominator": [1.0, 9.0, 20.0, 0.0]}),
    }  # fmt: skip
    wires = [("r", "error.in1"), ("plant", "error.in2"), ("error", "lead"), ("lead", "zone"), ("zone", "plant")]
    step = {"r": make("step", {"amplitude": 1.0})}
    asked = [MetricRequest(metric=m, signals=step, output="y") for m in ("peak", "peak_time")]
    found = NonlinearBatch(diagram(blocks, wires, "plant", k=5.0), ["k"], asked)(np.array([[k]]))

    def rates(_: float, state: np.ndarray) -> list[float]:
        filtered, y, speed, acceleration = state
        error = 1.0 - y
        command = k * (10.0 * error - 9.0 * filtered)
        passed = command - min(max(command, -half), half)
        return [(error - filtered) / 0.01, speed, acceleration, 2.5 * passed - 9.0 * acceleration - 20.0 * speed]

    def turns(_: float, state: np.ndarray) -> float:
        return float(state[2])

    turns.direction = -1.0  # type: ignore[attr-defined]
    exact = solve_ivp(
        rates, (0.0, 8.0), np.zeros(4), method="DOP853", events=turns, rtol=1e-12, atol=1e-14, max_step=0.01
    )
    assert not found.doubtful.any()
    assert found.values[0] == pytest.approx([exact.y_events[0][0][1], exact.t_events[0][0]], rel=1e-4)
