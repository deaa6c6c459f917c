"""Where the nonlinear blocks of a diagram meet its linear part: their outputs become inputs of it, their inputs outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from engine.diagram.realize import FlatBlock, Wiring
from engine.elements import Element, Realization
from engine.elements._base import Values
from engine.elements._nonlinear import NonlinearElement
from engine.exact.laws.laws import Law, law_values
from engine.exact.laws.system import NonlinearSystem

Array = npt.NDArray[Any]


class Channels:
    """The nonlinear blocks of a flattened diagram, or those of one ``kind``.

    Attributes
    ----------
    numbers : tuple of int
        Which of the diagram's blocks are nonlinear.
    """

    def __init__(
        self,
        blocks: Sequence[FlatBlock],
        elements: Sequence[type[Element]],
        kind: type[NonlinearElement] = NonlinearElement,
    ) -> None:
        self._blocks = blocks
        self._elements: dict[int, type[NonlinearElement]] = {
            number: element for number, element in enumerate(elements) if issubclass(element, kind)
        }
        self.numbers = tuple(self._elements)
        self._channel: dict[int, int] = {}
        for number in self.numbers:
            block = blocks[number]
            for k in range(len(block.ports.outputs)):
                self._channel[block.first_output + k] = len(self._channel)

    def __bool__(self) -> bool:
        return bool(self.numbers)

    def notes(self) -> list[tuple[FlatBlock, str]]:
        """Return what stands for a slope that does not exist, for each block that needs it."""
        return [(self._blocks[n], element.note) for n, element in self._elements.items() if element.note]

    def wiring(self, closed: Wiring, outputs: int) -> Wiring:
        """Return ``closed`` with the nonlinear blocks taken out; ``outputs`` is the number of all block outputs."""
        count = len(closed.inputs)
        silent = outputs + count

        def moved(source: int) -> int:
            if source == silent:
                return outputs + count + len(self._channel)
            channel = self._channel.get(source)
            return source if channel is None else outputs + count + channel

        entering = [
            closed.sources[self._blocks[n].first_input + k]
            for n in self.numbers
            for k in range(len(self._blocks[n].ports.inputs))
        ]
        return Wiring(
            sources=tuple(moved(source) for source in closed.sources),
            inputs=(*closed.inputs, *(f"law {k}" for k in range(len(self._channel)))),
            outputs=(*closed.outputs, *(f"law {k}" for k in range(len(entering)))),
            reads=tuple(moved(read) for read in (*closed.reads, *entering)),
        )

    def without(self, realizations: Sequence[Realization]) -> list[Realization]:
        """Return the realisations with nothing in place of the nonlinear blocks."""
        found = list(realizations)
        for n in self.numbers:
            ports = self._blocks[n].ports
            found[n] = Realization.static(np.zeros((len(ports.outputs), len(ports.inputs))))
        return found

    def system(self, matrices: Mapping[str, Array], closed: Wiring, values: Mapping[int, Values]) -> NonlinearSystem:
        """Return the system from the matrices of the linear part, (lanes, ...) or (...), and the blocks' values."""
        arrays = {name: array if _batched(name, array) else array[None] for name, array in matrices.items()}
        u, y = len(closed.inputs), len(closed.outputs)
        split = {
            "a": arrays["a"], "b1": arrays["b1"][..., :u], "b2": arrays["b2"], "b3": arrays["b1"][..., u:],
            "c1": arrays["c1"][:, :y], "c2": arrays["c2"], "c3": arrays["c1"][:, y:],
            "d11": arrays["d11"][:, :y, :u], "d12": arrays["d12"][:, :y], "d13": arrays["d11"][:, :y, u:],
            "d21": arrays["d21"][..., :u], "d22": arrays["d22"], "d23": arrays["d21"][..., u:],
            "d31": arrays["d11"][:, y:, :u], "d32": arrays["d12"][:, y:], "d33": arrays["d11"][:, y:, u:],
            "delays": arrays["delays"], "x0": arrays["x0"],
        }  # fmt: skip
        laws: list[Law] = []
        state, e, v = arrays["a"].shape[-1], 0, 0
        for n, element in self._elements.items():
            block = self._blocks[n]
            lanes, real = law_values(values[n])
            states = len(element.initial(real))
            inputs, outputs = len(block.ports.inputs), len(block.ports.outputs)
            laws.append(
                Law(
                    element=element, label=block.path, at=block.at, values=lanes, real=real,
                    states=slice(state, state + states), inputs=slice(e, e + inputs), outputs=slice(v, v + outputs),
                )
            )  # fmt: skip
            state, e, v = state + states, e + inputs, v + outputs
        return NonlinearSystem(split, laws, closed.inputs, closed.outputs)


def _batched(name: str, array: Array) -> bool:
    return array.ndim > (1 if name in {"delays", "x0"} else 2)
