"""Rest of many candidates at once: where it is known in closed form, where there is none, and where there are many."""

from __future__ import annotations

import numpy as np

from engine.batch.nonlinear.equations import Equations
from engine.batch.nonlinear.rest import Rest
from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system

NO_MODES = np.zeros((0, 3))


def driven(plant: dict[str, object], law: Block, **parameters: float) -> Diagram:
    """Return a force that a law of the velocity opposes, moving a plant."""
    blocks = {
        "force": Block(kind="input", values={}), "net": Block(kind="sum", values={"signs": "+-"}),
        "plant": Block(kind="transfer_function", values=plant), "law": law,
        "path": Block(kind="integrator", values={}),
    }  # fmt: skip
    wires = [("force", "net.in1"), ("law", "net.in2"), ("net", "plant"), ("plant", "law"), ("plant", "path")]
    return compile_system(
        System(
            name="driven", parameters={name: Parameter(value=value) for name, value in parameters.items()}, blocks=blocks,
            connections=tuple(Connection(source=a, target=b) for a, b in wires),
            outputs={"velocity": "plant", "position": "path"},
        )
    )  # fmt: skip


def cubic() -> Diagram:
    """Return v' = F - c v³ + 0·x, without the path: c from a product."""
    blocks = {
        "force": Block(kind="input", values={}), "net": Block(kind="sum", values={"signs": "+-"}),
        "speed": Block(kind="integrator", values={}), "cube": Block(kind="multiplication", values={"operations": "***"}),
        "scale": Block(kind="gain", values={"gain": "=c"}),
    }  # fmt: skip
    wires = [("force", "net.in1"), ("scale", "net.in2"), ("net", "speed"), ("cube", "scale")]
    wires += [("speed", f"cube.in{k}") for k in (1, 2, 3)]
    return compile_system(
        System(
            name="cubic", parameters={"c": Parameter(value=2.0)}, blocks=blocks, outputs={"v": "speed"},
            connections=tuple(Connection(source=a, target=b) for a, b in wires),
        )
    )  # fmt: skip


def test_a_rest_is_found_for_every_candidate():
    """0 = F - c v³: v = (F/c)^(1/3)."""
    points = np.array([[2.0], [0.1], [16.0]])
    found = Rest(Equations.of(cubic(), ["c"]), [0])(points, np.array([[0.9, 3.0, 0.6]]), NO_MODES, [2.0])
    np.testing.assert_allclose(found.outputs[0], np.cbrt(2.0 / points[:, 0]), rtol=1e-9)
    assert found.single.all()


def test_what_runs_on_or_is_no_number_has_no_rest_and_neighbours_do_not_notice():
    equations = Equations.of(driven({"numerator": [1.0], "denominator": [1.0, 0.0]}, Block(kind="friction", values={
        "coulomb": 1.0, "viscous": "=b", "transition_velocity": 0.1,
    }), b=2.0), ["b"])  # fmt: skip
    rest = Rest(equations, [0, 1])
    states = np.array([[0.6, 0.6, np.nan], [1.0, 2.0, 3.0]])
    points = np.array([[2.0], [3.0], [2.0]])
    running = rest(points, states, NO_MODES, [2.0])  # the velocity is constant, the position is not
    assert np.isnan(running.outputs).all()
    assert not running.single.any()
    still = rest(points, states * [[1e-8], [1.0]], NO_MODES, [0.0])
    np.testing.assert_allclose(still.outputs[0, :2], 0.0, atol=1e-9)
    np.testing.assert_allclose(still.outputs[1, :2], [1.0, 2.0], rtol=1e-6)  # anywhere: it stays about where it was
    assert not still.single.any()
    assert np.isnan(still.outputs[:, 2]).all()
