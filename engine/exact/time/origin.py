"""What a response is counted from: from where it goes, a small tail keeps digits that the output itself has no room for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from engine.model.linear_system import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Origin:
    """A state (lanes, n), inputs (1 or lanes, inputs) and signals to be delayed (lanes, m) that solve the equations at rest."""

    x: Array
    u: Array
    z: Array

    @property
    def value(self) -> Origin:
        """The common real part alone, as one lane."""
        return Origin(x=self.x[:1].real, u=self.u[:1].real, z=self.z[:1].real)
