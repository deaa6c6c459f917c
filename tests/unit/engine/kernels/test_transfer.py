"""Transfer programs give the exact frequency response, tabulated or not, at values they were not traced at."""

from __future__ import annotations

import numpy as np
import pytest

from engine.batch.kernels.compiled import LANES
from engine.batch.kernels.curves import run_program
from engine.batch.kernels.frequency_program import program, reals, tabulated
from engine.batch.kernels.spectrum_program import CHUNK
from engine.batch.kernels.tape import Registers, run
from engine.batch.kernels.transfer import Curve, Curves, Network
from engine.diagram.diagram import LOOP, Diagram
from tests.reference.systems import block, pneumatic_loop, system, unity_loop
from tests.unit.engine.kernels.test_assembly import algebraic

FREQUENCIES = np.geomspace(1e-2, 1e4, CHUNK)


def many_states() -> Diagram:
    """A block of six states, too large for a quotient of polynomials, in a loop."""
    plant = np.poly([-1.0, -2.0, -3.0 + 4.0j, -3.0 - 4.0j, -20.0, -50.0])
    return system(
        {
            "r": block("input"),
            "error": block("sum", signs="+-"),
            "k": block("gain", gain="=k"),
            "plant": block("transfer_function", numerator=["=b", 5e4], denominator=plant.tolist()),
        },
        ["r -> error.in1", "plant -> error.in2", "error -> k", "k -> plant"],
        {"y": "plant"},
        {"k": 0.5, "b": 300.0},
    )


DIAGRAMS = {
    "pneumatic": (pneumatic_loop(), "error", "reference", "position"),
    "algebraic": (algebraic(), "plant", "r", "y"),
    "six states": (many_states(), "error", "r", "y"),
    "fourth order": (unity_loop(["=k", 1.0], [0.1, "=d", 2.0, 1.0, 0.0], k=0.3, d=1.0), "error", "r", "y"),
}


def response(diagram: Diagram, point: dict[str, float], cut: str | None, source: str, target: str) -> np.ndarray:
    """Return C (jω - A)^-1 B + D of one path, from the realised state space."""
    s = diagram.realize(point, open_at=cut)
    i, o = s.inputs.index(source), s.outputs.index(target)
    return np.array(
        [
            s.c1[o] @ np.linalg.solve(1j * w * np.eye(s.states) - s.a, s.b1[:, i]) + s.d11[o, i]
            for w in FREQUENCIES
        ]
    )  # fmt: skip


@pytest.mark.parametrize("tabulate", [True, False], ids=["tables", "no tables"])
@pytest.mark.parametrize("loop", [True, False], ids=["loop", "path"])
@pytest.mark.parametrize("name", DIAGRAMS)
def test_a_program_is_the_frequency_response(name: str, loop: bool, tabulate: bool) -> None:
    diagram, cut, source, target = DIAGRAMS[name]
    where = cut if loop else None
    source, target = (LOOP, LOOP) if loop else (source, target)
    rng = np.random.default_rng(2)
    points = {
        path: info.value * np.exp(rng.uniform(-1, 1, LANES))
        for path, info in diagram.parameters.items()
        if "." not in path
    }
    traced, wiring, curves = diagram.trace(tuple(points)), diagram.wiring(where), Curves()
    network = Network(curves, traced, wiring, [wiring.inputs.index(source)])
    curve = network.read(wiring.outputs.index(target), 0)
    assert isinstance(curve, Curve)
    registers = Registers(traced.graph, reals(curves, [curve]), len(points))
    values = np.full((registers.count, LANES), np.nan)
    values[: len(points)] = list(points.values())
    run(registers.tape, values)
    made, tables = program(curves, [curve], registers, tabulate=tabulate)
    table = tabulated(curves, tables, FREQUENCIES)
    re, im = np.full((2, made.places, CHUNK, LANES), np.nan)
    omega = np.repeat(FREQUENCIES[:, None], LANES, axis=1)
    run_program(made, values, omega, table.real.copy(), table.imag.copy(), 0, re, im)
    found = re[made.targets[0]] + 1j * im[made.targets[0]]
    assert bool(tables) == tabulate or not tables
    for lane in range(LANES):
        exact = response(diagram, {path: float(v[lane]) for path, v in points.items()}, where, source, target)
        np.testing.assert_allclose(found[:, lane], exact, rtol=1e-9, atol=1e-13 * np.abs(exact).max())


def test_equal_functions_are_one_node() -> None:
    curves = Curves()
    first, second = curves.polynomial([1.0, 2.0]), curves.polynomial([3.0, 4.0])
    assert (first * second).number == (second * first).number
    assert (first + second).number == (second + first).number
    negative = -first
    assert (-negative).number == first.number
    assert (negative * second).number == (first * (-second)).number
