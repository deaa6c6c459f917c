"""What an output is compared with: which input is its reference, told from what the inputs drive, and in which unit.

    e = r - y

An input that only loads drives (a torque or force beside the command of a drive) is a disturbance, unless the document says otherwise.
An output of the sum that takes y from r is e itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from engine.diagram.flatten import Flat
    from engine.diagram.realize import Wiring

ITSELF = "itself"
"""Stands for the reference of an output that is the error."""
ZERO = "0"
"""Stands for the reference where no input is one."""


@dataclass(frozen=True, kw_only=True)
class References:
    """Roles and units of inputs ("" where not known), the outputs that are errors themselves, and those that errors are made of."""

    roles: Mapping[str, str]
    input_units: Mapping[str, str]
    output_units: Mapping[str, str]
    errors: frozenset[str]
    measured: frozenset[str]

    @classmethod
    def of(cls, flat: Flat, wiring: Wiring, output_units: Mapping[str, str]) -> References:
        """Return what the connections of a diagram tell."""
        seen = _Seen(flat, wiring)
        roles, units = {}, {}
        for name in wiring.inputs:
            signal = seen.first_input + wiring.inputs.index(name)
            entry = flat.root.entries[name]
            roles[name] = str(entry.role)
            if not entry.role_given and seen.consumers(signal) and seen.loads_only(signal):
                roles[name] = "disturbance"
            units[name] = seen.unit(signal)
        commands = {seen.first_input + k for k, name in enumerate(wiring.inputs) if roles[name] == "reference"}
        errors = {signal: taken for signal in range(seen.first_input) if (taken := seen.taken(signal, commands))}
        measured = set().union(*errors.values())
        reads = dict(zip(wiring.outputs, wiring.reads, strict=True))
        return cls(
            roles=roles, input_units=units, output_units=output_units,
            errors=frozenset(name for name, read in reads.items() if read in errors),
            measured=frozenset(name for name, read in reads.items() if read in measured),
        )  # fmt: skip

    def input_of(self, driven: Iterable[str], output: str | None) -> str | None:
        """Return which of the inputs driven is the reference of an output; None where it is 0, or the output the error itself."""
        if output in self.errors:
            return None
        return next((name for name in driven if self.roles[name] == "reference"), None)

    def said(self, driven: Iterable[str], output: str | None) -> str:
        """Return what a reply says of the reference: the name of an input, `ZERO` or `ITSELF`."""
        return ITSELF if output in self.errors else self.input_of(driven, output) or ZERO

    def plain(self, driven: Iterable[str], output: str) -> bool:
        """Return whether the error of an output is reference minus output, and not the output itself or nothing at all."""
        return output not in self.errors and not self.unlike(driven, output)

    def unlike(self, driven: Iterable[str], output: str) -> str:
        """Return why an output cannot be taken from its reference, or an empty string."""
        name = self.input_of(driven, output)
        own, other = self.output_units.get(output, ""), "" if name is None else self.input_units[name]
        if not own or not other or own == other:
            return ""
        return (
            f"output {output} ({own}) must have the unit of its reference, got {name} ({other}): name an output in {other}, "
            "or give the input the role disturbance, whose wanted value is 0"
        )


class _Seen:
    """Blocks and connections as numbers of signals: the outputs of all blocks first, then the inputs."""

    def __init__(self, flat: Flat, wiring: Wiring) -> None:
        self._flat, self._sources = flat, wiring.sources
        self.first_input = sum(len(block.ports.outputs) for block in flat.blocks)
        self._makers = [
            (number, k) for number, block in enumerate(flat.blocks) for k in range(len(block.ports.outputs))
        ]
        self._consumers: dict[int, list[tuple[int, int]]] = {}
        for number, block in enumerate(flat.blocks):
            for k in range(len(block.ports.inputs)):
                self._consumers.setdefault(self._sources[block.first_input + k], []).append((number, k))

    def consumers(self, signal: int) -> list[tuple[int, int]]:
        """Return (block, number of its input) of all that a signal drives."""
        return self._consumers.get(signal, [])

    def loads_only(self, signal: int) -> bool:
        """Return whether all ways of a signal end in ports for loads; ways that meet again, as in a loop, do not."""
        waiting, seen = [signal], {signal}
        while waiting:
            driven = self.consumers(own := waiting.pop())
            if not driven and own != signal:
                return False
            for number, k in driven:
                block = self._flat.blocks[number]
                if block.ports.inputs[k] in block.ports.loads:
                    continue
                made = {block.first_output + j for j in range(len(block.ports.outputs))}
                if not made or made & seen:
                    return False
                waiting += made
                seen |= made
        return True

    def unit(self, signal: int) -> str:
        """Return the unit of an input, told from the ports that it drives and from what it is added to; "" where they do not tell."""
        found = set()
        for number, k in self.consumers(signal):
            block = self._flat.blocks[number]
            if block.ports.input_units:
                found.add(block.ports.input_units[k])
            elif self._flat.elements[number].kind == "sum":
                first = block.first_input
                found |= {self._made_in(self._sources[first + j]) for j in range(len(block.ports.inputs)) if j != k}
        found -= {None, ""}
        return str(found.pop()) if len(found) == 1 else ""

    def _made_in(self, signal: int) -> str | None:
        if not 0 <= signal < self.first_input:
            return None
        number, k = self._makers[signal]
        return self._flat.blocks[number].ports.output_units[k]

    def taken(self, signal: int, commands: set[int]) -> set[int]:
        """Return what is taken from a reference to make an error; nothing where the output of a block is no error."""
        number, _ = self._makers[signal]
        if self._flat.elements[number].kind != "sum":
            return set()
        block, values = self._flat.blocks[number], self._flat.numbers.bindings
        signs = str(
            values.blocks[number].fill({i: values.slots[i].value for i in values.blocks[number].slots})["signs"]
        )
        sources = [self._sources[block.first_input + k] for k in range(len(block.ports.inputs))]
        added = [source for source, sign in zip(sources, signs, strict=True) if sign == "+"]
        taken = {
            source
            for source, sign in zip(sources, signs, strict=True)
            if sign == "-" and 0 <= source < self.first_input
        }
        return taken if len(added) == 1 and added[0] in commands else set()
