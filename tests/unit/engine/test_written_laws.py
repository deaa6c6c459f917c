"""Laws that a user writes: `function`, `switch` and `bias`, against scipy's integration and against blocks that do the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from engine.analysis.influence import Method, influence
from engine.analysis.measuring import MetricRequest
from engine.analysis.study import Simulation, frequency_response, simulate
from engine.diagram.diagram import Block, Diagram, compile_system
from engine.model.errors import EngineError
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document


def diagram(blocks: Mapping[str, Block], wires: Sequence[str], outputs: Mapping[str, str], **given: Any) -> Diagram:
    return compile_system(document({"r": block("input"), **blocks}, wires, outputs, **given))


def run(made: Diagram, duration: float | None, kind: str = "step", **values: Any) -> Simulation:
    return simulate(made, signals={"r": make(kind, values)}, duration=duration)


def arm(expression: str = "9.81*sin(u1)/l + c*u2*abs(u2)", **given: Any) -> Diagram:
    """Return a pendulum with air drag, driven by a torque: θ'' = r - 9.81/l sin θ - c ω |ω|."""
    law = block("function", expression=expression, constants=["l", "c"], values=["=l", "=c"])
    return diagram(
        {"n": block("sum", signs="+-"), "f": law, "w": block("integrator"), "a": block("integrator")},
        ["r -> n.in1", "f -> n.in2", "n -> w", "w -> a", "a -> f.u1", "w -> f.u2"],
        {"angle": "a", "speed": "w"},
        **{"l": 0.7, "c": 0.4} | given,
    )


def reference(t: np.ndarray, torque: float, length: float = 0.7, drag: float = 0.4) -> np.ndarray:
    def rates(_: float, x: np.ndarray) -> list[float]:
        return [x[1], torque - 9.81 / length * np.sin(x[0]) - drag * x[1] * abs(x[1])]

    found = solve_ivp(rates, (0, t[-1]), [0.0, 0.0], method="DOP853", t_eval=t, rtol=1e-12, atol=1e-13)
    return np.asarray(found.y)


def test_a_pendulum_with_drag_is_that_of_scipy():
    found = run(arm(), 4.0, amplitude=20.0)
    assert found.verdict is Verdict.OK
    angle, speed = reference(found.time, 20.0)
    np.testing.assert_allclose(found.curves["angle"], angle, atol=1e-8)
    np.testing.assert_allclose(found.curves["speed"], speed, atol=1e-8)


def highest(length: float, drag: float) -> float:
    """Return the peak of the first swing under a torque of 6."""

    def rates(_: float, x: np.ndarray) -> list[float]:
        return [x[1], 6.0 - 9.81 / length * np.sin(x[0]) - drag * x[1] * abs(x[1])]

    def turns(_: float, x: np.ndarray) -> float:
        return float(x[1])

    turns.terminal, turns.direction = True, -1.0  # type: ignore[attr-defined]
    found = solve_ivp(rates, (0, 4.0), [0.0, 0.0], method="DOP853", events=turns, rtol=1e-13, atol=1e-14)
    return float(found.y_events[0][0][0])


def test_its_slopes_are_those_of_differences():
    signals = {"r": make("step", {"amplitude": 6.0})}
    wanted = {"peak": MetricRequest(metric="peak", signals=signals, output="angle", duration=4.0)}
    found = influence(arm(), wanted, ["l", "c"]).elasticities["peak"]
    value, h = highest(0.7, 0.4), 1e-3
    for name, moved in {
        "l": [highest(0.7 * (1 + k * h), 0.4) for k in (-2, -1, 1, 2)],
        "c": [highest(0.7, 0.4 * (1 + k * h)) for k in (-2, -1, 1, 2)],
    }.items():
        slope = (moved[0] - 8 * moved[1] + 8 * moved[2] - moved[3]) / (12 * h)
        assert found[name].method is Method.EXACT
        assert found[name].value == pytest.approx(slope / value, rel=1e-7)


@pytest.mark.parametrize(
    ("expression", "kind", "values"),
    [
        ("max(min(u1, 0.6), -0.4)", "saturation", {"lower": -0.4, "upper": 0.6}),
        ("u1 - max(min(u1, 0.6), -0.4)", "dead_zone", {"lower": -0.4, "upper": 0.6}),
        ("min(u1, 0.3 + 0.5*(u1 - 0.3))", "lookup_table",
         {"points": [-5.0, 0.3, 5.0], "values": [-5.0, 0.3, 2.65], "extrapolation": "linear"}),
    ],
)  # fmt: skip
def test_a_written_law_does_what_the_block_does(expression, kind, values):
    def closed(law: Block) -> Diagram:
        return diagram(
            {
                "e": block("sum", signs="+-"),
                "n": law,
                "g": block("transfer_function", numerator=[3.0], denominator=[1, 0.6, 2, 0]),
            },
            ["r -> e.in1", "g -> e.in2", "e -> n", "n -> g"],
            {"y": "g"},
        )

    written, built = (
        run(closed(law), 6.0, amplitude=1.5)
        for law in (block("function", expression=expression), block(kind, **values))
    )
    np.testing.assert_allclose(written.curves["y"], built.curves["y"], atol=1e-10)


TABLE = {"tables": ["f"], "table_points": [[-1.0, 0.0, 0.5, 2.0]], "table_values": [[-0.5, 0.1, 0.9, "=top"]]}


def interpolated(u: Any, top: float = 1.2) -> Any:
    return np.interp(u, TABLE["table_points"][0], [-0.5, 0.1, 0.9, top])


def tabled(law: Block) -> Diagram:
    """Return a loop round a table: y as third derivative + 0.6 y'' + 2 y' is 3 f(r - y)."""
    plant = block("transfer_function", numerator=[3.0], denominator=[1, 0.6, 2, 0])
    return diagram(
        {"e": block("sum", signs="+-"), "n": law, "g": plant},
        ["r -> e.in1", "g -> e.in2", "e -> n", "n -> g"], {"y": "g"}, top=1.2,
    )  # fmt: skip


