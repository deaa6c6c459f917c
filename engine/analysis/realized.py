"""One diagram at one set of values, with infinitesimals: its systems, and their poles, each computed once.

A derivative is asked for by naming parameters: every one becomes a lane, p + i·1e-30·max(|p|, tiny), and all that is
computed from then on carries ∂/∂p beside the value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.analysis.commanded import CommandParameter
from engine.analysis.dc_gain import Resting
from engine.analysis.derivatives import with_rate
from engine.exact.frequency.path import connected, merged
from engine.exact.frequency.poles import Poles, poles
from engine.exact.sampled_data.build import sampled_system
from engine.exact.sampled_data.poles import sampled_poles
from engine.model.errors import DiagramError, IllPosedError, UnresolvedError
from engine.model.linear_system import LaneSystem
from engine.model.names import no_parameter
from engine.model.tangent import INFINITESIMAL, slopes

if TYPE_CHECKING:
    from engine.diagram.connections import Opening
    from engine.diagram.diagram import Diagram
    from engine.exact.sampled_data.system import SampledSystem
    from engine.model.linear_system import Array


class RealizedDiagram:
    """The systems of a diagram at given values.

    Parameters
    ----------
    diagram : Diagram
    overrides : mapping, optional
        Parameter values (SI) by path that replace the document's.
    gradient : sequence of str, optional
        Parameters whose derivatives are wanted; each is a lane.
    commands : sequence of CommandParameter, optional
        Numbers of commands whose derivatives are wanted, in place of ``gradient``; each is a lane.
    """

    def __init__(
        self,
        diagram: Diagram,
        overrides: Mapping[str, float] | None = None,
        gradient: Sequence[str] = (),
        commands: Sequence[CommandParameter] = (),
    ) -> None:
        self.diagram = diagram
        self.overrides = dict(overrides or {})
        self.gradient = tuple(gradient)
        self.commands = tuple(commands)
        self._scales = np.array(
            [command.scale for command in self.commands] or [self._scale(name) for name in self.gradient]
        )
        self._steps = {name: INFINITESIMAL * self._scale(name) for name in self.gradient}
        self._resting = Resting(diagram, self.overrides, self._steps)
        self._rates: dict[Opening | None, LaneSystem | None] = {}
        self._poles: dict[bytes, Poles] = {}
        self._rated: LaneSystem | None = None

    def _scale(self, name: str) -> float:
        value = self.value_of(name)
        return abs(value) if value else 1.0

    def value_of(self, name: str) -> float:
        """Return the value of a parameter here."""
        if name in self.overrides:
            return float(self.overrides[name])
        info = self.diagram.parameters.get(name)
        if info is None:
            raise DiagramError(no_parameter(name, self.diagram.parameters), at=("parameters", name))
        return info.value

    def changing_rates(self, names: Sequence[str]) -> set[str]:
        """Return those parameters that change the ratio of two sample times."""
        if not self.diagram.sampled or not names:
            return set()
        steps = {name: INFINITESIMAL * self._scale(name) for name in names}
        try:
            changed = sampled_system(self.diagram.sampled_laws(self.overrides, steps)).uneven
        except UnresolvedError:  # too much is under way in pure delays: nothing needs the common period
            return set()
        return {name for name, uneven in zip(names, changed, strict=True) if uneven}

    def derivatives(self, value: Array) -> npt.NDArray[np.float64]:
        """Return d value / d p for every lane, shape (lanes,), from a value of shape (lanes,)."""
        return np.asarray(np.broadcast_to(slopes(value), (len(self._scales),)) / self._scales)

    @property
    def lanes(self) -> tuple[str | CommandParameter, ...]:
        """What the lanes are the derivatives by."""
        return self.commands or self.gradient

    def _realize(self, open_at: Opening | None) -> LaneSystem:
        return merged(self._realized(open_at).balanced())

    def _realized(self, open_at: Opening | None, *, by_rates: bool = False) -> LaneSystem:
        if not self.gradient:
            return LaneSystem.of([self.diagram.realize(self.overrides, open_at, by_rates=by_rates)])
        return self.diagram.realize_lanes(self._steps, self.overrides, open_at, by_rates=by_rates)

    def _by_rates(
        self, part: LaneSystem, inputs: Sequence[int], outputs: Sequence[int], open_at: Opening | None = None
    ) -> LaneSystem:
        """Return ``part`` with the rates that are read as signals of their own, which no difference of large numbers makes.

        It stays as it is where it has none, where hidden states were left out of it, and where its direct gains without the
        rates make a loop that has no solution.
        """
        if not self.diagram.reads_rates:
            return part
        if open_at not in self._rates:
            try:
                self._rates[open_at] = self._realized(open_at, by_rates=True).balanced(self._realized(open_at))
            except IllPosedError:
                self._rates[open_at] = None
        whole = self._rates[open_at]
        if whole is None:
            return part
        found = connected(whole, inputs, outputs)
        return found if found.n == part.n else part

    @cached_property
    def system(self) -> LaneSystem:
        """The closed system, all inputs and outputs."""
        return self._realize(None)

    @property
    def rated(self) -> LaneSystem:
        """The closed system with the derivatives of outputs that were asked for as further outputs."""
        return self.system if self._rated is None else self._rated

    def _rate(self, output: str, order: int) -> tuple[str, int]:
        """Return the output that is the derivative of one, as far as the equations give it, and how often it is still to be differentiated."""
        name = output
        for done in range(order):
            following = f"{name}'"
            if following not in self.rated.outputs:
                found = with_rate(self.rated, self.output_index(name), following)
                if found is None:
                    return name, order - done
                self._rated = found
            name = following
        return name, 0

    @cached_property
    def _sampled(self) -> SampledSystem:
        return sampled_system(self.diagram.sampled_laws(self.overrides, self._steps))

    @cached_property
    def poles(self) -> Poles:
        """Poles of the whole closed system; with samplers those of the map over their common period."""
        return sampled_poles(self._sampled) if self.diagram.sampled else self._poles_of(self.system)

    @cached_property
    def pace(self) -> Poles:
        """Poles that tell how long things last: with samplers those of their continuous stand-ins."""
        return self._poles_of(self.system)

    def _poles_of(self, part: LaneSystem) -> Poles:
        """Return the poles of a part; many paths share one."""
        key = b"|".join(np.ascontiguousarray(m).tobytes() for m in (part.a, part.b2, part.c2, part.d22, part.delays))
        if key not in self._poles:
            self._poles[key] = poles(part)
        return self._poles[key]

    def input_index(self, name: str) -> int:
        """Return the number of an input.

        Raises
        ------
        DiagramError
            When there is none of that name.
        """
        return _index(self.diagram.inputs, name, "input")

    def output_index(self, name: str) -> int:
        """Return the number of an output; see :meth:`input_index`."""
        if self._rated is not None and name in self._rated.outputs:
            return self._rated.outputs.index(name)
        return _index(self.diagram.outputs, name, "output")


def _index(names: tuple[str, ...], name: str, what: str) -> int:
    if name not in names:
        msg = f"{what} must be one of the system's ({', '.join(names)}), got '{name}'"
        raise DiagramError(msg, at=(what, name))
    return names.index(name)
