"""Realisation: the interconnection against closed forms, algebraic loops, cut loops and derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from engine.diagram.diagram import compile_system
from engine.model.errors import DiagramError, ExpressionError, IllPosedError
from tests.unit.engine.diagrams import block, document, response, subsystem

S = (0.3j, 2.0 + 1.0j, 40.0j)
STEP = 1e-30


def feedback(gain: float):
    """r -> error -> gain -> y with negative feedback through nothing: y = gain/(1 + gain) r."""
    return document(
        {"r": block("input"), "error": block("sum", signs="+-"), "gain": block("gain", gain="=k")},
        ["r -> error.in1", "gain -> error.in2", "error -> gain"],
        {"y": "gain", "e": "error"},
        k=gain,
    )


def servo(**parameters: float):
    """A loop with everything in it: PID, delay, valve, motor, sensor lag, and a load on the motor."""
    given = {"kp": 0.02, "ki": 0.004, "m": 300.0, "dead_time": 0.01} | parameters
    return document(
        {
            "reference": block("input"),
            "load": block("input", role="disturbance"),
            "error": block("sum", signs="+-"),
            "controller": block("pid", kp="=kp", ki="=ki", kd="=kp/20", filter_frequency=100),
            "wait": block("delay", time="=dead_time"),
            "valve": block("proportional_valve", flow_gain=1.0, natural_frequency=300.0, damping_ratio=0.8),
            "motor": block("linear_pneumatic_motor", mass="=m"),
            "sensor": block("transfer_function", numerator=[1], denominator=[0.001, 1]),
        },
        [
            "reference -> error.in1", "sensor -> error.in2", "error -> controller", "controller -> wait",
            "wait -> valve", "valve -> motor.flow", "load -> motor.force", "motor.position -> sensor",
        ],
        {"position": "motor.position", "acceleration": "motor.acceleration", "control": "controller", "e": "error"},
        **given,
    )  # fmt: skip


def servo_parts(s: complex) -> tuple[complex, complex, complex]:
    """Return (forward path, load path, sensor) of `servo` in closed form."""
    c = 0.02 + 0.004 / s + 0.001 * s / (1 + s / 100)
    valve = 1 / (1 + 1.6 * s / 300 + (s / 300) ** 2)
    capacitance, area, leak, mass, friction = 750e-6 / (1.4 * 5e5), 65e-4, 0.4e-11, 300.0, 1200.0
    bracket = capacitance * mass * s**2 + (capacitance * friction + mass * leak) * s + area**2 + leak * friction
    plant, load = area / (s * bracket), -(capacitance * s + leak) / (s * bracket)
    return c * np.exp(-0.01 * s) * valve * plant, load, 1 / (1 + 0.001 * s)


def test_a_well_posed_feed_through_loop_is_solved():
    # 0.5/(1 + 0.5) = 1/3 (python-control 0.10.2: `interconnect` raises, `feedback` gives D = 1/3)
    system = compile_system(feedback(0.5)).realize()
    np.testing.assert_allclose(system.d11[:, 0], [1 / 3, 2 / 3], rtol=1e-15)
    assert system.a.shape == (0, 0)


@pytest.mark.parametrize("gain", [1e-9, 1e9, -0.999999, -1.000001, 1e30])
def test_algebraic_loops_of_any_gain(gain):
    system = compile_system(feedback(gain)).realize()
    np.testing.assert_allclose(
        system.d11[:, 0], [gain / (1 + gain), 1 / (1 + gain)], rtol=1e-15 / abs(1 / gain + 1) + 4e-16
    )


def test_an_ill_posed_loop_is_named_by_its_ports():
    with pytest.raises(IllPosedError, match=r"error\.out -> gain\.out -> error\.out") as caught:
        compile_system(feedback(-1.0))
    assert caught.value.ports == ("error.out", "gain.out")
    assert caught.value.at == ("blocks", "error")


def test_a_loop_whose_coefficient_overflows_is_refused():
    law = block("pd", kp=1.0, kd="=k", filter_frequency=1e10)
    diagram = compile_system(
        document({"r": block("input"), "e": block("sum", signs="+-"), "c": law},
                 ["r -> e.in1", "c -> e.in2", "e -> c"], {"y": "c"}, k=1.0)
    )  # fmt: skip
    with pytest.raises(DiagramError, match=r"c.kd must be <= 1e\+100 in size, got 1e\+305"):
        diagram.realize({"k": 1e305})
    assert diagram.realize_stack({"k": np.array([1e305, 1.0, 2.0])}).valid.tolist() == [False, True, True]


def test_a_chain_whose_gain_overflows_is_refused():
    names = ["a", "b", "c", "d"]
    diagram = compile_system(
        document({"r": block("input"), **{name: block("gain", gain="=k") for name in names}},
                 ["r -> a", "a -> b", "b -> c", "c -> d"], {"y": "d"}, k=1.0)
    )  # fmt: skip
    with pytest.raises(DiagramError, match="finite"):
        diagram.realize({"k": 1e90})  # 1e360 in all
    assert diagram.realize_stack({"k": np.array([1e90, 1.0, 2.0])}).valid.tolist() == [False, True, True]


def test_units_of_a_loop_do_not_make_it_ill_posed():
    # 1e12 · 0.5e-12 = 0.5: the equations look singular (condition 1e24) until they are balanced.
    diagram = compile_system(
        document(
            {"r": block("input"), "error": block("sum", signs="+-"), "up": block("gain", gain=1e12),
             "down": block("gain", gain=0.5e-12)},
            ["r -> error.in1", "down -> error.in2", "error -> up", "up -> down"],
            {"y": "down"},
        )
    )  # fmt: skip
    assert diagram.realize().d11[0, 0] == pytest.approx(1 / 3, rel=1e-15)


def test_an_open_chain_of_feed_through_is_exact():
    # Followed in topological order there is one multiplication for each gain, and nothing is solved.
    gains = [0.1, 3.0, 0.7, 1e-8, 5e7, 0.3]
    blocks = {"u": block("input")} | {f"g{i}": block("gain", gain=g) for i, g in enumerate(gains)}
    names = list(blocks)
    wires = [f"{a} -> {b}" for a, b in zip(names[::-1][1:], names[::-1], strict=False)]
    expected = 1.0
    for gain in gains:
        expected = expected * gain
    system = compile_system(document(blocks, wires[::-1], {"y": names[-1]})).realize()
    assert system.d11[0, 0] == expected


@pytest.mark.parametrize("s", S)
def test_servo_loop(s):
    system = compile_system(servo()).realize()
    forward, load, sensor = servo_parts(s)
    closed = 1 / (1 + forward * sensor)
    assert len(system.a) == 8  # 2 PID, 2 valve, 3 motor, 1 sensor: nothing is added, nothing has to cancel
    assert system.delays.tolist() == [0.01]
    for output, source, expected in [
        ("position", "reference", forward * closed),
        ("acceleration", "reference", s**2 * forward * closed),
        ("e", "reference", closed),
        ("position", "load", load * closed),
        ("e", "load", -load * sensor * closed),
    ]:
        np.testing.assert_allclose(response(system, s, output, source), expected, rtol=1e-11)


@pytest.mark.parametrize("cut", ["error", "error.out", "controller", "wait", "motor.position", "sensor"])
@pytest.mark.parametrize("s", S)
def test_a_loop_cut_anywhere_has_the_same_loop_transfer_function(cut, s):
    system = compile_system(servo()).realize(open_at=cut)
    forward, _, sensor = servo_parts(s)
    assert system.inputs == ("reference", "load", "loop")
    np.testing.assert_allclose(-response(system, s, "loop", "loop"), forward * sensor, rtol=1e-11)


def test_outputs_keep_reading_the_true_signal_of_a_cut():
    system = compile_system(servo()).realize(open_at="error")
    s = 2j
    # e = r - sensor·position with the loop cut: the reference reaches e directly and nothing comes back.
    np.testing.assert_allclose(response(system, s, "e", "reference"), 1.0, rtol=1e-15)
    np.testing.assert_allclose(response(system, s, "loop", "reference"), 1.0, rtol=1e-15)
    np.testing.assert_allclose(response(system, s, "e", "loop"), response(system, s, "loop", "loop"), rtol=1e-15)


def test_all_consumers_of_a_cut_output_are_fed_by_the_injected_signal():
    diagram = compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+--"), "a": block("gain", gain=2.0), "b": block("gain", gain=3.0),
             "lag": block("transfer_function", numerator=[1], denominator=[1, 1])},
            ["r -> e.in1", "a -> e.in2", "b -> e.in3", "lag -> a", "lag -> b", "e -> lag"],
            {"y": "lag"},
        )
    )  # fmt: skip
    system = diagram.realize(open_at="lag")
    np.testing.assert_allclose(-response(system, 1j, "loop", "loop"), 5 / (1 + 1j), rtol=1e-15)


def cascade():
    """A velocity loop inside a position loop: the subsystem's output `v` is used inside and outside."""
    inner = document(
        {"ref": block("input"), "error": block("sum", signs="+-"), "drive": block("pi", kp="=kv", ki=2.0),
         "mass": block("transfer_function", numerator=[1], denominator=[0.5, 0.1])},
        ["ref -> error.in1", "mass -> error.in2", "error -> drive", "drive -> mass"],
        {"v": "mass"},
        kv=3.0,
    )  # fmt: skip
    return document(
        {"r": block("input"), "error": block("sum", signs="+-"), "kp": block("gain", gain=4.0), "velocity": subsystem(inner),
         "integral": block("integrator")},
        ["r -> error.in1", "integral -> error.in2", "error -> kp", "kp -> velocity.ref", "velocity.v -> integral"],
        {"x": "integral", "v": "velocity.mass", "v_again": "velocity"},
    )  # fmt: skip


