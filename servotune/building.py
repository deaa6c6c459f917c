"""Systems that are built block by block, in a script or a notebook, in place of a document typed as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from servotune.encoding import encoded


class System(dict[str, Any]):
    """A system document; a dictionary as the API documents it, so it goes wherever a document goes.

    Parameters
    ----------
    name : str
    parameters
        Named values that blocks share through expressions: numbers, or what `quantity` returns.

    Examples
    --------
    ::

        axis = System("axis", kp=quantity(12, "1/s", lower=1, upper=50))
        reference, error = axis.add("input", "reference"), axis.add("sum", "error", signs="+-")
        drive = axis.add("transfer_function", "drive", numerator=[1], denominator=[0.02, 1, 0])
        reference >> error["in1"]
        error >> axis.add("gain", "controller", gain="=kp") >> drive >> error["in2"]
        axis.output("position", drive)
        client.simulate(axis, input={"port": "reference", "signal": {"kind": "step"}})
    """

    def __init__(self, name: str, /, **parameters: Any) -> None:
        super().__init__(name=name, blocks={}, connections=[], outputs={})
        if parameters:
            self["parameters"] = parameters

    def add(self, kind: str | Mapping[str, Any], name: str, /, **values: Any) -> Place:
        """Add a block, and return the place of it: what it is connected by.

        Parameters
        ----------
        kind : str or mapping
            One of the catalogue, or another system, which becomes a subsystem.
        name : str
        values
            Parameters of the block: numbers, quantities, expressions such as "=2*kp".

        Raises
        ------
        ValueError
            The name is taken.
        """
        if name in self["blocks"]:
            raise ValueError(f"a block must have a name of its own, {name!r} is taken in {self['name']!r}")
        self["blocks"][name] = (
            {"kind": kind} | values if isinstance(kind, str) else {"kind": "subsystem", "system": kind}
        )
        return Place(system=self, path=name)

    def __getattr__(self, name: str) -> Place:
        """Return the place of a block."""
        blocks = self.get("blocks", {})  # a copy that is being made has none yet
        if name in blocks:
            return Place(system=self, path=name)
        raise AttributeError(f"this system has no block {name!r}; it has {', '.join(blocks) or 'none'}")

    def connect(self, source: Place | str, target: Place | str) -> None:
        """Lead a signal from one place to another."""
        self["connections"].append({"from": str(source), "to": str(target)})

    def output(self, name: str, source: Place | str) -> None:
        """Name a signal that is an output."""
        self["outputs"][name] = str(source)

    def to_json(self) -> str:
        """Return the document as JSON.

        Raises
        ------
        DocumentError
            A value is none that JSON has.
        """
        return json.dumps(encoded(self), indent=2, ensure_ascii=False)

    def save(self, path: Path | str) -> None:
        """Write the document into a file."""
        Path(path).write_text(f"{self.to_json()}\n", encoding="utf-8")

    def __repr__(self) -> str:
        counted = f"{len(self['blocks'])} blocks, {len(self['connections'])} connections"
        return f"<System {self['name']!r}: {counted}, outputs {', '.join(self['outputs']) or 'none yet'}>"


@dataclass(frozen=True, slots=True)
class Place:
    """A block of a system, or one of its ports: ``block["in1"]``; ``a >> b`` leads the signal of a to b and returns b."""

    system: System
    path: str

    def __getitem__(self, port: str) -> Place:
        return Place(self.system, f"{self.path}.{port}")

    def __rshift__(self, target: Place) -> Place:
        if target.system is not self.system:
            raise ValueError(
                f"both ends of a connection must be in one system, got {self.system!r} and {target.system!r}"
            )
        self.system.connect(self, target)
        return Place(self.system, target.path.partition(".")[0])

    def __str__(self) -> str:
        return self.path


def quantity(
    value: float,
    unit: str | None = None,
    *,
    lower: float | None = None,
    upper: float | None = None,
    doc: str | None = None,
) -> dict[str, Any]:
    """Return a number with its unit, and as a parameter with the bounds between which a search may choose it (in the same unit)."""
    bounds = {"lower": lower, "upper": upper}
    given = {
        name: {"value": bound, "unit": unit} if unit else bound for name, bound in bounds.items() if bound is not None
    }
    return {"value": value} | ({"unit": unit} if unit else {}) | given | ({"doc": doc} if doc else {})