def swinging(amplitude: float, top: float = 1.2) -> Any:
    """Return the solution of that loop by scipy."""

    def rates(_: float, x: np.ndarray) -> list[float]:
        return [x[1], x[2], 3 * interpolated(amplitude - x[0], top) - 0.6 * x[2] - 2 * x[1]]

    return solve_ivp(
        rates, (0, 6.0), [0.0] * 3, method="DOP853", rtol=1e-11, atol=1e-12, max_step=0.005, dense_output=True
    ).sol


@pytest.mark.parametrize("amplitude", [1.5, 4.0])  # the larger begins beyond the last point
def test_a_table_by_name_is_a_lookup_table(amplitude):
    points, heights = TABLE["table_points"][0], TABLE["table_values"][0]
    written = run(tabled(block("function", expression="f(u1)", **TABLE)), 6.0, amplitude=amplitude)
    built = run(tabled(block("lookup_table", points=points, values=heights)), 6.0, amplitude=amplitude)
    assert written.verdict is Verdict.OK
    np.testing.assert_allclose(written.curves["y"], built.curves["y"], atol=1e-10)
    np.testing.assert_allclose(written.curves["y"], swinging(amplitude)(written.time)[0], atol=1e-7)


def test_what_a_table_says_has_an_exact_slope():
    def peak(top: float) -> float:
        found = swinging(1.5, top)
        near = float(np.argmax(found(np.linspace(0, 6, 6001))[0])) * 1e-3
        return float(found(np.linspace(near - 1e-3, near + 1e-3, 2001))[0].max())

    law = block("function", expression="f(u1)", **TABLE)
    signals = {"r": make("step", {"amplitude": 1.5})}
    wanted = {"peak": MetricRequest(metric="peak", signals=signals, output="y", duration=6.0)}
    found = influence(tabled(law), wanted, ["top"]).elasticities["peak"]["top"]
    assert found.method is Method.EXACT
    assert found.value == pytest.approx((peak(1.2012) - peak(1.1988)) / 0.0024 * 1.2 / peak(1.2), rel=1e-5)


