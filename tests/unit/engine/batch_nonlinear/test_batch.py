"""Many candidates of a nonlinear loop: what is answered, what is doubted, what is refused; threads change nothing."""

from __future__ import annotations

import numpy as np
import pytest

from engine.analysis.measuring import MetricRequest, measure
from engine.batch.nonlinear.batch import NonlinearBatch
from engine.batch.screening import Screening
from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.model.traced import UnsuitableError
from engine.signals import make

STEP = {"r": make("step", {"amplitude": 1.5})}
TIMED = ["rise_time", "settling_time", "overshoot", "peak", "peak_time", "iae"]


def loop(kind: str = "saturation", **values: object) -> Diagram:
    """Return a position loop with a law between its gain and its plant."""
    blocks = {
        "r": Block(kind="input", values={}), "error": Block(kind="sum", values={"signs": "+-"}),
        "gain": Block(kind="gain", values={"gain": "=kp"}), "law": Block(kind=kind, values=values),
        "plant": Block(kind="transfer_function", values={"numerator": [100.0], "denominator": [1.0, "=d", 0.0]}),
    }  # fmt: skip
    wires = [("r", "error.in1"), ("plant", "error.in2"), ("error", "gain"), ("gain", "law"), ("law", "plant")]
    return compile_system(
        System(
            name="loop", parameters={"kp": Parameter(value=2.0), "d": Parameter(value=12.0), "limit": Parameter(value=0.5)},
            blocks=blocks, connections=tuple(Connection(source=a, target=b) for a, b in wires),
            outputs={"y": "plant", "u": "law"},
        )
    )  # fmt: skip


def limited() -> Diagram:
    return loop(lower="=-limit", upper="=limit")


def requests(*names: str, duration: float | None = None) -> list[MetricRequest]:
    return [MetricRequest(metric=name, signals=STEP, output="y", duration=duration) for name in names]


def test_the_screening_marches_nonlinear_diagrams_and_agrees_with_the_exact_path():
    diagram, asked = limited(), requests(*TIMED)
    overrides = {"kp": np.array([1.0, 2.0, 4.0]), "limit": np.array([0.3, 0.5, 5.0])}
    found = Screening(diagram, asked)(overrides)
    assert found.valid.all()
    assert not found.doubtful.any()
    for k in range(3):
        exact = measure(diagram, asked, overrides={name: float(column[k]) for name, column in overrides.items()})
        np.testing.assert_allclose(found.values[k], [m.value for m, _ in exact], rtol=1e-4, atol=1e-5)


def test_what_cannot_exist_is_invalid_and_what_cannot_be_followed_is_doubtful():
    batch = NonlinearBatch(limited(), ["kp", "d"], requests("peak", "rise_time"))
    with np.errstate(all="ignore"):
        found = batch(np.array([[2.0, 12.0], [np.nan, 12.0], [2.0, -400.0]]))
    assert found.valid.tolist() == [True, False, True]  # no number
    assert not found.doubtful[:2].any()
    assert found.doubtful[2].all()  # a plant that grows by e^400 in a second
    assert np.isnan(found.values[1:]).all()


def test_a_value_outside_its_bounds_does_not_exist():
    batch = NonlinearBatch(
        loop("friction", coulomb="=limit", viscous=1.0, transition_velocity=0.5),
        ["limit"],
        requests("peak", duration=1.0),
    )
    found = batch(np.array([[0.1], [-0.1]]))
    assert found.valid.tolist() == [True, False]
    assert not found.doubtful.any()
    assert np.isnan(found.values[1, 0])


def test_frequency_metrics_are_read_where_the_diagram_rests():
    diagram, gains = limited(), np.array([2.0, 3.0])
    asked = [*requests("peak"), MetricRequest(metric="phase_margin", open_at="law")]
    found = Screening(diagram, asked)({"kp": gains})
    assert not found.doubtful.any()
    for gain, values in zip(gains, found.values, strict=True):
        (margin, _) = measure(diagram, asked[1:], overrides={"kp": gain})[0]
        assert values[1] == pytest.approx(margin.value, rel=1e-9)
    with pytest.raises(UnsuitableError, match="no metric of a response in time"):
        NonlinearBatch(diagram, ["kp"], asked[1:])


