"""Small system documents, written shortly, for the tests of diagrams."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from engine.diagram.diagram import Block, Connection, Parameter, System
from engine.model.linear_system import LinearSystem


def block(kind: str, **values: Any) -> Block:
    return Block(kind=kind, values=values)


def subsystem(system: System) -> Block:
    return Block(kind="subsystem", system=system)


def document(
    blocks: Mapping[str, Block],
    wires: Sequence[str] = (),
    outputs: Mapping[str, str] | None = None,
    **parameters: float | str | Parameter,
) -> System:
    """Return a document; a wire is written ``"error -> controller"``."""
    pairs = [wire.split(" -> ") for wire in wires]
    return System(
        name="test",
        parameters={
            name: given if isinstance(given, Parameter) else Parameter(value=given)
            for name, given in parameters.items()
        },
        blocks=dict(blocks),
        connections=tuple(Connection(source=source, target=target) for source, target in pairs),
        outputs=dict(outputs or {}),
    )


def response(system: LinearSystem, s: complex, output: str, source: str) -> complex:
    """Return the exact transfer function at s, delay channels included."""
    x = np.linalg.solve(s * np.eye(len(system.a)) - system.a, np.hstack([system.b1, system.b2]))
    n_in = len(system.inputs)
    y = system.c1 @ x + np.hstack([system.d11, system.d12])
    z = system.c2 @ x + np.hstack([system.d21, system.d22])
    e = np.diag(np.exp(-s * system.delays))
    w = np.linalg.solve(np.eye(len(e)) - e @ z[:, n_in:], e @ z[:, :n_in])
    h = y[:, :n_in] + y[:, n_in:] @ w
    return complex(h[system.outputs.index(output), system.inputs.index(source)])
