"""Random networks of blocks against the definition: all signals of the network solved at once, at one frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from engine.diagram.diagram import Block, Connection, Diagram, System, compile_system
from engine.model.errors import IllPosedError
from engine.model.linear_system import LinearSystem

S = 0.7 + 1.3j
STEP = 1e-30
GAINS = st.floats(-3, 3).map(lambda x: round(x, 3)).filter(lambda x: abs(x) > 0.01)
RATES = st.floats(0.1, 20).map(lambda x: round(x, 3))


@dataclass(frozen=True, kw_only=True)
class Part:
    """A block of the network and its transfer function at `S`, a row for each output, a column for each input."""

    block: Block
    inputs: tuple[str, ...]
    response: np.ndarray


def gain(k: float) -> Part:
    return Part(block=Block(kind="gain", values={"gain": k}), inputs=("in",), response=np.array([[k]]))


def lag(k: float, rate: float) -> Part:
    values = {"numerator": [k], "denominator": [1, rate]}
    return Part(
        block=Block(kind="transfer_function", values=values), inputs=("in",), response=np.array([[k / (S + rate)]])
    )


def lead(k: float, rate: float) -> Part:
    values = {"numerator": [k, 1], "denominator": [1, rate]}
    response = np.array([[(k * S + 1) / (S + rate)]])
    return Part(block=Block(kind="transfer_function", values=values), inputs=("in",), response=response)


def delay(k: float, rate: float) -> Part:
    time = 1 / (abs(k) + rate)
    return Part(
        block=Block(kind="delay", values={"time": time}), inputs=("in",), response=np.array([[np.exp(-S * time)]])
    )


def summing(k: float) -> Part:
    signs = "+-+" if k > 0 else "-+-"
    response = np.array([[1.0 if sign == "+" else -1.0 for sign in signs]])
    return Part(block=Block(kind="sum", values={"signs": signs}), inputs=("in1", "in2", "in3"), response=response)


PARTS = st.one_of(
    st.builds(gain, GAINS), st.builds(lag, GAINS, RATES), st.builds(lead, GAINS, RATES), st.builds(delay, GAINS, RATES),
    st.builds(summing, GAINS),
)  # fmt: skip


@st.composite
def networks(draw: st.DrawFn) -> tuple[System, np.ndarray, np.ndarray]:
    """Return a document in which every input is driven by any output, and the responses of its blocks as one matrix.

    All outputs y fulfil y = G (K y + e u), with G the blocks' transfer functions, K the connections and e the entries.
    """
    parts = draw(st.lists(PARTS, min_size=1, max_size=8))
    names = [f"b{i}" for i in range(len(parts))]
    ends = [(name, port) for name, part in zip(names, parts, strict=True) for port in part.inputs]
    choice = st.integers(-2, len(parts) - 1)  # -2: open, -1: the input u
    sources = [draw(choice) for _ in ends]
    wires = tuple(
        Connection(source="u" if source == -1 else names[source], target=f"{name}.{port}")
        for (name, port), source in zip(ends, sources, strict=True)
        if source != -2
    )
    blocks = {"u": Block(kind="input"), **{name: part.block for name, part in zip(names, parts, strict=True)}}
    g = np.zeros((len(parts), len(ends)), dtype=complex)
    column = 0
    for row, part in enumerate(parts):
        g[row, column : column + len(part.inputs)] = part.response
        column += len(part.inputs)
    k = np.zeros((len(ends), len(parts)))
    e = np.zeros((len(ends), 1))
    for row, source in enumerate(sources):
        if source == -1:
            e[row] = 1
        elif source >= 0:
            k[row, source] = 1
    document = System(blocks=blocks, connections=wires, outputs=dict(zip(names, names, strict=True)))
    return document, g @ k, g @ e


def response(system: LinearSystem, s: complex) -> np.ndarray:
    """Return the transfer functions from all inputs to all outputs at s."""
    n, m = len(system.a), len(system.delays)
    x = np.linalg.solve(s * np.eye(n) - system.a, np.hstack([system.b1, system.b2]))
    y = system.c1 @ x + np.hstack([system.d11, system.d12])
    z = system.c2 @ x + np.hstack([system.d21, system.d22])
    inputs = len(system.inputs)
    e = np.diag(np.exp(-s * system.delays))
    return np.asarray(y[:, :inputs] + y[:, inputs:] @ np.linalg.solve(np.eye(m) - e @ z[:, inputs:], e @ z[:, :inputs]))


def compiled(document: System) -> Diagram:
    try:
        return compile_system(document)
    except IllPosedError:
        assume(False)
        raise


@given(networks())
def test_every_network_solves_its_own_equations(network):
    document, feedback, entry = network
    equations = np.eye(len(feedback)) - feedback
    assume(np.linalg.cond(equations) < 1e6)
    system = compiled(document).realize()
    np.testing.assert_allclose(response(system, S), np.linalg.solve(equations, entry), rtol=1e-7, atol=1e-9)


@given(networks(), st.integers(0, 7))
def test_closing_an_opened_loop_by_hand_gives_the_closed_system(network, which):
    document, feedback, _ = network
    cut = f"b{which % len(feedback)}"
    diagram = compiled(document)
    try:
        opened = response(diagram.realize(open_at=cut), S)
    except IllPosedError:  # cutting one loop may leave an ill-posed one that the whole did not have
        assume(False)
        raise
    closed = response(diagram.realize(), S)
    assume(np.abs(1 - opened[-1, 1]) > 1e-4)
    assume(max(np.abs(opened).max(), np.abs(closed).max()) < 1e4)
    by_hand = opened[:-1, :1] + opened[:-1, 1:] @ opened[-1:, :1] / (1 - opened[-1, 1])
    np.testing.assert_allclose(by_hand, closed, rtol=1e-6, atol=1e-8)


@given(networks(), st.integers(0, 7))
def test_a_stack_and_its_lanes_agree_with_single_systems(network, which):
    document, _, _ = network
    diagram = compiled(document)
    scalars = [path for path in diagram.parameters if not path.endswith(".signs")]
    assume(scalars)
    path = scalars[which % len(scalars)]
    values = diagram.parameters[path].value * np.array([1.0, 1.01, 0.97])
    stack = diagram.realize_stack({path: values})
    for member in np.flatnonzero(stack.valid):
        single = diagram.realize({path: float(values[member])})
        for name in ("a", "b1", "b2", "c1", "c2", "d11", "d12", "d21", "d22", "delays"):
            exact = getattr(single, name)
            tolerance = 1e-9 * max(1.0, np.abs(exact).max(initial=0.0))
            np.testing.assert_allclose(getattr(stack, name)[member], exact, rtol=1e-9, atol=tolerance)
    lanes = diagram.realize_lanes({path: STEP})
    np.testing.assert_allclose(
        lanes.a[0].imag, diagram.realize({path: values[0] + STEP * 1j}).a.imag, rtol=1e-9, atol=1e-40
    )