def test_laws_that_are_no_formulas_take_the_exact_path():
    diagram = loop("quantizer", step=0.05)
    asked = requests("peak", duration=0.2)
    with pytest.raises(UnsuitableError, match="law: it needs ravel of a signal"):
        NonlinearBatch(diagram, ["kp"], asked)
    found = Screening(diagram, asked)({"kp": np.array([2.0])})
    assert found.doubtful.all()
    assert found.valid.all()


def test_a_piston_that_reaches_its_end_takes_the_exact_path():
    blocks = {
        "q": Block(kind="input", values={}), "zero": Block(kind="gain", values={"gain": "=leak"}),
        "cylinder": Block(kind="hydraulic_cylinder", values={}),
    }  # fmt: skip
    wires = [("q", "cylinder.flow_a"), ("q", "zero"), ("zero", "cylinder.flow_b")]
    diagram = compile_system(
        System(
            name="cylinder", parameters={"leak": Parameter(value=-0.5)}, blocks=blocks,
            connections=tuple(Connection(source=a, target=b) for a, b in wires), outputs={"x": "cylinder.position"},
        )
    )  # fmt: skip
    flow = {"q": make("step", {"amplitude": 2e-4})}
    asked = [MetricRequest(metric="peak", signals=flow, output="x", duration=duration) for duration in (0.1, 20.0)]
    found = NonlinearBatch(diagram, ["leak"], asked)(np.array([[-0.5], [-0.6]]))
    assert found.doubtful[:, 1].all()
    exact = measure(diagram, asked[:1])[0][0].value
    assert found.doubtful[0, 0] or abs(found.values[0, 0] / exact - 1) < 1e-4


def test_a_command_that_outlasts_the_time_asked_for_is_read_all_the_same():
    """It had ended with an internal error: nothing follows the last change of the command."""
    move = {"r": make("trapezoid", {"distance": 10.0, "max_velocity": 1.0, "max_acceleration": 1.0})}
    asked = [
        MetricRequest(metric=name, signals=move, output="y", duration=1.0) for name in ("peak", "iae", "overshoot")
    ]
    found = NonlinearBatch(limited(), ["kp"], asked)(np.array([[2.0]]))
    exact = [measured.value for measured, _ in measure(limited(), asked[:2])]
    np.testing.assert_allclose(found.values[0, :2], exact, rtol=1e-6)
    assert found.doubtful[0].tolist() == [False, False, True]


def test_rest_at_the_edge_of_a_dead_zone_is_told_as_the_exact_path_tells_it_or_left_to_it():
    """From outside it is the only place to rest, from inside one of many: rounding says on which side it lies."""
    blocks = {
        "r": Block(kind="input", values={}), "e": Block(kind="sum", values={"signs": "+-"}),
        "c": Block(kind="transfer_function", values={"numerator": ["=0.1*k", "=k"], "denominator": [0.01, 1.0]}),
        "zone": Block(kind="dead_zone", values={"lower": -0.01, "upper": 0.01}),
        "x": Block(kind="transfer_function", values={"numerator": [3.0], "denominator": [1.0, 3.0, 0.0]}),
    }  # fmt: skip
    wires = [("r", "e.in1"), ("x", "e.in2"), ("e", "c"), ("c", "zone"), ("zone", "x")]
    diagram = compile_system(
        System(
            name="edge", parameters={"k": Parameter(value=2.5)}, blocks=blocks, outputs={"y": "x"},
            connections=tuple(Connection(source=a, target=b) for a, b in wires),
        )
    )  # fmt: skip
    step = {"r": make("step", {"amplitude": 2.0})}
    asked = [MetricRequest(metric=name, signals=step, output="y", duration=4.0) for name in ("rise_time", "overshoot")]
    gains = np.linspace(2.3, 2.65, 8)
    found = NonlinearBatch(diagram, ["k"], asked)(gains[:, None])
    for row, gain in enumerate(gains):
        exact = [measured.value for measured, _ in measure(diagram, asked, overrides={"k": gain})]
        known = ~found.doubtful[row]
        np.testing.assert_allclose(found.values[row, known], np.array(exact)[known], rtol=2e-4)


def test_threads_and_neighbours_change_nothing():
    asked, points = requests(*TIMED), np.random.default_rng(3).uniform(0.5, 2.0, (70, 2)) * [2.0, 12.0]
    one, two = (NonlinearBatch(limited(), ["kp", "d"], asked)(points, threads=threads) for threads in (1, 2))
    assert np.array_equal(one.values, two.values, equal_nan=True)
    assert np.array_equal(one.doubtful, two.doubtful)


