"""Control laws, corrections, sensors and structure: what they refuse, which ports they have, which states they need."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from engine.diagram.diagram import compile_system
from engine.elements import Realization, catalogue
from engine.model.errors import DiagramError
from tests.unit.engine.diagrams import block, document, response, subsystem


def realized(kind: str, **given: Any) -> Realization:
    element = catalogue()[kind]
    values = {param.name: param.default for param in element.parameters} | given
    element.check(frozenset(given), values)
    return element.realize(values)


def refused(kind: str, **given: Any) -> DiagramError:
    """Compile a diagram with this block alone, so that bounds and shapes are checked as well."""
    with pytest.raises(DiagramError) as caught:
        compile_system(document({"part": block(kind, **given)}, outputs={}))
    return caught.value


@pytest.mark.parametrize(
    ("kind", "given", "at", "message"),
    [
        ("lead_lag", {"zero_frequency": 0.0, "pole_frequency": 1.0}, ("zero_frequency",), "must be > 0 rad/s, got 0"),
        ("lead_lag", {"zero_frequency": 1.0, "pole_frequency": -2.0}, ("pole_frequency",), "must be > 0 rad/s, got -2"),
        ("lead_lag", {"zero_frequency": 1.0}, ("pole_frequency",), "must be given"),
        ("notch", {"frequency": 10.0, "depth": 1.5}, ("depth",), "must be >= 0 and <= 1, got 1.5"),
        ("notch", {"frequency": 10.0, "depth": -0.1}, ("depth",), "must be >= 0 and <= 1, got -0.1"),
        ("notch", {"frequency": 10.0, "width": 0.0}, ("width",), "must be > 0, got 0"),
        ("notch", {"frequency": [10.0]}, ("frequency",), "must be a number or an expression"),
        ("low_pass", {"frequency": 10.0, "order": 0}, ("order",), "must be a whole number >= 1 and <= 8, got 0"),
        ("low_pass", {"frequency": 10.0, "order": 9}, ("order",), "must be a whole number >= 1 and <= 8, got 9"),
        ("low_pass", {"frequency": 10.0, "order": 2.5}, ("order",), "must be a whole number >= 1 and <= 8, got 2.5"),
        ("low_pass", {"frequency": 10.0, "order": True}, ("order",), "whole number"),
        ("low_pass", {"frequency": 10.0, "order": "=n"}, ("order",), "whole number .* got =n"),
        ("low_pass", {"frequency": 10.0, "order": float("inf")}, ("order",), "whole number"),
        ("low_pass", {"frequency": 10.0, "order": 3, "damping_ratio": 0.5}, ("damping_ratio",), "absent unless"),
        ("derivative", {"gain": 1.0}, ("filter_frequency",), "must be given"),
        ("feed_forward", {"kv": 1.0}, ("filter_frequency",), "must be given"),
        ("feed_forward", {"filter_frequency": 1.0, "filter_damping": 0.0}, ("filter_damping",), "must be > 0"),
        ("pd2", {"kp": 1.0, "filter_frequency": 0.0}, ("filter_frequency",), "must be > 0 rad/s"),
        ("pid", {"kp": 1.0, "integral_time": 0.0, "filter_frequency": 9.0}, ("integral_time",), "must be > 0 s"),
        ("pid", {"kp": 1.0, "derivative_time": -1.0, "filter_frequency": 9.0}, ("derivative_time",), "must be >= 0 s"),
        ("pid", {"kp": 1.0, "kd": 1.0, "derivative_time": 1.0, "filter_frequency": 9.0}, ("derivative_time",), "absent"),
        ("first_order_sensor", {"time_constant": 0.0}, ("time_constant",), "must be > 0 s, got 0"),
        ("accelerometer", {"sensitivity": 1.0}, ("natural_frequency",), "must be given"),
        ("accelerometer", {"natural_frequency": 9.0, "damping_ratio": -1.0}, ("damping_ratio",), "must be >= 0"),
        ("accelerometer", {"natural_frequency": 9.0, "high_pass_frequency": 0.0}, ("high_pass_frequency",), "> 0 rad/s"),
        ("velocity_transducer", {"damping_ratio": 0.5}, ("damping_ratio",), "absent where no natural_frequency"),
        ("velocity_transducer", {"bandwidth": 0.0}, ("bandwidth",), "must be > 0 rad/s"),
        ("rc_network", {"r1": 1e3, "c2": 1e-6}, ("network",), "must be given"),
        ("rc_network", {"network": "bridge", "r1": 1e3}, ("network",), "one of low_pass, high_pass, lead, lag, lead_lag"),
        ("rc_network", {"network": "lead", "r1": 1e3, "c1": 1e-6}, ("r2",), "given: a lead network has r1 and c1 and r2"),
        ("rc_network", {"network": "low_pass", "r1": 1.0, "c1": 1.0, "c2": 1.0}, ("c1",), "absent: a low_pass network"),
        ("rc_network", {"network": "low_pass", "r1": 0.0, "c2": 1e-6}, ("r1",), "must be > 0 ohm, got 0"),
        ("rc_network", {"network": "low_pass", "r1": 1e3, "c2": -1e-6}, ("c2",), "must be > 0 F, got -1e-06"),
        ("state_space", {"A": [], "B": [], "C": [], "D": [[1.0]], "inputs": ["a", "b"]}, ("inputs",), "1 different"),
        ("state_space", {"A": [], "B": [], "C": [], "D": [[1.0, 2.0]], "inputs": ["a", "a"]}, ("inputs",), "2 different"),
        ("state_space", {"A": [], "B": [], "C": [], "D": [[1.0]], "outputs": []}, ("outputs",), "got none"),
        ("state_space", {"A": [], "B": [], "C": [], "D": [[1.0]], "outputs": ["a b"]}, ("outputs", 0), "must be a letter"),
        ("state_space", {"A": [], "B": [], "C": [], "D": [[1.0]], "outputs": [1]}, ("outputs", 0), "must be a name"),
        ("state_space", {"A": [], "B": [], "C": [], "D": [[1.0]], "outputs": "y"}, ("outputs",), "must be a list"),
        ("state_space", {"A": [[1.0, 2.0]], "B": [[1.0]], "C": [[1.0]], "D": [[0.0]]}, ("A",), "1 x 1 .* got 1 x 2"),
        ("state_space", {"A": [[1.0]], "B": [[1.0]], "C": [[1.0, 2.0]], "D": [[0.0]]}, ("C",), "1 x 1 .* got 1 x 2"),
        ("state_space", {"A": [[1.0]], "B": [[1.0], [2.0]], "C": [[1.0]], "D": [[0.0]]}, ("B",), "1 x 1 .* got 2 x 1"),
        ("state_space", {"A": [[1.0], [1.0, 2.0]], "B": [], "C": [], "D": [[0.0]]}, ("A", 1), "rows of equal length"),
        ("transfer_function", {"numerator": [1, 0, 0], "denominator": [1, 1]}, ("numerator",), "improper"),
        ("transfer_function", {"numerator": [], "denominator": []}, ("denominator",), "other than 0"),
        ("transfer_function", {"numerator": 1.0, "denominator": [1.0]}, ("numerator",), "must be a list"),
        ("zero_pole_gain", {"poles": [[1.0, 2.0, 3.0]]}, ("poles", 0), "a number or \\[re, im\\]"),
        ("zero_pole_gain", {"zeros": [1.0, 2.0], "poles": [-1.0]}, ("zeros",), "improper"),
        ("sum", {"signs": "+" * 65}, ("signs",), "1 to 64"),
        ("sum", {"signs": 5}, ("signs",), "must be a text"),
        ("delay", {"time": -1e-3}, ("time",), "must be >= 0 s"),
        ("gain", {}, ("gain",), "must be given"),
    ],
)  # fmt: skip
def test_refuses(kind, given, at, message):
    error = refused(kind, **given)
    assert error.at[:2] == ("blocks", "part")
    assert error.at[2:] == at
    with pytest.raises(DiagramError, match=message):
        raise error


@pytest.mark.parametrize("order", range(1, 9))
def test_the_order_of_a_low_pass_is_its_number_of_states(order):
    assert len(realized("low_pass", frequency=10.0, order=order).a) == order


def test_an_order_may_be_written_as_2_point_0():
    diagram = compile_system(
        document({"filter": block("low_pass", frequency=10.0, order=2.0)}, outputs={"y": "filter"})
    )
    assert diagram.realize().states == 2


def test_an_order_is_no_parameter_that_can_be_varied():
    diagram = compile_system(document({"filter": block("low_pass", frequency=10.0, order=2)}, outputs={"y": "filter"}))
    assert list(diagram.parameters) == ["filter.frequency"]
    with pytest.raises(DiagramError, match=r"got 'filter\.order'"):
        diagram.realize({"filter.order": 3.0})


@pytest.mark.parametrize(
    ("given", "states"),
    [
        ({"network": "low_pass", "r1": 1.0, "c2": 1.0}, 1),
        ({"network": "high_pass", "c1": 1.0, "r2": 1.0}, 1),
        ({"network": "lead", "r1": 1.0, "c1": 1.0, "r2": 1.0}, 1),
        ({"network": "lag", "r1": 1.0, "r2": 1.0, "c2": 1.0}, 1),
        ({"network": "lead_lag", "r1": 1.0, "c1": 1.0, "r2": 1.0, "c2": 1.0}, 2),
    ],
)
def test_a_network_has_a_state_for_each_capacitor(given, states):
    assert len(realized("rc_network", **given).a) == states


@pytest.mark.parametrize(
    ("kind", "given", "states"),
    [
        ("accelerometer", {"natural_frequency": 100.0}, 2),
        ("accelerometer", {"natural_frequency": 100.0, "high_pass_frequency": 3.0}, 3),
        ("velocity_transducer", {}, 0),
        ("velocity_transducer", {"bandwidth": 100.0}, 1),
        ("velocity_transducer", {"natural_frequency": 28.0}, 2),
        ("velocity_transducer", {"natural_frequency": 28.0, "bandwidth": 100.0}, 3),
    ],
)
def test_a_sensor_has_the_states_that_it_needs(kind, given, states):
    assert len(realized(kind, **given).a) == states


@pytest.mark.parametrize(
    ("kind", "inputs", "outputs"),
    [("accelerometer", ("acceleration",), ("signal",)), ("velocity_transducer", ("velocity",), ("signal",)),
     ("first_order_sensor", ("in",), ("out",)), ("notch", ("in",), ("out",))],
)  # fmt: skip
def test_ports(kind, inputs, outputs):
    ports = catalogue()[kind].ports(dict.fromkeys([param.name for param in catalogue()[kind].parameters]))
    assert (ports.inputs, ports.outputs) == (inputs, outputs)


# A two-axis drive x' = A x + B u with cross-coupling; its transfer matrix at s is C (s - A)^-1 B + D, by Cramer's rule.
COUPLED = {
    "A": [[-1.0, 0.5], [0.25, -2.0]], "B": [[1.0, 0.0], [0.0, 3.0]], "C": [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]],
    "D": [[0.0, 0.0], [0.0, 0.1], [0.0, 0.0]], "inputs": ["torque", "load"], "outputs": ["speed", "current", "both"],
}  # fmt: skip


def test_a_state_space_with_several_named_ports():
    system = document(
        {"torque": block("input"), "load": block("input"), "axis": block("state_space", **COUPLED)},
        ["torque -> axis.torque", "load -> axis.load"],
        {"speed": "axis.speed", "current": "axis.current", "both": "axis.both"},
    )
    linear = compile_system(system).realize()
    s = 0.3 + 2.0j
    determinant = (s + 1) * (s + 2) - 0.5 * 0.25
    speed = {"torque": (s + 2) / determinant, "load": 0.5 * 3 / determinant}
    current = {"torque": 0.25 / determinant, "load": 3 * (s + 1) / determinant}
    for source in ("torque", "load"):
        direct = 0.1 if source == "load" else 0.0
        assert response(linear, s, "speed", source) == pytest.approx(speed[source], rel=1e-14)
        assert response(linear, s, "current", source) == pytest.approx(current[source] + direct, rel=1e-14)
        assert response(linear, s, "both", source) == pytest.approx(speed[source] + current[source], rel=1e-14)


def test_a_port_of_a_state_space_that_is_not_named_does_not_exist():
    with pytest.raises(DiagramError, match=r"one of the outputs axis\.speed, axis\.current, axis\.both"):
        compile_system(document({"axis": block("state_space", **COUPLED)}, outputs={"y": "axis.out1"}))


def chain(depth: int) -> Any:
    """A lag 1/(1 + s/2^k) at every depth k in series with the system inside it, and a loop round the innermost."""
    system = document(
        {"u": block("input"), "e": block("sum", signs="+-"), "g": block("integrator", gain=3.0)},
        ["u -> e.in1", "g -> e.in2", "e -> g"],
        {"y": "g"},
    )
    for level in range(depth):
        lag = block("transfer_function", numerator=[1.0], denominator=[2.0**-level, 1.0])
        system = document(
            {"u": block("input"), "lag": lag, "inner": subsystem(system)},
            ["u -> lag", "lag -> inner"],
            {"y": "inner.y"},
        )
    return system


def expected(s: complex, depth: int) -> complex:
    return 3 / (s + 3) * np.prod([1 / (1 + s * 2.0**-level) for level in range(depth)])


@pytest.mark.parametrize("depth", [1, 20, 32])
def test_subsystems_in_subsystems(depth):
    diagram = compile_system(chain(depth))
    for s in (0.2j, 1.0 + 2.0j):
        assert response(diagram.realize(), s, "y", "u") == pytest.approx(expected(s, depth), rel=1e-12)
    innermost = ".".join(["inner"] * depth)
    assert diagram.parameters[f"{innermost}.g.gain"].value == 3.0
    cut = diagram.realize(open_at=f"{innermost}.e")
    assert response(cut, 1.0j, "loop", "loop") == pytest.approx(-3 / 1.0j, rel=1e-14)
    varied = diagram.realize({f"{innermost}.g.gain": 6.0})
    assert response(varied, 2.0, "y", "u") == pytest.approx(expected(2.0, depth) / (3 / 5) * (6 / 8), rel=1e-12)


def test_the_limit_of_depth_says_what_it_is():
    with pytest.raises(DiagramError, match="subsystems must be nested at most 32 deep, got more"):
        compile_system(chain(33))
