"""The answer of a diagram to a recording and its derivatives, against formulas."""

from __future__ import annotations

import numpy as np
import pytest

from engine.diagram.diagram import Block, Connection, Parameter, System, compile_system
from engine.model.errors import UnresolvedError
from engine.recordings.validation.response import respond, tangents

H = 0.01
TIME = H * np.arange(300)
U = np.sin(2 * np.pi * TIME)


def diagram(**more: Block):
    """Return y = block(k u), and k u as an output of its own."""
    name, block = next(iter(more.items()))
    return compile_system(
        System(
            name="chain",
            parameters={"k": Parameter(value=2.0)},
            blocks={"u": Block(kind="input"), "quiet": Block(kind="input"), "gain": Block(kind="gain", values={"gain": "=k"}), name: block,
                    "sum": Block(kind="sum", values={"signs": "++"})},
            connections=(
                Connection(source="u", target="gain"), Connection(source="gain", target=name),
                Connection(source=name, target="sum.in1"), Connection(source="quiet", target="sum.in2"),
            ),
            outputs={"y": "sum", "driven": "gain"},
        )
    )  # fmt: skip


LAG = diagram(lag=Block(kind="transfer_function", values={"numerator": [1.0], "denominator": [0.2, 1.0]}))
LIMIT = diagram(limit=Block(kind="saturation", values={"upper": 1.0, "lower": -1.0}))


def test_inputs_that_were_not_recorded_are_silent() -> None:
    found = respond(LAG, {"u": U}, H, outputs=("driven", "y"), overrides={"k": 3.0})
    assert list(found) == ["driven", "y"]
    assert found["driven"] == pytest.approx(3 * U, abs=1e-12)


def test_the_derivative_of_what_is_linear_in_a_parameter_is_the_answer_to_1() -> None:
    by = tangents(LAG, {"u": U}, H, outputs=("y",), overrides={"k": 3.0}, parameters=["k"])
    one = respond(LAG, {"u": U}, H, outputs=("y",), overrides={"k": 1.0})
    assert by["y"]["k"] == pytest.approx(one["y"], abs=1e-12)
    assert tangents(LAG, {"u": U}, H, outputs=("y",), overrides={}, parameters=[]) == {"y": {}}


def test_a_limit_has_no_derivative_where_it_holds() -> None:
    found = respond(LIMIT, {"u": U}, H, outputs=("y",), overrides={"k": 2.0})
    assert found["y"] == pytest.approx(np.clip(2 * U, -1, 1), abs=1e-9)
    by = tangents(LIMIT, {"u": U}, H, outputs=("y",), overrides={"k": 2.0}, parameters=["k"])
    clear = np.abs(np.abs(2 * U) - 1) > 0.05
    assert by["y"]["k"][clear] == pytest.approx(np.where(np.abs(2 * U) < 1, U, 0.0)[clear], abs=1e-6)


def test_a_parameter_that_switches_something_on_has_no_derivative() -> None:
    """A damper without a lag of its coil: at 0 the lag has no state that could carry a derivative."""
    damper = compile_system(
        System(
            name="damper",
            parameters={},
            blocks={
                "x": Block(kind="input"),
                "v": Block(kind="input"),
                "i": Block(kind="input"),
                "d": Block(
                    kind="mr_damper_spencer",
                    values={"alpha": [1e3], "c0": [1e3], "c1": [1e4], "k0": [0.0], "k1": 0.0, "x0": 0.0, "gamma": 1e4},
                ),
            },
            connections=tuple(
                Connection(source=a, target=f"d.{b}") for a, b in (("x", "displacement"), ("v", "velocity"), ("i", "current"))
            ),
            outputs={"f": "d"},
        )
    )  # fmt: skip
    driven = {"x": 0.01 * U[:50], "v": 0.01 * np.gradient(U, H)[:50], "i": np.ones(50)}
    with pytest.raises(UnresolvedError, match="no derivative"):
        tangents(damper, driven, H, outputs=("f",), overrides={}, parameters=["d.k1", "d.coil_time_constant"])
    by = tangents(damper, driven, H, outputs=("f",), overrides={}, parameters=["d.k1"])
    # k1 (x - x0) is added to the force: its derivative is the displacement
    assert by["f"]["d.k1"] == pytest.approx(driven["x"], abs=1e-9)
