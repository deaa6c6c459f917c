"""A checked, flattened diagram: structure compiled once, values many times.

`compile_system` refuses what is wrong with the place where it is wrong; `Diagram.realize` then gives the state space for
any parameter values, `Diagram.realize_stack` for many at once, in both cases closed or with one loop cut open.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.diagram import remarks
from engine.diagram.blocks import Blocks
from engine.diagram.channels import Channels
from engine.diagram.connections import LOOP, Opening, Wires
from engine.diagram.described import describe
from engine.diagram.flatten import Flat, flatten
from engine.diagram.laws import Laws
from engine.diagram.precise_dc_gain import ExactRest
from engine.diagram.rates import assemble_by_rates
from engine.diagram.realize import Interconnection, Wiring
from engine.diagram.references import References
from engine.elements import Realization
from engine.elements._base import Values
from engine.elements._sampler import Sampler
from engine.exact.laws.system import NonlinearSystem
from engine.exact.nonlinear.operating_point import OperatingPoint, operating_point
from engine.model.document import Block, Connection, Parameter, Remark, System
from engine.model.errors import DiagramError
from engine.model.failures import numerical
from engine.model.linear_system import ARRAYS, LaneSystem, LinearSystem, StackedSystem
from engine.model.many_digits import Formulas
from engine.model.parameters import Param, ParameterInfo
from engine.model.traced import Graph, Traced

__all__ = ["LOOP", "Block", "Connection", "Diagram", "Parameter", "ParameterInfo", "Remark", "System", "compile_system"]

_REMEMBERED: Final = 64


@numerical()
def compile_system(system: System) -> Diagram:
    """Check a system document and prepare it for any number of parameter values.

    Raises
    ------
    DiagramError, ExpressionError
        If the document is wrong; ``at`` is the path from its root.
    IllPosedError
        If an algebraic loop has no solution at the document's values.
    """
    flat = flatten(system)
    flat.numbers.settle()
    diagram = Diagram(system, flat)
    diagram.realize()
    return diagram


@dataclass(frozen=True, kw_only=True, eq=False)
class TracedDiagram:
    """Blocks whose coefficients are formulas: numbers, or `Traced` where they depend on a parameter.

    ``bounds`` are the values that have physical bounds. Nonlinear blocks are cut out, as `Diagram.laws` does it: ``laws``
    has the values of each, ``opened`` is the wiring without them.
    """

    graph: Graph
    realizations: tuple[Realization, ...]
    bounds: tuple[tuple[Param, Traced], ...]
    interconnection: Interconnection
    laws: tuple[Values, ...]
    opened: Wiring


class Diagram:
    """A compiled system. Made by `compile_system`; immutable to its users, safe to share.

    Attributes
    ----------
    system : System
        The document.
    inputs, outputs : tuple of str
        Names of the input blocks and of the declared outputs, in the order of the document.
    output_units : mapping of str to str
        Unit of each output, "" where it is not known.
    references : References
        What each output is compared with, and the roles of the inputs.
    parameters : mapping of str to ParameterInfo
        Every scalar by its path: ``kp``, ``motor.area``, ``inner.motor.area``. Entries of lists have no path.
    warnings : tuple of Remark
        Unconnected inputs and unused parameters.
    nonlinear : bool
        Whether a block is nonlinear. `realize` and its siblings then give the system linearised about its operating point,
        with all inputs 0 unless `about` says otherwise; `laws` gives the system itself.
    constants : mapping of input name to float
        Constant inputs of the operating point; 0 where left out.
    """

    def __init__(self, system: System, flat: Flat, constants: Mapping[str, float] | None = None) -> None:
        root = flat.root
        self.system = system
        self._wires = Wires(flat)
        self.inputs = self._wires.inputs
        self.outputs = self._wires.outputs
        self.output_units: Mapping[str, str] = {
            name: scope.unit_of(block, port) or "" for name, (scope, block, port) in root.outputs.items()
        }
        self.references = References.of(flat, self._wires.wiring(None), self.output_units)
        self._flat = flat
        self._interconnection = Interconnection(flat.blocks)
        self._channels = Channels(flat.blocks, flat.elements)
        self._samplers = Channels(flat.blocks, flat.elements, Sampler)
        self._systems: dict[tuple[Opening | None, bool], LinearSystem] = {}
        self.parameters: Mapping[str, ParameterInfo] = describe(flat.numbers)
        self.warnings = (*self._wires.warnings, *flat.warnings)
        self.constants: Mapping[str, float] = dict(constants or {})
        self._blocks = Blocks(flat, self.parameters)
        self._laws = Laws(self._blocks, self._channels, self._interconnection, self.constants)

    @property
    def nonlinear(self) -> bool:
        """Whether a block of the diagram is nonlinear."""
        return bool(self._channels)

    @property
    def sampled(self) -> bool:
        """Whether a block of the diagram takes samples."""
        return bool(self._samplers)

    @property
    def samplers_alone(self) -> bool:
        """Whether samplers, with limits or without, are all that is not linear in it."""
        return bool(self._samplers) and self._channels.numbers == self._samplers.numbers

    @property
    def sampled_alone(self) -> bool:
        """Whether samplers without limits are all that is not linear in it."""
        return self.samplers_alone and not remarks.limited(self.laws().laws)

    @property
    def reads_rates(self) -> bool:
        """Whether a block has outputs that its states' rates make."""
        return any(realization.reading is not None for realization in self._blocks.base)

    @property
    def linearization(self) -> tuple[Remark, ...]:
        """What a linearised answer must say: that it is one, and what stands for slopes that do not exist."""
        return remarks.linearization(self._channels, self.constants)

    @property
    def analysis(self) -> tuple[Remark, ...]:
        """What an answer over frequency must say: that it is linearised, and what it means with samplers."""
        if not self.sampled:
            return self.linearization
        return remarks.sampled(self._samplers, self._channels, self.laws().laws, self.constants)

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self.system, self.constants)

    def about(self, constants: Mapping[str, float]) -> Diagram:
        """Return the same diagram, its nonlinear blocks linearised where it rests under constant inputs.

        Parameters
        ----------
        constants : mapping of input name to float
            SI; 0 where left out.

        Raises
        ------
        DiagramError
            If there is no input of that name.
        """
        for name in constants:
            if name not in self.inputs:
                msg = f"input must be one of {', '.join(self.inputs) or '(none)'}, got '{name}'"
                raise DiagramError(msg, at=(name,))
        return Diagram(self.system, self._flat, constants)

    def operating_point(self, overrides: Mapping[str, float] | None = None) -> OperatingPoint:
        """Return where the diagram rests under its constant inputs, and whether it rests at all."""
        return operating_point(self.laws(overrides), self.constants)

    def around(self, law: str, overrides: Mapping[str, float] | None = None) -> LinearSystem:
        """Return what one nonlinear block sees of the rest: its output is the last input, its input the last output.

        All other nonlinear blocks are linearised. Outputs that read the block's own output read its input instead.

        Parameters
        ----------
        law : str
            Path of a nonlinear block with one input and one output.
        overrides : mapping, optional
            Parameter values (SI) by path.
        """
        realizations, values = self._blocks.changed(overrides or {})
        found = self._laws.linearized(realizations, values, self.wiring())
        number = next(n for n in self._channels.numbers if self._flat.blocks[n].path == law)
        found[number] = Realization.static(np.ones((1, 1)))
        return self._assemble(found, self._wires.wiring(law))

    def realize(
        self,
        overrides: Mapping[str, float | complex] | None = None,
        open_at: Opening | None = None,
        *,
        by_rates: bool = False,
    ) -> LinearSystem:
        """Return the state space of the diagram.

        Parameters
        ----------
        overrides : mapping of str to float or complex, optional
            New values (SI) by parameter path; an imaginary part is an infinitesimal that all coefficients follow.
        open_at : str or tuple of str, optional
            Endpoint (``error``, ``motor.position``, ``inner.error``) whose consumers are fed by an added last input
            ``loop`` instead; the true output is the added last output ``loop``. The loop transfer function is
            L = -(loop -> loop), so that 1 + L = 0 is the characteristic equation. Declared outputs that read the endpoint
            keep reading the true output. At a port of a subsystem only the consumers outside are cut.
        by_rates : bool
            Whether the rates that outputs are read from are delay channels of length 0, for `static_gain` and frequencies.

        Raises
        ------
        DiagramError
            If a path or endpoint does not exist, or a value is outside the physical bounds of an element.
        ExpressionError
            If an expression has no value.
        IllPosedError
            If an algebraic loop has no solution.
        """
        wiring = self._wires.wiring(open_at)
        if not overrides:
            system = self._systems.get((open_at, by_rates))
            if system is None:
                if len(self._systems) >= _REMEMBERED:
                    self._systems.clear()
                realizations = self._blocks.base
                if self.nonlinear:
                    realizations = self._laws.linearized(*self._blocks.changed({}), self.wiring())
                system = self._systems[open_at, by_rates] = self._assemble(realizations, wiring, by_rates=by_rates)
                for name in ARRAYS:
                    getattr(system, name).setflags(write=False)
            return system
        realizations, values = self._blocks.changed(overrides)
        if self.nonlinear:
            realizations = self._laws.linearized(realizations, values, self.wiring())
        return self._assemble(realizations, wiring, by_rates=by_rates)

    def laws(
        self, overrides: Mapping[str, float | complex] | None = None, steps: Mapping[str, float] | None = None
    ) -> NonlinearSystem:
        """Return the system with its nonlinear laws.

        Parameters
        ----------
        overrides : mapping, optional
            As in `realize`.
        steps : mapping of str to float, optional
            One lane for each parameter, as in `realize_lanes`.
        """
        if not steps:
            return self._laws.system(*self._blocks.changed(overrides or {}), self.wiring())
        plain = {path: value.real for path, value in (overrides or {}).items()}
        changed = self._blocks.changed_lanes(steps, plain)
        return self._laws.system(*changed, self.wiring(), np.ones(len(steps), dtype=bool))

    def realize_stack(
        self,
        overrides: Mapping[str, npt.NDArray[Any]],
        open_at: Opening | None = None,
        members: int | None = None,
        *,
        by_rates: bool = False,
    ) -> StackedSystem:
        """Return the state spaces for a batch of parameter sets, all with the same states.

        Parameters
        ----------
        overrides : mapping of str to ndarray (B,)
            Values (SI) by parameter path, float or complex.
        open_at, by_rates : optional
            As in `realize`.
        members : int, optional
            B, needed where ``overrides`` is empty.

        Returns
        -------
        StackedSystem
            Members that do not exist (a value outside its bounds, an expression without a value, an ill-posed loop, an
            overflow) have ``valid`` False and all matrices 0. A state or delay channel that a member does not need
            (ki = 0, delay = 0) is kept, stable and unseen.

        Raises
        ------
        DiagramError
            If a path or endpoint does not exist, or the arrays do not fit together.
        """
        batch = {path: np.asarray(value) for path, value in overrides.items()}
        sizes = {value.shape for value in batch.values()} | ({(members,)} if members is not None else set())
        if len(sizes) != 1 or len(next(iter(sizes))) != 1:
            raise DiagramError(f"overrides must be arrays of one length, got shapes {sorted(sizes)}")
        (count,) = next(iter(sizes))
        realizations, values, admitted = self._blocks.changed_members(batch, count)
        wiring = self._wires.wiring(open_at)
        with np.errstate(all="ignore"):
            if self.nonlinear:
                realizations = self._laws.linearized_members(realizations, values, self.wiring(), admitted)
            assemble = assemble_by_rates if by_rates else Interconnection.assemble
            assembled = assemble(self._interconnection, realizations, wiring, admitted=admitted)
        zeros = [value.real == 0 for value in values if isinstance(value, np.ndarray) and value.shape == (count,)]
        return StackedSystem(
            **assembled.matrices,
            valid=assembled.valid,
            zeros=np.array(zeros, dtype=bool).reshape(-1, count).T,
            inputs=wiring.inputs,
            outputs=wiring.outputs,
        )

    def admits(self, overrides: Mapping[str, npt.NDArray[Any]]) -> npt.NDArray[np.bool_]:
        """Return for a batch as in `realize_stack` which members have all their values, each within its bounds.

        One that has them may still lack a place in the stack, whose members share their states: where the coefficient of a
        highest power vanishes, say.
        """
        batch = {path: np.asarray(value) for path, value in overrides.items()}
        return self._blocks.admitted(batch, len(next(iter(batch.values()))))

    def realize_lanes(
        self,
        steps: Mapping[str, float],
        overrides: Mapping[str, float] | None = None,
        open_at: Opening | None = None,
        *,
        by_rates: bool = False,
    ) -> LaneSystem:
        """Return the state space with one lane for each parameter of ``steps``, which carries its infinitesimal.

        All lanes share their real part and their states, also where a single one would have fewer (ki = 0).

        Parameters
        ----------
        steps : mapping of str to float
            Size of the infinitesimal by parameter path: lane k has the value p_k + i step_k.
        overrides, open_at, by_rates
            As in `realize`, which tells what is raised, too.
        """
        values = {**{path: self._blocks.value(path) for path in steps}, **(overrides or {})}
        lanes = self._blocks.lanes(steps, overrides or {})
        stack = self.realize_stack(lanes, open_at, by_rates=by_rates)
        if not stack.valid.all():
            for path, step in steps.items():
                self.realize({**values, path: values[path] + 1j * step}, open_at, by_rates=by_rates)
            raise DiagramError("the infinitesimals of the system must be finite, but they overflow at these values")
        return LaneSystem(**{name: getattr(stack, name) for name in ARRAYS}, inputs=stack.inputs, outputs=stack.outputs)

    def sampled_laws(
        self,
        overrides: Mapping[str, float] | None = None,
        steps: Mapping[str, float] | None = None,
        open_at: Opening | None = None,
    ) -> NonlinearSystem:
        """Return the diagram with its samplers as they are, its only laws: other nonlinear blocks are linearised where it rests.

        Parameters
        ----------
        overrides, open_at
            As in `realize`, which tells what is raised, too.
        steps : mapping of str to float, optional
            One lane for each parameter, as in `realize_lanes`.
        """
        if steps:
            system, admitted = self.sampled_members(self._blocks.lanes(steps, overrides or {}), open_at)
            if not admitted.all():
                raise DiagramError("the infinitesimals of the system must be finite, but they overflow at these values")
            return system
        realizations, values = self._blocks.changed(overrides or {})
        realizations = self._laws.linearized(realizations, values, self.wiring())
        return self._laws.cut_out(self._samplers, realizations, values, self.wiring(open_at))

    def sampled_members(
        self, overrides: Mapping[str, npt.NDArray[Any]], open_at: Opening | None = None, *, linearized: bool = True
    ) -> tuple[NonlinearSystem, npt.NDArray[np.bool_]]:
        """Return the same for a batch as in `realize_stack`, which tells what is raised, too, and which members exist, (B,).

        Unless it is ``linearized``, other nonlinear blocks are laws beside the samplers.
        """
        batch = {path: np.asarray(value) for path, value in overrides.items()}
        with np.errstate(all="ignore"):
            realizations, values, admitted = self._blocks.changed_members(batch, len(next(iter(batch.values()))))
            if linearized and not self.samplers_alone:
                realizations = self._laws.linearized_members(realizations, values, self.wiring(), admitted)
            channels = self._samplers if linearized else self._channels
            system = self._laws.cut_out(channels, realizations, values, self.wiring(open_at), admitted)
        return system, admitted

    def trace(self, varied: Sequence[str], graph: Graph | None = None) -> TracedDiagram:
        """Return every coefficient of every block as a formula of the parameters ``varied``, written into ``graph``.

        Raises
        ------
        DiagramError, ExpressionError
            If a path does not exist or a block cannot be realised at the document's values.
        """
        graph = Graph() if graph is None else graph
        realizations, values, bounds = self._blocks.traced(varied, graph, self._channels.numbers)
        return TracedDiagram(
            graph=graph,
            realizations=tuple(self._channels.without(realizations)),
            bounds=bounds,
            interconnection=self._interconnection,
            laws=tuple(self._blocks.of(number, values) for number in self._channels.numbers),
            opened=self._channels.wiring(self._wires.wiring(None), self._interconnection.outputs),
        )

    def exact_rest(
        self, overrides: Mapping[str, float], moved: Sequence[str] | None = (), open_at: Opening | None = None
    ) -> ExactRest:
        """Return the gains at rest in many digits, of a linear diagram.

        They have a lane for each parameter ``moved``; where that is None, one for each number, by its logarithm.
        """
        graph = Graph()
        realizations, numbers, lanes = self._blocks.formulas(overrides, moved or (), graph)
        formulas = Formulas(graph, numbers, None if moved is None else lanes)
        count = len(numbers) if moved is None else len(moved)
        return ExactRest(realizations, formulas, self._interconnection, self._wires.wiring(open_at), count)

    def wiring(self, open_at: Opening | None = None) -> Wiring:
        """Return what drives what, closed or with the loop cut at ``open_at``; `realize` tells what is raised."""
        return self._wires.wiring(open_at)

    def _assemble(self, realizations: list[Realization], wiring: Wiring, *, by_rates: bool = False) -> LinearSystem:
        assemble = assemble_by_rates if by_rates else Interconnection.assemble
        assembled = assemble(self._interconnection, realizations, wiring)
        return LinearSystem(**assembled.matrices, inputs=wiring.inputs, outputs=wiring.outputs)


def _restored(system: System, constants: Mapping[str, float]) -> Diagram:
    made = compile_system(system)
    return made.about(constants) if constants else made
