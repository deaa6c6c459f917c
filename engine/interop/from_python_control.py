"""A python-control system as a system document: state spaces, transfer functions, interconnections block by block."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.model.document import Block, Connection, System
from engine.model.errors import DiagramError
from engine.model.names import MAX_NAME

Array = npt.NDArray[np.float64]

_ILLEGAL: Final = re.compile(r"[^A-Za-z0-9_]+")


def from_control(system: Any, *, name: str | None = None) -> System:
    """Return a continuous linear python-control system as a document.

    A `StateSpace` becomes a state_space block, a `TransferFunction` a transfer_function block for each entry, a
    `LinearICSystem` (from `interconnect`) a block for each of its systems with sums between them. Names are kept where ours
    may be so; other characters become _ (``u[0]`` is u_0), and a name already taken gets a number.

    Parameters
    ----------
    system : control.StateSpace, control.TransferFunction or control.LinearICSystem
    name : str, optional
        Of the document; by default that of the system.

    Raises
    ------
    DiagramError
        For any other kind of system, and for sampled ones.
    """
    import control  # noqa: PLC0415  an optional library, which takes a second to load

    if not isinstance(system, (control.StateSpace, control.TransferFunction)):
        raise DiagramError(
            f"system must be a StateSpace, a TransferFunction or a linear interconnection of python-control, "
            f"got {type(system).__name__}"
        )
    if system.dt not in (0, None):
        raise DiagramError(f"system must be continuous in time, got one sampled with dt = {system.dt}")
    drawing = _Drawing()
    inputs = [drawing.block(label, Block(kind="input")) for label in system.input_labels]
    if isinstance(system, control.LinearICSystem):
        ends = _interconnection(drawing, system, inputs)
    elif isinstance(system, control.StateSpace):
        ends = _state_space(drawing, system, inputs)
    else:
        ends = _transfer_functions(drawing, system, inputs)
    outputs = dict(zip(_unique(system.output_labels), ends, strict=True))
    return System(
        name=system.name if name is None else name,
        blocks=drawing.blocks,
        connections=tuple(drawing.connections),
        outputs=outputs,
    )


class _Drawing:
    """Blocks and connections as they come, names made unique."""

    def __init__(self) -> None:
        self.blocks: dict[str, Block] = {}
        self.connections: list[Connection] = []

    def block(self, label: str, block: Block) -> str:
        """Add a block and return its name."""
        name = _free(label, self.blocks)
        self.blocks[name] = block
        return name

    def connect(self, source: str, target: str) -> None:
        """Add a connection."""
        self.connections.append(Connection(source=source, target=target))

    def combine(self, label: str, sources: Sequence[str], weights: Array) -> str | None:
        """Return the endpoint of a weighted sum of endpoints; None where all weights are 0."""
        terms = [(source, float(weight)) for source, weight in zip(sources, weights, strict=True) if weight]
        if not terms:
            return None
        if len(terms) == 1 and terms[0][1] == 1:
            return terms[0][0]
        signs = "".join("+" if weight > 0 else "-" for _, weight in terms)
        total = self.block(label, Block(kind="sum", values={"signs": signs}))
        for number, (source, weight) in enumerate(terms):
            end = source
            if abs(weight) != 1:
                end = self.block(f"{label}_gain", Block(kind="gain", values={"gain": abs(weight)}))
                self.connect(source, end)
            self.connect(end, f"{total}.in{number + 1}")
        return total

    def zero(self) -> str:
        """Return an endpoint that is always 0."""
        return self.block("zero", Block(kind="sum", values={"signs": "+"}))


def _state_space(drawing: _Drawing, system: Any, inputs: Sequence[str]) -> list[str]:
    """Draw one state space behind its inputs and return the endpoints of its outputs."""
    block = _matrices(system)
    name = drawing.block(system.name, block)
    for source, port in zip(inputs, block.values["inputs"], strict=True):
        drawing.connect(source, f"{name}.{port}")
    return [f"{name}.{port}" for port in block.values["outputs"]]


def _transfer_functions(drawing: _Drawing, system: Any, inputs: Sequence[str]) -> list[str]:
    """Draw a transfer function for each entry that is not 0, and a sum for each output that has several."""
    ends = []
    for i, output in enumerate(system.output_labels):
        row = []
        for j, source in enumerate(inputs):
            numerator, denominator = (np.asarray(part[i][j], dtype=float) for part in (system.num, system.den))
            if numerator.any():
                label = system.name if len(inputs) == system.noutputs == 1 else f"{system.name}_{i + 1}_{j + 1}"
                values = {"numerator": numerator.tolist(), "denominator": denominator.tolist()}
                row.append(drawing.block(label, Block(kind="transfer_function", values=values)))
                drawing.connect(source, row[-1])
        ends.append(drawing.combine(output, row, np.ones(len(row))) or drawing.zero())
    return ends


def _interconnection(drawing: _Drawing, system: Any, inputs: Sequence[str]) -> list[str]:
    """Draw every system of an interconnection: u = K y + G r, outputs H (y, u), with K, G, H its maps."""
    made, taken = [], []
    for each in system.syslist:
        block = _matrices(each)
        name = drawing.block(each.name, block)
        made += [f"{name}.{port}" for port in block.values["outputs"]]
        taken += [f"{name}.{port}" for port in block.values["inputs"]]
    sources = [*made]
    for target, feedback, direct in zip(taken, system.connect_map, system.input_map, strict=True):
        label = f"{target.replace('.', '_')}_sum"
        end = drawing.combine(label, [*made, *inputs], np.concatenate([feedback, direct]))
        if end is not None:
            drawing.connect(end, target)
        sources.append(end or "")
    ends = []
    for output, weights in zip(system.output_labels, system.output_map, strict=True):
        # An input that nothing drives is 0, whatever its weight.
        seen = np.where([bool(source) for source in sources], weights, 0.0)
        ends.append(drawing.combine(f"{output}_sum", sources, seen) or drawing.zero())
    return ends


def _matrices(system: Any) -> Block:
    """Return a state_space block with the ports of a `control.StateSpace`."""
    matrices = {key: np.asarray(getattr(system, key), dtype=float).tolist() for key in "ABCD"}
    ports = {"inputs": _unique(system.input_labels), "outputs": _unique(system.output_labels)}
    return Block(kind="state_space", values={**matrices, **ports})


def _unique(labels: Sequence[str]) -> list[str]:
    names: list[str] = []
    for label in labels:
        names.append(_free(label, names))
    return names


def _free(label: str, taken: Iterable[str]) -> str:
    """Return a name for a label that differs from those that are taken in more than case."""
    used = {name.lower() for name in taken}
    return next(name for name in _candidates(label) if name.lower() not in used)


def _candidates(label: str) -> Iterator[str]:
    """Yield the label as a name of ours, then with numbers behind it."""
    stem = _ILLEGAL.sub("_", label).strip("_") or "x"
    stem = stem if stem[0].isalpha() else f"x_{stem}"
    yield stem[:MAX_NAME]
    number = 2
    while True:
        yield f"{stem[: MAX_NAME - 8]}_{number}"
        number += 1
