"""A recorded law says what the law itself says in the mode that its guards choose; what is no formula is refused by name."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import engine.elements
from engine.analysis.measuring import MetricRequest, measure
from engine.batch.nonlinear.arithmetic import Formulas
from engine.batch.nonlinear.batch import NonlinearBatch
from engine.batch.nonlinear.equations import Equations
from engine.batch.nonlinear.signals import SignalGraph
from engine.batch.screening import Screening
from engine.diagram.diagram import Block, Connection, Diagram, System, compile_system
from engine.elements._nonlinear import Moment, NonlinearElement
from engine.model.traced import UnsuitableError
from engine.signals import make
from tests.unit.engine.diagrams import block, document

NONLINEAR = {
    kind: element for kind, element in engine.elements.catalogue().items() if issubclass(element, NonlinearElement)
}
SMOOTH = {"friction": {"transition_velocity": 0.02, "coulomb_negative": 5.0, "static_negative": 9.0}}
"""What some elements need besides their example to be a formula."""
REFUSED = {
    "discrete_filter": "it takes samples",
    "discrete_integrator": "it takes samples",
    "discrete_notch": "it takes samples",
    "discrete_state_space": "it takes samples",
    "discrete_transfer_function": "it takes samples",
    "pneumatic_cylinder": "it needs ravel of a signal",
    "quantizer": "it needs ravel of a signal",
    "sampled_pid": "it takes samples",
    "zero_order_hold": "it takes samples",
}
REMEMBERED = {"backlash", "friction", "rate_limiter", "relay", "switch"}
"""Those whose mode only their past tells; see test_remembering."""
RECORDED = sorted(NONLINEAR.keys() - ((REFUSED.keys() | REMEMBERED) - SMOOTH.keys()))


def alone(kind: str, values: dict[str, Any]) -> Diagram:
    """Return a diagram of one block, each of its inputs an input."""
    element = engine.elements.catalogue()[kind]
    given = {param.name: param.default for param in element.parameters} | values
    ports = element.ports(given)
    blocks = {f"input{i}": Block(kind="input", values={}) for i in range(len(ports.inputs))}
    blocks["law"] = Block(kind=kind, values=values)
    wires = tuple(Connection(source=f"input{i}", target=f"law.{port}") for i, port in enumerate(ports.inputs))
    return compile_system(
        System(
            name="alone", parameters={}, blocks=blocks, connections=wires,
            outputs={port: f"law.{port}" for port in ports.outputs},
        )
    )  # fmt: skip


def moments(diagram: Diagram, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return states around their beginning and inputs of any size, (·, count)."""
    chance = np.random.default_rng(5)
    system = diagram.laws()
    start = system.start[0].real
    x = (
        start[:, None] * chance.uniform(0.7, 1.3, (len(start), count))
        + chance.uniform(-1, 1, (len(start), count)) * 1e-3
    )
    size = 10.0 ** chance.uniform(-4, 1, (len(diagram.inputs), count))
    return x, size * chance.choice([-1.0, 1.0], size.shape)


@pytest.mark.parametrize("kind", RECORDED)
def test_a_recorded_law_is_the_law_in_the_mode_that_its_guards_choose(kind):
    diagram = alone(kind, {**NONLINEAR[kind].example, **SMOOTH.get(kind, {})})
    equations = Equations.of(diagram, ())
    law = diagram.laws().laws[0]
    x, z = moments(diagram, 200)
    wanted = [*equations.rates, *equations.outputs, -1.0 if equations.outside is None else equations.outside]
    graph = equations.graph
    parameters = np.zeros((sum(node[0].name == "PARAMETER" for node in graph.nodes), 200))
    for signal, values in zip([*equations.states, *equations.inputs], [*x, *z], strict=True):
        parameters[graph.nodes[signal.node][1]] = values
    with np.errstate(all="ignore"):
        found = Formulas(graph, wanted)(parameters)
    compared = 0
    for k in range(200):
        moment = Moment(
            t=np.zeros((1, 1)), x=[np.full((1, 1), v) for v in x[:, k]], z=[np.full((1, 1), v) for v in z[:, k]]
        )
        modes = (
            (0,)
            if kind == "hydraulic_cylinder"
            else range(-1, len(law.real["points"]))
            if kind == "lookup_table"
            else range(2)
            if kind == "function"
            else range(4)
            if kind == "user_equations"
            else law.element.modes
        )
        active = [
            mode for mode in modes
            if law.element.held(mode) is None and all(np.all(np.real(g) <= 0) for g in law.element.guards(moment, mode, law.real))
        ]  # fmt: skip
        if not active:
            assert found[-1, k] > 0
            continue
        assert found[-1, k] <= 0
        expected = [*law.element.rates(moment, active[0], law.real), *law.element.outputs(moment, active[0], law.real)]
        np.testing.assert_allclose(found[:-1, k], [np.ravel(v)[0] for v in expected], rtol=1e-12, atol=1e-300)
        compared += 1
    assert compared > 50


