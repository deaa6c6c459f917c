"""Realisation of many at once: each member of a stack, and each lane, is what it is alone."""

from __future__ import annotations

import numpy as np
import pytest

from engine.diagram.diagram import compile_system
from engine.model.errors import DiagramError, IllPosedError
from tests.unit.engine.diagrams import block, document, response
from tests.unit.engine.test_realize import STEP, S, feedback, servo

STACK = {
    "kp": np.array([0.02, 0.03, 0.01, 0.02]),
    "ki": np.array([0.004, 0.0, 0.01, 0.001]),
    "m": np.array([300.0, 100.0, 500.0, 200.0]),
    "dead_time": np.array([0.01, 0.02, 0.0, 0.005]),
}


@pytest.mark.parametrize("member", range(4))
@pytest.mark.parametrize("open_at", [None, "error"])
def test_a_stack_behaves_as_its_members(member, open_at):
    diagram = compile_system(servo())
    stack = diagram.realize_stack(STACK, open_at=open_at)
    single = diagram.realize({path: values[member] for path, values in STACK.items()}, open_at=open_at)
    assert stack.valid.all()
    assert (stack.inputs, stack.outputs) == (single.inputs, single.outputs)
    for s in S:
        for source in single.inputs:
            for output in single.outputs:
                np.testing.assert_allclose(
                    response(stack.member(member), s, output, source), response(single, s, output, source), rtol=1e-9
                )


def test_a_stack_carries_infinitesimals():
    diagram = compile_system(servo())
    stack = diagram.realize_stack({"m": np.array([300.0, 200.0]) * (1 + STEP * 1j)})
    single = diagram.realize({"m": 200.0 * (1 + STEP * 1j)})
    np.testing.assert_allclose(stack.a[1].imag, single.a.imag, rtol=1e-14)


def test_members_that_do_not_exist_leave_the_others_alone():
    diagram = compile_system(feedback(0.5))
    stack = diagram.realize_stack({"k": np.array([0.5, -1.0, 2.0, np.nan, np.inf])})
    assert stack.valid.tolist() == [True, False, True, False, False]
    np.testing.assert_allclose(stack.d11[:, 0, 0], [1 / 3, 0, 2 / 3, 0, 0], rtol=1e-15)


def test_members_outside_physical_bounds_do_not_exist():
    stack = compile_system(servo()).realize_stack({"m": np.array([300.0, 0.0, -1.0])})
    assert stack.valid.tolist() == [True, False, False]
    assert not stack.a[1:].any()


@pytest.mark.parametrize(
    ("values", "block_of", "valid"),
    [
        # improper at 1, a delay that is not a number, a pair of poles that falls apart, a leading coefficient of 0
        ([0.0, 1.0, 0.0], block("transfer_function", numerator=["=k", 1, 1], denominator=[1, 1]), [True, False, True]),
        ([0.0, np.nan, 2.0], block("delay", time="=k"), [True, False, True]),
        ([0.0, np.inf, -2.0], block("delay", time="=k"), [True, False, False]),
        ([0.0, 1.0, 0.0], block("zero_pole_gain", poles=[["=-1-k", 2], [-1, -2]]), [True, False, True]),
        ([0.0, 1.0, 2.0], block("transfer_function", numerator=[1], denominator=["=k", 1, 1]), [False, True, True]),
        ([1.0, 2.0, 1.0], block("transfer_function", numerator=["=k", 1, 1], denominator=[1, 1]), [False] * 3),
    ],
)
def test_a_block_that_some_members_lack_leaves_the_others_alone(values, block_of, valid):
    diagram = compile_system(document({"u": block("input"), "b": block_of}, ["u -> b"], {"y": "b"}, k=0.0))
    stack = diagram.realize_stack({"k": np.array(values)})
    assert stack.valid.tolist() == valid
    for member in np.flatnonzero(valid):
        single = diagram.realize({"k": values[member]})
        np.testing.assert_allclose(
            response(stack.member(int(member)), 1j, "y", "u"), response(single, 1j, "y", "u"), rtol=1e-13
        )


def test_a_stack_without_overrides_repeats_the_base():
    diagram = compile_system(servo())
    stack = diagram.realize_stack({}, members=3)
    np.testing.assert_array_equal(stack.a, np.stack([diagram.realize().a] * 3))


@pytest.mark.parametrize("ki", [0.004, 0.0])
def test_lanes_carry_one_infinitesimal_each_and_share_the_rest(ki):
    diagram = compile_system(servo(ki=ki))
    paths = ("kp", "ki", "m", "dead_time")
    lanes = diagram.realize_lanes(dict.fromkeys(paths, STEP), {"motor.area": 6e-3}, open_at="error")
    base = diagram.realize({"motor.area": 6e-3, "ki": ki + STEP * 1j}, open_at="error")
    for k, path in enumerate(paths):
        value = diagram.parameters[path].value
        single = diagram.realize({"motor.area": 6e-3, "ki": ki + 0j, path: value + STEP * 1j}, open_at="error")
        for name in ("a", "b1", "b2", "c1", "c2", "d11", "d12", "d21", "d22", "delays"):
            np.testing.assert_array_equal(getattr(lanes, name)[k].real, getattr(base, name).real)
            if getattr(single, name).shape == getattr(base, name).shape:
                np.testing.assert_allclose(getattr(lanes, name)[k].imag, getattr(single, name).imag, rtol=1e-14)
    assert lanes.inputs == base.inputs


def test_a_lane_that_cannot_be_is_refused_as_a_single_system_is():
    diagram = compile_system(feedback(0.5))
    with pytest.raises(IllPosedError, match=r"gain\.out"):
        diagram.realize_lanes({"k": STEP}, {"k": -1.0})
    with pytest.raises(DiagramError, match="must be one of the system's"):
        diagram.realize_lanes({"speed": STEP})