def test_equations_of_the_user_have_tables_too():
    """x' = f(r - x) + f(x)/2."""
    law = block("user_equations", equations="x' = f(r - x) + 0.5*f(x)", inputs=["r"], outputs=["x"], **TABLE)
    found = run(diagram({"p": law}, ["r -> p"], {"x": "p"}, top=1.2), 3.0, amplitude=3.0)

    def rates(_: float, x: np.ndarray) -> np.ndarray:
        return np.asarray(interpolated(3.0 - x) + 0.5 * interpolated(x))

    wanted = solve_ivp(
        rates, (0, 3.0), [0.0], method="DOP853", t_eval=found.time, rtol=1e-11, atol=1e-12, max_step=0.005
    )
    np.testing.assert_allclose(found.curves["x"], wanted.y[0], atol=1e-7)


def test_an_angle_goes_round():
    """(cos 2t, sin 2t) of an oscillator at rest at (1, 0): the angle 2t, back to -π at its half turn."""
    made = diagram(
        {
            "x": block("transfer_function", numerator=[1.0, 0.0, 0.0], denominator=[1, 0, 4.0]),
            "v": block("transfer_function", numerator=[2.0, 0.0], denominator=[1, 0, 4.0]),
            "a": block("function", expression="atan2(u2, u1)"),
        },
        ["r -> x", "r -> v", "x -> a.u1", "v -> a.u2"],
        {"angle": "a"},
    )
    found = run(made, 4.0)
    away = np.abs(np.mod(2 * found.time, 2 * np.pi) - np.pi) > 1e-6
    np.testing.assert_allclose(found.curves["angle"][away], np.angle(np.exp(2j * found.time))[away], atol=1e-9)


def test_a_function_is_linearised_by_its_slope():
    """exp(u1)/(1 + u2²) about (0, 0): slopes 1 and 0."""
    made = diagram(
        {"f": block("function", expression="exp(u1)/(1 + u2**2) + atan(3*u2)"), "g": block("transfer_function", numerator=[1.0], denominator=[1, 1])},
        ["r -> f.u1", "r -> f.u2", "f -> g"], {"y": "g"},
    )  # fmt: skip
    w = np.array([0.1, 1.0, 5.0])
    found = frequency_response(made, source="r", target="y", frequencies=w)
    np.testing.assert_allclose(found.response, 4 / (1 + 1j * w), rtol=1e-12)


def test_a_switch_changes_over_at_its_threshold():
    """x' = 1 until x = 0.5, then x' = -x."""
    made = diagram(
        {
            "s": block("switch", threshold=0.5),
            "n": block("gain", gain=-1.0),
            "x": block("integrator"),
            "t": block("integrator"),
        },
        ["r -> t", "t -> s.control", "n -> s.in1", "r -> s.in2", "s -> x", "x -> n"],
        {"y": "x"},
    )
    found = run(made, 2.0)
    t = found.time
    np.testing.assert_allclose(found.curves["y"], np.where(t < 0.5, t, 0.5 * np.exp(0.5 - t)), atol=1e-11)


def test_a_bias_is_added():
    """x' = 1 + 0.5 - x from 0: x = 1.5 (1 - e^-t)."""
    made = diagram(
        {"b": block("bias", bias=0.5), "g": block("transfer_function", numerator=[1.0], denominator=[1, 1])},
        ["r -> b", "b -> g"], {"y": "g"},
    )  # fmt: skip
    found = run(made, 3.0)
    np.testing.assert_allclose(found.curves["y"], 1.5 * (1 - np.exp(-found.time)), atol=1e-11)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"expression": "2*x"}, "expression must use only u1, constants and tables, got 'x'"),
        ({"expression": "3"}, "expression must use an input"),
        ({"expression": "sin(u1"}, "expected '\\)'"),
        ({"expression": "u1 +"}, "end of the expression"),
        ({"expression": "max(u1)"}, "max takes 2 argument"),
        ({"expression": "sin(u1, u2)"}, "sin takes 1 argument"),
        ({"expression": "open(u1)"}, "unknown function 'open'"),
        ({"expression": "u65"}, "at most u64"),
        ({"expression": "u1*c", "constants": ["c"]}, "as many as constants"),
        ({"expression": "u1*u2", "constants": ["u2"], "values": [1.0]}, "names of their own"),
        ({"expression": "u1*pi", "constants": ["pi"], "values": [1.0]}, "names of their own"),
        ({"expression": "+".join(["abs(u1)"] * 65)}, "at most 64"),
        ({"expression": "f(u1)", "tables": ["f"], "table_points": [[0.0, 1.0]]}, "table_values must be as many as tables"),
        ({"expression": "f(u1)", **TABLE, "table_points": [[0.0]]}, "table_points of f must be at least 2, got 1"),
        ({"expression": "f(u1)", **TABLE, "table_points": [[0.0, 1.0]]}, r"as many as its points \(2\), got 4"),
        ({"expression": "f(u1)", **TABLE, "table_points": [[0.0, 1.0, 1.0, 2.0]]}, "must increase, got 1 after 1"),
        ({"expression": "f(u1, 2)", **TABLE}, "f takes 1 argument"),
        ({"expression": "f(u1) + f", **TABLE}, "got 'f'|after f"),
        ({"expression": "g(u1)", **TABLE}, r"unknown function 'g' \(known: .*atan2, f\)"),
        ({"expression": "sin(u1)", **TABLE, "tables": ["sin"]}, "tables must have names of their own, got 'sin'"),
    ],
)  # fmt: skip
def test_what_is_no_function_is_refused_in_words(values, message):
    with pytest.raises(EngineError, match=message):
        diagram({"f": block("function", **values)}, ["r -> f"], {"y": "f"}, top=1.0)


