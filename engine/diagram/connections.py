"""What drives what in a flat diagram: closed, or with one loop cut open."""

from __future__ import annotations

from typing import Final

from engine.diagram.flatten import Flat
from engine.diagram.realize import Wiring
from engine.diagram.scopes import Port, trace
from engine.diagram.scopes import Traced as TracedSignal
from engine.model.document import Remark
from engine.model.errors import DiagramError

Opening = str | tuple[str, ...]
"""Where a loop is opened: an output, or several opened together, of which the first is where the loop is cut."""

LOOP: Final = "loop"
"""Name of the input and the output that are added where a loop is cut open."""

_SILENT: Final = -1  # the signal that is always 0, whose final number depends on how many inputs there are
_REMEMBERED: Final = 64


class Wires:
    """The connections of a diagram, followed through its subsystems once.

    Attributes
    ----------
    inputs, outputs : tuple of str
        Names of the input blocks and of the declared outputs, in the order of the document.
    warnings : tuple of Remark
        Inputs that are not connected, and inputs of the diagram that drive nothing.
    """

    def __init__(self, flat: Flat) -> None:
        self._flat = flat
        self._total = sum(len(block.ports.outputs) for block in flat.blocks)
        self.inputs = tuple(name for name, entry in flat.root.entries.items() if entry.role is not None)
        self.outputs = tuple(flat.root.outputs)
        self._consumers, warnings = self._connect()
        self.warnings = tuple(warnings)
        self._reads = tuple(self._signal(trace(*end, at=("outputs", name))) for name, end in flat.root.outputs.items())
        self._wirings: dict[Opening | None, Wiring] = {}

    def wiring(self, open_at: Opening | None) -> Wiring:
        """Return what drives what, closed or with the loop cut at ``open_at``, remembered.

        What is opened besides is 0 behind the opening: a signal that does not arrive any more.

        Raises
        ------
        DiagramError
            If there is no such endpoint, two are places of one signal, or a name of the diagram is that of the cut's two ends.
        """
        wiring = self._wirings.get(open_at)
        if wiring is None:
            if len(self._wirings) >= _REMEMBERED:
                self._wirings.clear()
            wiring = self._wirings[open_at] = self._wire(open_at)
        return wiring

    def _wire(self, open_at: Opening | None) -> Wiring:
        others: frozenset[Port] = frozenset()
        if open_at is None:
            cut, inputs, outputs, reads = None, self.inputs, self.outputs, self._reads
        else:
            if LOOP in self.inputs or LOOP in self.outputs:
                raise DiagramError(f"no input or output must be called {LOOP} where a loop is opened, got one",
                                   at=("open_at",))  # fmt: skip
            cut, true_output, others = self._opened((open_at,) if isinstance(open_at, str) else open_at)
            inputs, outputs, reads = (*self.inputs, LOOP), (*self.outputs, LOOP), (*self._reads, true_output)
        silent = self._total + len(inputs)
        sources = [
            _SILENT if passed & others else self._total + len(self.inputs) if cut in passed else source
            for passed, source in self._consumers
        ]
        return Wiring(
            sources=tuple(silent if source == _SILENT else source for source in sources),
            inputs=inputs,
            outputs=outputs,
            reads=tuple(silent if read == _SILENT else read for read in reads),
        )

    def _opened(self, places: tuple[str, ...]) -> tuple[Port, int, frozenset[Port]]:
        """Return the port where the loop is cut, the signal there, and the ports that are opened besides."""
        found: dict[int, tuple[str, Port]] = {}
        for place in places:
            scope, block, port = self._flat.root.find_output(place, at=("open_at",))
            signal = self._signal(trace(scope, block, port, at=("open_at",)))
            if signal in found:
                raise DiagramError(
                    f"open_at must be places of different signals, got '{found[signal][0]}' and '{place}' of one",
                    at=("open_at",),
                )
            found[signal] = place, (*scope.path, block, port)
        (signal, (_, cut)), *others = found.items()
        return cut, signal, frozenset(port for _, (_, port) in others)

    def _signal(self, traced: TracedSignal) -> int:
        """Return the number of a signal: block outputs first, then inputs."""
        if traced.entry is None:
            return _SILENT
        if traced.entry.number is None:
            return self._total + self.inputs.index(traced.block)
        block = self._flat.blocks[traced.entry.number]
        return block.first_output + block.ports.outputs.index(traced.port)

    def _connect(self) -> tuple[list[tuple[frozenset[Port], int]], list[Remark]]:
        """Return for every block input which ports its signal passes and where it comes from, and what is not connected."""
        consumers: list[tuple[frozenset[Port], int]] = [(frozenset(), _SILENT)] * sum(
            len(block.ports.inputs) for block in self._flat.blocks
        )
        warnings: list[Remark] = []
        used: set[str] = set()
        for scope in self._flat.scopes:
            for name, entry in scope.entries.items():
                at = (*scope.at, "blocks", name)
                for j, port in enumerate(entry.ports.inputs):
                    source = scope.driven.get((name, port))
                    if source is None:
                        if entry.role is None:
                            label = scope.label(name, port)
                            warnings.append(Remark(at=at, detail=f"input {label} is not connected and stays 0"))
                    elif entry.number is not None:
                        traced = trace(scope, *source, at=at)
                        if traced.entry is not None and traced.entry.number is None:
                            used.add(traced.block)
                        place = self._flat.blocks[entry.number].first_input + j
                        consumers[place] = (frozenset(traced.passed), self._signal(traced))
        warnings.extend(
            Remark(at=("blocks", name), detail=f"input {name} drives nothing")
            for name in self.inputs
            if name not in used
        )
        return consumers, warnings