@pytest.mark.parametrize("kind", REFUSED)
def test_a_law_that_is_no_formula_is_refused_with_the_reason(kind):
    with pytest.raises(UnsuitableError, match=rf"law: .*{REFUSED[kind]}"):
        Equations.of(alone(kind, dict(NONLINEAR[kind].example)), ())


@pytest.mark.parametrize("kind", sorted(NONLINEAR.keys() - REFUSED.keys()))
def test_every_other_nonlinear_element_is_recorded(kind):
    equations = Equations.of(alone(kind, dict(NONLINEAR[kind].example)), ())
    assert len(equations.changes.modes) == (kind in REMEMBERED)


def test_delays_that_vary_and_loops_through_laws_are_refused():
    blocks = {
        "r": Block(kind="input", values={}), "sum": Block(kind="sum", values={"signs": "+-"}),
        "limit": Block(kind="saturation", values={}), "wait": Block(kind="delay", values={"time": 0.1}),
    }  # fmt: skip
    wires = [("r", "sum.in1"), ("sum", "limit"), ("limit", "wait"), ("wait", "sum.in2")]
    for at_once, reason in ((False, "a delay that varies"), (True, "an algebraic loop through it")):
        blocks["wait"] = Block(kind="gain", values={"gain": 0.5}) if at_once else blocks["wait"]
        diagram = compile_system(
            System(
                name="loop", parameters={}, blocks=blocks, outputs={"y": "limit"},
                connections=tuple(Connection(source=a, target=b) for a, b in wires),
            )
        )  # fmt: skip
        with pytest.raises(UnsuitableError, match=reason):
            Equations.of(diagram, () if at_once else ("wait.time",))
        assert at_once or Equations.of(diagram, ()).delays == (0.1,)


def test_a_diagram_without_states_is_left_to_the_exact_path():
    blocks = {
        "r": block("input"), "g": block("gain", gain="=k"), "s": block("saturation", lower=-1.0, upper=1.0),
        "d": block("delay", time=0.1),
    }  # fmt: skip
    for wires in (["r -> g", "g -> s"], ["r -> g", "g -> s", "s -> d"]):
        diagram = compile_system(document(blocks, wires, {"y": wires[-1].split()[-1]}, k=1.0))
        asked = [MetricRequest(metric="peak", signals={"r": make("step", {})}, output="y", duration=1.0)]
        with pytest.raises(UnsuitableError, match="no states"):
            NonlinearBatch(diagram, ("k",), asked)
        found = Screening(diagram, asked)({"k": np.array([0.5, 3.0])})
        assert found.doubtful.all()
        assert [measure(diagram, asked, overrides={"k": k})[0][0].value for k in (0.5, 3.0)] == [0.5, 1.0]


def test_a_decision_by_the_value_of_a_signal_is_refused():
    signal = SignalGraph().signal()
    for decide in (
        lambda: float(signal.real),
        lambda: bool(signal > 0),
        lambda: np.floor(signal),
        lambda: np.any(signal),
    ):
        with pytest.raises(UnsuitableError):
            decide()