@pytest.mark.parametrize("s", S)
def test_subsystems_are_wired_through(s):
    diagram = compile_system(cascade())
    inner_open = (3 + 2 / s) / (0.5 * s + 0.1)
    inner = inner_open / (1 + inner_open)
    x = 4 * inner / s / (1 + 4 * inner / s)
    system = diagram.realize()
    np.testing.assert_allclose(response(system, s, "x", "r"), x, rtol=1e-12)
    np.testing.assert_allclose(response(system, s, "v", "r"), s * x, rtol=1e-12)
    np.testing.assert_allclose(response(system, s, "v_again", "r"), s * x, rtol=1e-12)


@pytest.mark.parametrize("s", S)
def test_cuts_at_and_inside_a_subsystem(s):
    diagram = compile_system(cascade())
    inner_open = (3 + 2 / s) / (0.5 * s + 0.1)
    outer_open = 4 * inner_open / (1 + inner_open) / s

    def loop(cut: str) -> complex:
        return -response(diagram.realize(open_at=cut), s, "loop", "loop")

    # At the subsystem's port only the outer loop is cut; the velocity loop inside stays closed.
    np.testing.assert_allclose(loop("velocity.v"), outer_open, rtol=1e-11)
    np.testing.assert_allclose(loop("velocity"), outer_open, rtol=1e-11)
    np.testing.assert_allclose(loop("velocity.ref"), outer_open, rtol=1e-11)
    # At the block inside, its use inside and outside is cut: both loops come back in one.
    np.testing.assert_allclose(loop("velocity.mass"), inner_open * (1 + 4 / s), rtol=1e-11)
    # At the inner error only the velocity loop is cut, with the position loop closed around it.
    np.testing.assert_allclose(loop("velocity.error"), inner_open * (1 + 4 / s), rtol=1e-11)