@pytest.mark.parametrize("expression", ["log(u1 - 2)", "sqrt(u1 - 2)", "1/(u1 - u1)", "log(-1)*u1", "asin(u1 + 2)"])
def test_what_has_no_value_gives_no_number(expression):
    made = diagram(
        {"f": block("function", expression=expression), "x": block("integrator")}, ["r -> f", "f -> x"], {"y": "x"}
    )
    found = run(made, 1.0)
    assert found.verdict is not Verdict.OK
    assert any("f has no value" in warning.detail for warning in found.warnings)
    assert all(metric.value is None for metric in found.metrics["y"].values())


@pytest.mark.parametrize("expression", ["sqrt(0.5 - u1)", "1/(1 - u1)", "log(-u1)"])
def test_an_output_without_a_value_is_found_without_any_state(expression):
    found = run(diagram({"f": block("function", expression=expression)}, ["r -> f"], {"y": "f"}), 1.0)
    assert found.verdict is Verdict.DOUBTFUL
    assert all(metric.value is None for metric in found.metrics["y"].values())
    assert "f has no value" in found.metrics["y"]["peak"].advice


POLES = {
    "1/(0.25 - u1)": lambda t: 1 / (0.25 - t),
    "1/(0.25 - u1)**2": lambda t: 1 / (0.25 - t) ** 2,
    "(u1 - 0.25)**(-3)": lambda t: (t - 0.25) ** -3,
    "tan(2*pi*u1)": lambda t: np.tan(2 * np.pi * t),
    "log(0.25 - u1)": lambda t: np.log(0.25 - t),
    "sqrt(0.25 - u1)": lambda t: np.sqrt(0.25 - t),
}


@pytest.mark.parametrize("expression", POLES)
@pytest.mark.parametrize("lag", [False, True])
def test_a_run_ends_where_a_law_goes_to_infinity(expression, lag):
    """1/(0.25 - t) has no value at 0.25 s, and no response goes beyond; what was before it stays right."""
    blocks = {"f": block("function", expression=expression)}
    wires = ["r -> f"]
    if lag:
        blocks["lag"] = block("transfer_function", numerator=[1.0], denominator=[0.1, 1.0])
        wires.append("f -> lag")
    made = diagram(blocks, wires, {"y": "f", **({"z": "lag"} if lag else {})})
    found = run(made, 1.0, "ramp", slope=1.0)
    assert found.verdict is not Verdict.OK
    assert all(metric.value is None for metrics in found.metrics.values() for metric in metrics.values())
    assert any("0.25 s" in warning.detail for warning in found.warnings), found.warnings
    before = found.time < 0.249
    np.testing.assert_allclose(found.curves["y"][before], POLES[expression](found.time[before]), rtol=1e-8, atol=1e-10)
    assert np.isnan(found.curves["y"][found.time > 0.2501]).all()


