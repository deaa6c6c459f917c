"""What continuous and discrete state spaces share: four matrices, and ports that follow from them."""

from __future__ import annotations

from collections.abc import Sequence

from engine.elements._base import Ports, Values
from engine.model.errors import DiagramError
from engine.model.parameters import Param

MAX_PORTS = 64

MATRICES = (
    Param(name="A", symbol="A", shape="matrix", doc="rows of the n x n dynamic matrix (empty list: no states)"),
    Param(name="B", symbol="B", shape="matrix", doc="rows of the n x inputs matrix"),
    Param(name="C", symbol="C", shape="matrix", doc="rows of the outputs x n matrix"),
    Param(name="D", symbol="D", shape="matrix", doc="rows of the outputs x inputs feed-through matrix"),
    Param(
        name="inputs",
        symbol="u",
        shape="names",
        required=False,
        doc="names of the inputs, one for each column of D",
    ),
    Param(name="outputs", symbol="y", shape="names", required=False, doc="names of the outputs, one for each row of D"),
)


def check(values: Values) -> None:
    """Refuse matrices whose sizes do not fit, and names that are not one for each port."""
    states, outputs = len(values["A"]), len(values["D"])
    inputs = len(values["D"][0]) if outputs else 0
    if not 1 <= inputs <= MAX_PORTS or not 1 <= outputs <= MAX_PORTS:
        raise DiagramError(
            f"D must have 1 to {MAX_PORTS} rows (outputs) and columns (inputs), got {outputs} x {inputs}", at=("D",)
        )
    for name, rows, columns in (("A", states, states), ("B", states, inputs), ("C", outputs, states)):
        got = values[name]
        width = len(got[0]) if got else columns
        empty = name == "C" and states == 0 and not got
        if not empty and (len(got) != rows or width != columns):
            raise DiagramError(
                f"{name} must be {rows} x {columns} to fit A and D, got {len(got)} x {width}", at=(name,)
            )

    for name, count in (("inputs", inputs), ("outputs", outputs)):
        names = values[name]
        if names is not None and (len(names) != count or len(set(names)) != count):
            raise DiagramError(
                f"{name} must be {count} different names to fit D, got {', '.join(names[:MAX_PORTS]) or 'none'}",
                at=(name,),
            )


def ports(values: Values) -> Ports:
    """Return the ports that are named, or that the size of D tells."""
    outputs, inputs = len(values["D"]), len(values["D"][0])
    return Ports(
        inputs=_names(values.get("inputs"), "in", inputs),
        outputs=_names(values.get("outputs"), "out", outputs),
        output_units=(None,) * outputs,
    )


def _names(given: Sequence[str] | None, word: str, count: int) -> tuple[str, ...]:
    if given is not None:
        return tuple(given)
    return (word,) if count == 1 else tuple(f"{word}{i + 1}" for i in range(count))