@pytest.mark.parametrize("s", S)
def test_four_nested_loops_have_the_order_of_their_blocks(s):
    # By division of transfer functions such a structure has order 61 in place of 9 (python-control 0.10.2).
    blocks = {"r": block("input")}
    wires = []
    plant, expected = "u0", None
    blocks["u0"] = block("transfer_function", numerator=[2], denominator=[0.1, 1])
    expected = 2 / (0.1 * s + 1)
    inner_input = "u0"
    for k, (kp, ki, lag) in enumerate(
        [(3.0, 5.0, 0.01), (2.0, 1.0, 0.02), (1.5, 0.7, 0.03), (0.9, 0.4, 0.04)], start=1
    ):
        blocks |= {
            f"e{k}": block("sum", signs="+-"),
            f"c{k}": block("pi", kp=kp, ki=ki),
            f"h{k}": block("transfer_function", numerator=[1], denominator=[lag, 1]),
        }
        wires += [f"{plant} -> h{k}", f"h{k} -> e{k}.in2", f"e{k} -> c{k}"]
        wires.append(f"c{k} -> {inner_input}" if k == 1 else f"c{k} -> {inner_input}.in1")
        inner_input = f"e{k}"
        forward = (kp + ki / s) * expected
        expected = forward / (1 + forward / (1 + lag * s))
    wires.append("r -> e4.in1")
    system = compile_system(document(blocks, wires, {"y": "u0"})).realize()
    assert len(system.a) == 9
    np.testing.assert_allclose(response(system, s, "y", "r"), expected, rtol=1e-12)