def test_a_quotient_of_two_zeros_is_passed():
    made = diagram({"f": block("function", expression="sin(u1 - 0.25)/(u1 - 0.25)")}, ["r -> f"], {"y": "f"})
    found = run(made, 1.0, "ramp", slope=1.0)
    assert found.verdict is Verdict.OK
    np.testing.assert_allclose(found.curves["y"], np.sinc((found.time - 0.25) / np.pi), rtol=1e-12)


def test_equations_of_the_user_are_the_same_as_blocks():
    """The pendulum with drag again, in three statements."""
    law = block(
        "user_equations", equations="drag = c*w*abs(w)\na' = w\nw' = torque - 9.81*sin(a)/l - drag", inputs=["torque"],
        outputs=["a", "w", "drag"], constants=["l", "c"], values=["=l", "=c"],
    )  # fmt: skip
    outputs = {"angle": "p.a", "speed": "p.w", "drag": "p.drag"}
    made = diagram({"p": law}, ["r -> p"], outputs, l=0.7, c=0.4)
    found = run(made, 4.0, amplitude=20.0)
    angle, speed = reference(found.time, 20.0)
    np.testing.assert_allclose(found.curves["angle"], angle, atol=1e-8)
    np.testing.assert_allclose(found.curves["drag"], 0.4 * speed * np.abs(speed), atol=1e-7)


def test_a_ball_bounces():
    """From 1 m, 0.8 of the speed after each impact: impacts at t1, t1 (1 + 2 0.8), ... with t1 = sqrt(2/g)."""
    law = block(
        "user_equations", equations="h(0) = 1; h' = v; v' = -g; when h < 0: h = 0, v = -e*v", outputs=["h", "v"],
        constants=["g", "e"], values=[9.81, 0.8],
    )  # fmt: skip
    made = diagram({"ball": law}, [], {"h": "ball.h", "v": "ball.v"})
    found = run(made, 2.0)
    first = np.sqrt(2 / 9.81)
    impacts = [first, first * 2.6, first * (2.6 + 1.28)]
    speeds = [9.81 * first * 0.8**k for k in range(3)]
    expected = np.where(found.time < impacts[0], 1 - 0.5 * 9.81 * found.time**2, 0.0)
    for k in range(3):
        end = impacts[k + 1] if k < 2 else impacts[2] + 2 * 0.8 * speeds[2] / 9.81
        s = found.time - impacts[k]
        inside = (s >= 0) & (found.time < end)
        expected = np.where(inside, 0.8 * speeds[k] * s - 0.5 * 9.81 * s * s, expected)
    known = found.time < impacts[2] + 2 * 0.8 * speeds[2] / 9.81
    np.testing.assert_allclose(found.curves["h"][known], expected[known], atol=1e-10)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"equations": "x' = y", "outputs": ["x"]}, "equations must use only x, constants and tables, got 'y'"),
        ({"equations": "x'' = 1", "outputs": ["x"]}, "a statement must be x' = "),
        ({"equations": "x' = 1; x' = 2", "outputs": ["x"]}, "more than one equation"),
        ({"equations": "x' = 1", "outputs": ["y"]}, "outputs must be among what the equations give \\(x\\), got 'y'"),
        ({"equations": "x' = 1; y(0) = 2", "outputs": ["x"]}, "y\\(0\\) has no rate"),
        ({"equations": "x' = 1; x(0) = x", "outputs": ["x"]}, "x\\(0\\) must use constants only, got 'x'"),
        ({"equations": "x' = 1; when x > 1: y = 0", "outputs": ["x"]}, "resets 'y', which is no state"),
        ({"equations": "x' = 1; when x: x = 0", "outputs": ["x"]}, "an event must be"),
        ({"equations": "x' = sin(", "outputs": ["x"]}, "expected a number"),
        ({"equations": "y = y + 1", "outputs": ["y"]}, "got 'y'"),
        ({"equations": "x' = u", "inputs": ["u"], "outputs": ["x"], "constants": ["u"], "values": [1]}, "names of their own"),
        ({"equations": "x' = 1", "outputs": []}, "one at least"),
    ],
)  # fmt: skip
def test_equations_that_cannot_be_are_refused_in_words(values, message):
    with pytest.raises(EngineError, match=message):
        diagram({"p": block("user_equations", **values)}, [], {"y": "p"})
