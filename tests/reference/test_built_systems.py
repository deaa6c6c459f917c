"""Formulas of the client beside the same formulas of python-control, and systems that are built block by block."""

from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest

from api.convert.systems import diagram_from_wire
from api.schemas.systems import SystemDocument
from servotune import DocumentError, System, block, feedback, from_control, gain, parallel, quantity, series, tf
from servotune.algebra import Part

W = np.geomspace(0.1, 100.0, 40)


def response(document: System) -> np.ndarray:
    """Return from the input to the output, by the engine's own state space of the document as it is sent."""
    sent = SystemDocument.model_validate(json.loads(document.to_json()))
    made = diagram_from_wire(sent).realize()
    found = control.ss(made.a, made.b1, made.c1, made.d11)
    return np.asarray(control.frequency_response(found, W).complex).ravel()


def expected(system: Any) -> np.ndarray:
    return np.asarray(control.frequency_response(system, W).complex).ravel()


G, H = ([2.0], [0.5, 1.0]), ([1.0, 3.0], [0.2, 0.7, 1.0])

FORMULAS: dict[str, Callable[[Any, Any, Any, Any], Any]] = {
    "series": lambda g, h, f, s: s(g, h),
    "feedback": lambda g, h, f, s: f(g, 1),
    "feedback through h": lambda g, h, f, s: f(g, h),
    "positive feedback": lambda g, h, f, s: f(g, h, 1),
    "sum": lambda g, h, f, s: g + h,
    "difference": lambda g, h, f, s: g - h,
    "a number more": lambda g, h, f, s: g + 2,
    "a number less": lambda g, h, f, s: 1 - g,
    "turned round": lambda g, h, f, s: -g,
    "the same twice": lambda g, h, f, s: s(s(g, g), g + g),
    "two loops in each other": lambda g, h, f, s: f(s(h, f(s(g, g), h)), 1),
    "loops side by side": lambda g, h, f, s: f(f(g, 1) - f(h, g), g + h),
    "a number in front": lambda g, h, f, s: f(s(g, 3.0), 1),
}


@pytest.mark.parametrize("name", FORMULAS)
def test_a_formula_is_that_of_python_control(name: str) -> None:
    formula = FORMULAS[name]
    mine = formula(tf(*G), tf(*H), feedback, lambda a, b: a >> b)
    theirs = formula(control.tf(*G), control.tf(*H), control.feedback, lambda a, b: b * a)
    np.testing.assert_allclose(response(mine.system("x")), expected(theirs), rtol=1e-10)


@pytest.mark.parametrize("seed", range(20))
def test_random_formulas_are_those_of_python_control(seed: int) -> None:
    rng = np.random.default_rng([32, seed])

    def leaf() -> tuple[Part, Any]:
        order = int(rng.integers(1, 4))
        numerator, denominator = rng.uniform(0.5, 2, order).tolist(), rng.uniform(0.5, 2, order + 1).tolist()
        if rng.integers(2):
            return tf(numerator, denominator), control.tf(numerator, denominator)
        space = control.tf2ss(control.tf(numerator, denominator))
        return from_control(space), space

    def tree(depth: int) -> tuple[Part, Any]:
        if depth == 0:
            return leaf()
        (a, x), (b, y) = tree(depth - 1), tree(depth - 1)
        kind = int(rng.integers(4))
        mine: Callable[[], Part] = [
            lambda: series(a, b),
            lambda: parallel(a, b),
            lambda: a - b,
            lambda: feedback(a, b),
        ][kind]
        theirs: Callable[[], Any] = [lambda: y * x, lambda: x + y, lambda: x - y, lambda: control.feedback(x, y)][kind]
        return mine(), theirs()

    part, system = tree(3)
    np.testing.assert_allclose(response(part.system("x")), expected(system), rtol=1e-7)


