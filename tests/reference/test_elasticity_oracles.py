"""Elasticities with closed forms: integrals and overshoot of the second order, the integrated error of any PID loop.

ISE = (ζ + 1/(4ζ)) / ωn   =>   C_ωn = -1,   C_ζ = (ζ - 1/(4ζ)) / (ζ + 1/(4ζ))
overshoot = exp(-πζ/√(1-ζ²))   =>   C_ζ = -πζ / (1-ζ²)^1.5,   C_ωn = 0
IE = 1/ki after a step of load   =>   C_ki = -1,   C_kp = C_kd = 0
"""

from __future__ import annotations

import math

import pytest

from engine.analysis.influence import influence
from engine.analysis.study import MetricRequest, measure
from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.property.strategies import Servo

ZETA = 0.7


def second_order(zeta: float) -> Diagram:
    return compile_system(
        System(
            parameters={"w": Parameter(value=3.0), "z": Parameter(value=zeta)},
            blocks={
                "r": Block(kind="input"),
                "g": Block(
                    kind="transfer_function", values={"numerator": ["=w*w"], "denominator": [1.0, "=2*z*w", "=w*w"]}
                ),
            },
            connections=(Connection(source="r", target="g"),),
            outputs={"y": "g"},
        )
    )


def elasticities(
    diagram: Diagram, metric: str, port: str, parameters: tuple[str, ...], duration: float | None = None
) -> tuple[float, dict[str, float]]:
    request = MetricRequest(metric=metric, signals={port: make("step", {})}, output="y", duration=duration)
    [(measured, gradient)] = measure(diagram, [request], gradient=list(parameters))
    assert measured.value is not None
    assert gradient is not None
    values = [diagram.parameters[name].value for name in parameters]
    found = {
        name: float(slope) * value / measured.value
        for name, slope, value in zip(parameters, gradient.values, values, strict=True)
    }
    return measured.value, found


@pytest.mark.parametrize("zeta", [0.3, ZETA, 1.0, 2.5])
def test_integral_of_the_squared_error(zeta: float) -> None:
    value, found = elasticities(second_order(zeta), "ise", "r", ("w", "z"))
    assert value == pytest.approx((zeta + 1 / (4 * zeta)) / 3.0, rel=1e-9)
    assert found["w"] == pytest.approx(-1.0, abs=1e-6)
    assert found["z"] == pytest.approx((zeta - 1 / (4 * zeta)) / (zeta + 1 / (4 * zeta)), abs=1e-6)


def test_the_printed_numbers() -> None:
    assert elasticities(second_order(ZETA), "ise", "r", ("z",))[1]["z"] == pytest.approx(0.32432, abs=5e-6)
    assert elasticities(second_order(ZETA), "overshoot", "r", ("z",))[1]["z"] == pytest.approx(-6.0380, abs=5e-5)


@pytest.mark.parametrize("zeta", [0.1, 0.4, ZETA])
def test_overshoot(zeta: float) -> None:
    value, found = elasticities(second_order(zeta), "overshoot", "r", ("w", "z"))
    assert value == pytest.approx(math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2)), rel=1e-9)
    assert found["z"] == pytest.approx(-math.pi * zeta / (1 - zeta**2) ** 1.5, rel=1e-6)
    assert found["w"] == pytest.approx(0.0, abs=1e-6)


def test_integrated_error_of_a_pid_loop_is_one_over_the_integral_gain() -> None:
    diagram = compile_system(
        System(
            parameters={"kp": Parameter(value=1.5), "ki": Parameter(value=0.6), "kd": Parameter(value=0.8)},
            blocks={
                "load": Block(kind="input", values={"role": "disturbance"}),
                "controller": Block(
                    kind="pid", values={"kp": "=kp", "ki": "=ki", "kd": "=kd", "filter_frequency": 50.0}
                ),
                "entry": Block(kind="sum", values={"signs": "+-"}),
                "plant": Block(
                    kind="transfer_function", values={"numerator": [1.0], "denominator": [1.0, 3.0, 3.0, 1.0]}
                ),
            },
            connections=(
                Connection(source="load", target="entry.in1"),
                Connection(source="controller", target="entry.in2"),
                Connection(source="entry", target="plant"),
                Connection(source="plant", target="controller"),
            ),
            outputs={"y": "plant"},
        )
    )
    value, found = elasticities(diagram, "ie", "load", ("kp", "ki", "kd"))
    assert abs(value) == pytest.approx(1 / 0.6, rel=1e-9)
    assert found == pytest.approx({"kp": 0.0, "ki": -1.0, "kd": 0.0}, abs=1e-6)


@pytest.mark.parametrize("gain", [0.7, 1.3, 2.9])
def test_an_integral_leaves_no_error_and_nothing_moves_it(gain: float) -> None:
    # 1 - T(0) = 0 for any loop with an integrator; what rounding leaves of it would have elasticities of any size
    request = MetricRequest(metric="steady_state_error", signals={"r": make("step", {})}, output="y")
    diagram = Servo(gain=gain, frequency=11.3, damping=0.3, lag=0.013).diagram()
    table = influence(diagram, {"error": request}, ["gain", "frequency", "damping", "lag"])
    assert table.base["error"].value == 0.0
    assert {cell.verdict for cell in table.elasticities["error"].values()} == {Verdict.ZERO_BASE}
    assert {cell.verdict for cell in table.coefficients["error"].values()} == {Verdict.ZERO_BASE}


def test_a_small_error_that_is_there_is_told() -> None:
    # 1 - T(0) = 1/(1 + k) = 1e-10, its elasticity in k is -k/(1 + k)
    diagram = compile_system(
        System(
            parameters={"k": Parameter(value=1e10 - 1)},
            blocks={
                "r": Block(kind="input"),
                "error": Block(kind="sum", values={"signs": "+-"}),
                "plant": Block(kind="transfer_function", values={"numerator": ["=k"], "denominator": [1.0, 1.0]}),
            },
            connections=(
                Connection(source="r", target="error.in1"),
                Connection(source="plant", target="error.in2"),
                Connection(source="error", target="plant"),
            ),
            outputs={"y": "plant"},
        )
    )
    value, found = elasticities(diagram, "steady_state_error", "r", ("k",))
    assert value == pytest.approx(1e-10, abs=1e-15)
    assert found["k"] == pytest.approx(-1.0, abs=1e-5)