def test_what_was_asked_before_changes_nothing():
    """Nor do pieces of whole blocks of 64: what is cut so is the same to the bit wherever it is evaluated."""
    asked, rng = requests(*TIMED), np.random.default_rng(3)
    points = np.column_stack([rng.uniform(0.5, 6.0, 192), rng.uniform(5.0, 40.0, 192), rng.uniform(0.2, 2.0, 192)])
    batch = NonlinearBatch(limited(), ["kp", "d", "limit"], asked)
    first = batch(points)
    batch(points[::-1] * 0.5)  # easier and harder ones
    again = batch(points)
    pieces = [NonlinearBatch(limited(), ["kp", "d", "limit"], asked)(points[k : k + 64]) for k in (0, 64, 128)]
    assert (~first.doubtful).mean() > 0.5
    for found in (again.values, np.concatenate([piece.values for piece in pieces])):
        np.testing.assert_array_equal(found, first.values)
    np.testing.assert_array_equal(again.doubtful, first.doubtful)


def test_a_command_that_goes_on_for_ever_needs_a_duration():
    sine = {"r": make("sine", {"amplitude": 1.0, "frequency": 5.0})}
    endless = MetricRequest(metric="peak", signals=sine, output="y")
    with pytest.raises(UnsuitableError):
        NonlinearBatch(limited(), ["kp"], [endless])
    timed = MetricRequest(metric="peak", signals=sine, output="y", duration=3.0)
    found = NonlinearBatch(limited(), ["kp"], [timed])(np.array([[2.0]]))
    exact = measure(limited(), [timed])[0][0].value
    assert found.doubtful[0, 0] or abs(found.values[0, 0] / exact - 1) < 1e-4


def test_a_limit_that_is_reached_in_an_instant_is_seen():
    """Behind the step the controller's output rises by 1e6 per second until the limit stops it, after 20 microseconds."""
    blocks = {
        "r": Block(kind="input", values={}), "error": Block(kind="sum", values={"signs": "+-"}),
        "law": Block(kind="pd2", values={"kp": "=kp", "kd1": 30.0, "filter_frequency": 300.0}),
        "limit": Block(kind="saturation", values={"lower": -20.0, "upper": 20.0}),
        "net": Block(kind="sum", values={"signs": "+-"}), "path": Block(kind="integrator", values={}),
        "mass": Block(kind="transfer_function", values={"numerator": [0.5], "denominator": [1.0, 0.0]}),
        "friction": Block(
            kind="friction",
            values={"coulomb": 1.0, "static": 1.5, "stribeck_velocity": 0.02, "viscous": 3.0, "transition_velocity": 0.02},
        ),
    }  # fmt: skip
    wires = [
        ("r", "error.in1"), ("path", "error.in2"), ("error", "law"), ("law", "limit"), ("limit", "net.in1"),
        ("friction", "net.in2"), ("net", "mass"), ("mass", "path"), ("mass", "friction"),
    ]  # fmt: skip
    diagram = compile_system(
        System(
            name="servo", parameters={"kp": Parameter(value=400.0)}, blocks=blocks, outputs={"y": "path", "u": "limit"},
            connections=tuple(Connection(source=a, target=b) for a, b in wires),
        )
    )  # fmt: skip
    step = {"r": make("step", {"amplitude": 0.5})}
    asked = [
        MetricRequest(metric=m, signals=step, output="y", duration=2.0) for m in ("rise_time", "settling_time", "iae")
    ]
    asked.append(MetricRequest(metric="control_effort", signals=step, output="u", duration=2.0))
    found = NonlinearBatch(diagram, ["kp"], asked)(np.array([[400.0], [300.0]]))
    assert not found.doubtful.any()
    exact = measure(diagram, asked)
    np.testing.assert_allclose(found.values[0], [m.value for m, _ in exact], rtol=1e-5)
    assert found.values[1, 3] == 20.0


def test_a_drive_that_runs_at_its_limit_for_long_is_left_to_the_exact_path():
    """After a lifetime of the loop at small amplitude it still moves steadily, as an integrator would."""
    batch = NonlinearBatch(loop(lower=-0.01, upper=0.01), ["kp"], requests("rise_time", "peak"))
    assert batch(np.array([[2.0]])).doubtful.all()