def test_overrides_reach_everything_that_depends_on_them():
    diagram = compile_system(servo())
    fresh = compile_system(servo(kp=0.03, m=200.0)).realize()
    varied = diagram.realize({"kp": 0.03, "m": 200.0})
    for name in ("a", "b1", "b2", "c1", "c2", "d11", "d12", "d21", "d22", "delays"):
        np.testing.assert_array_equal(getattr(varied, name), getattr(fresh, name))


def test_integral_gain_and_delay_of_0_change_the_structure():
    diagram = compile_system(servo())
    system = diagram.realize({"ki": 0.0, "dead_time": 0.0})
    assert (len(system.a), len(system.delays)) == (7, 0)


@pytest.mark.parametrize("path", ["kp", "ki", "m", "dead_time", "motor.area", "valve.damping_ratio"])
@pytest.mark.parametrize("open_at", [None, "error"])
def test_infinitesimals_give_the_derivative_of_every_matrix(path, open_at):
    diagram = compile_system(servo())
    value = diagram.parameters[path].value
    stepped = diagram.realize({path: value * (1 + STEP * 1j)}, open_at=open_at)
    h = 1e-5
    up, down = (diagram.realize({path: value * (1 + sign * h)}, open_at=open_at) for sign in (1, -1))
    changed = 0
    for name in ("a", "b1", "b2", "c1", "c2", "d11", "d12", "d21", "d22", "delays"):
        exact, difference = getattr(stepped, name).imag / STEP, (getattr(up, name) - getattr(down, name)) / (2 * h)
        np.testing.assert_allclose(exact, difference, rtol=1e-7, atol=1e-8 * np.abs(difference).max(initial=0.0))
        changed += int(np.count_nonzero(exact))
    assert changed > 0


def test_the_derivative_goes_through_an_algebraic_loop():
    system = compile_system(feedback(0.5)).realize({"k": 0.5 * (1 + STEP * 1j)})
    # d/dk k/(1 + k) = 1/(1 + k)², times k for the relative step
    assert system.d11[0, 0].imag / STEP == pytest.approx(0.5 / 1.5**2, rel=1e-15)


def test_integrators_start_at_their_initial_values():
    diagram = compile_system(
        document({"u": block("input"), "x": block("integrator", initial="=x0")}, ["u -> x"], {"y": "x"}, x0=2.0)
    )
    assert diagram.realize({"x0": 3.0}).x0.tolist() == [3.0]
    assert diagram.realize_stack({"x0": np.array([3.0, 4.0])}).x0.tolist() == [[3.0], [4.0]]
    assert diagram.realize({"x0": 3.0 + STEP * 1j}).x0.imag.tolist() == [STEP]


@pytest.mark.parametrize(
    ("overrides", "error", "message"),
    [
        ({"speed": 1.0}, DiagramError, "parameter must be one of the system's .*got 'speed'"),
        ({"motor.mass": 1.0}, DiagramError, "motor.mass must not be varied: the expression '=m' gives its value"),
        ({"kp": float("nan")}, DiagramError, "kp must be finite"),
        ({"m": -1.0}, DiagramError, r"motor.mass must be > 0 kg, got -1"),
        ({"m": 1e-320}, DiagramError, "motor.mass must be >= 1e-100 kg, got 9.99989e-321"),
    ],
)
def test_refuses_overrides(overrides, error, message):
    with pytest.raises(error, match=message):
        compile_system(servo()).realize(overrides)


def test_refuses_a_value_at_which_an_expression_has_none():
    diagram = compile_system(document({"g": block("gain", gain="=1/k")}, [], {"y": "g"}, k=1.0))
    with pytest.raises(ExpressionError, match="divides by zero") as caught:
        diagram.realize({"k": 0.0})
    assert caught.value.at == ("blocks", "g", "gain")


def test_refuses_to_open_what_is_not_there():
    diagram = compile_system(servo())
    for cut in ("nothing", "motor", "motor.flow", "error.in1", ""):
        with pytest.raises(DiagramError) as caught:
            diagram.realize(open_at=cut)
        assert caught.value.at == ("open_at",)


def test_the_shared_base_cannot_be_written():
    system = compile_system(servo()).realize()
    with pytest.raises(ValueError, match="read-only"):
        system.a[0, 0] = 1.0