def test_what_python_control_has_comes_over() -> None:
    for system in (control.tf(*G), control.ss(control.tf(*H))):
        np.testing.assert_allclose(response(from_control(system).system("x")), expected(system), rtol=1e-12)
    with pytest.raises(ValueError, match=r"must be continuous in time, got one sampled with dt = 0\.1"):
        from_control(control.tf([1], [1, 0.5], 0.1))
    with pytest.raises(ValueError, match="must have one input and one output, got 2 and 1"):
        from_control(control.ss([[-1.0]], [[1.0, 2.0]], [[1.0]], [[0.0, 0.0]]))


def test_a_loop_with_names_and_parameters() -> None:
    kp = quantity(12, "1/s", lower=1, upper=50)
    loop = feedback(gain("=kp", "controller") >> tf([1], [0.02, 1, 0], "drive")).system(
        "axis", output="position", kp=kp
    )
    assert set(loop["blocks"]) == {"r", "error", "controller", "drive"}
    assert loop["outputs"] == {"position": "drive"}
    assert loop["parameters"]["kp"]["upper"] == {"value": 50, "unit": "1/s"}
    np.testing.assert_allclose(response(loop), expected(control.feedback(control.tf([12], [0.02, 1, 0]))), rtol=1e-10)


def test_a_system_is_built_block_by_block(tmp_path: Path) -> None:
    axis = System("axis", kp=12.0)
    reference, error = axis.add("input", "reference"), axis.add("sum", "error", signs="+-")
    drive = axis.add("transfer_function", "drive", numerator=np.array([1.0]), denominator=(0.02, 1, 0))
    reference >> error["in1"]
    error >> axis.add("gain", "controller", gain="=kp") >> drive >> error["in2"]
    axis.output("position", drive)
    assert repr(axis) == "<System 'axis': 4 blocks, 4 connections, outputs position>"
    np.testing.assert_allclose(response(axis), expected(control.feedback(control.tf([12], [0.02, 1, 0]))), rtol=1e-10)
    axis.save(tmp_path / "axis.json")
    assert json.loads((tmp_path / "axis.json").read_text()) == json.loads(axis.to_json())
    for twin in (copy.deepcopy(axis), pickle.loads(pickle.dumps(axis))):
        assert twin.to_json() == axis.to_json()
    assert str(axis.drive) == "drive"
    outer = System("outer")
    outer.add("input", "r") >> outer.add(axis, "inner")["reference"]
    outer.output("y", outer.inner["position"])
    np.testing.assert_allclose(response(outer), response(axis), rtol=1e-12)


def test_wrong_use_is_named() -> None:
    axis, other = System("axis"), System("other")
    axis.add("input", "r")
    with pytest.raises(ValueError, match="a block must have a name of its own, 'r' is taken in 'axis'"):
        axis.add("sum", "r")
    with pytest.raises(AttributeError, match="has no block 'q'; it has r"):
        axis.q  # noqa: B018
    with pytest.raises(ValueError, match="both ends of a connection must be in one system"):
        axis.r >> other.add("gain", "g", gain=1.0)
    with pytest.raises(TypeError, match="or be a number, got str"):
        feedback("kp")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="sign must be -1 or 1, got 0"):
        feedback(tf(*G), sign=0)
    with pytest.raises(ValueError, match="a part with one block"):
        (tf(*G) >> 2).named("x")
    with pytest.raises(DocumentError, match="denominator"):
        tf([1.0], [float("nan"), 1.0]).system("x").to_json()


def test_any_block_of_the_catalogue_takes_part() -> None:
    loop = feedback(block("pid", "controller", kp=5.0, ki=2.0, kd=0.1, filter_frequency=100.0) >> tf(*G))
    s = control.tf("s")
    law = 5 + 2 / s + 0.1 * 100 * s / (s + 100)
    np.testing.assert_allclose(response(loop.system("x")), expected(control.feedback(law * control.tf(*G))), rtol=1e-9)
