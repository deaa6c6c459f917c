"""Metrics of responses to any command, and of poles, for many candidates of a linear diagram."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch import stacks
from engine.batch.linear import poles
from engine.batch.linear.commands import Command, NotCoveredError
from engine.batch.linear.evaluate import Delayed, evaluate
from engine.batch.linear.response_requests import (
    INTEGRALS,
    ResponseRequests,
    plan_of,
)
from engine.batch.linear.spans import in_spans
from engine.batch.linear.spectra import Spectra, between
from engine.batch.linear.wanted import CODES, HELD, order_of, reaches, readings_of
from engine.batch.screened import Screened
from engine.model.errors import EngineError, UnresolvedError

if TYPE_CHECKING:
    from engine.analysis.measuring import MetricRequest
    from engine.diagram.diagram import Diagram
    from engine.model.linear_system import Array, StackedSystem

Flags = npt.NDArray[np.bool_]

_MOST_STATES: Final = 64
_MOST_CHANNELS: Final = 4
_LONGEST: Final = 1e9
_BESIDE: Final = 1e-6
_PARTS: Final = 4
"""Of an octave."""


class Responses:
    """The batched evaluator of those metrics of a diagram that responses and poles tell.

    Parameters
    ----------
    diagram : Diagram
    requests : sequence of MetricRequest
    varied : sequence of str
        Parameter paths that will vary.
    threads : int, optional
        As many as there are processors for this process by default.

    Attributes
    ----------
    measured : tuple of bool
        Which requests it answers; the others stay NaN and doubtful.
    """

    def __init__(
        self,
        diagram: Diagram,
        requests: Sequence[MetricRequest],
        varied: Sequence[str] = (),
        *,
        threads: int | None = None,
    ) -> None:
        self._diagram = diagram
        self._requests = tuple(requests)
        self._threads = threads or len(os.sched_getaffinity(0))
        self._responses: dict[tuple[Any, ...], ResponseRequests] = {}
        self._of_poles: list[int] = []
        covered, delayed = (False, False) if diagram.nonlinear or not requests else _covered(diagram, varied)
        for column, request in enumerate(self._requests):
            if covered and not delayed and request.metric in poles.METRICS:
                self._of_poles.append(column)
            elif covered and request.metric in CODES:
                self._register(column, request)
        mine = {column for response in self._responses.values() for column in response.columns} | set(self._of_poles)
        self.measured = tuple(column in mine for column in range(len(self._requests)))

    def _register(self, column: int, request: MetricRequest) -> None:
        diagram, output = self._diagram, str(request.output)
        order = order_of(diagram, request)
        if order is None:
            return
        key = tuple((name, id(signal)) for name, signal in request.signals.items())
        response = self._responses.get(key)
        if response is None:
            response = ResponseRequests(
                inputs=[diagram.inputs.index(name) for name in request.signals], signals=list(request.signals.values())
            )
            try:
                response.command(1.0)
            except (NotCoveredError, UnresolvedError):
                return
        if request.metric in HELD and response.endless and not reaches(request):
            return  # the exact path says how far it follows an endless response
        response.add(column, request, order, diagram.outputs.index(output))
        self._responses[key] = response

    def __call__(self, overrides: Mapping[str, Array], spectra: Spectra | None = None) -> Screened:
        """Return the metrics for arrays (B,) of parameter values; complex ones carry derivatives.

        ``spectra`` are those of the stack there, where known.
        """
        spectra = Spectra(self._diagram.realize_stack(overrides)) if spectra is None else spectra
        stack, here = spectra.stack, spectra.told
        members = len(stack.valid)
        kind = complex if any(np.iscomplexobj(values) for values in overrides.values()) else float
        found = Screened.unknown(members, len(self._requests), dtype=kind)
        found.valid[:] = stack.valid
        if not 0 < stack.a.shape[1] <= _MOST_STATES or stack.delays.shape[1] > _MOST_CHANNELS:
            return found
        growths = [np.full(members, -np.inf)]
        if self._of_poles:
            growths.append(self._poles_of_all(stack, here, overrides, found))
        growths += [self._response(response, spectra, found) for response in self._responses.values()]
        worst = np.max(growths, axis=0)  # NaN where one is not known
        known = np.nanmax(growths, axis=0)
        found.growth[here] = np.where(known >= 0, known, worst)[here]
        return found

    def _poles_of_all(
        self, stack: StackedSystem, here: Array, overrides: Mapping[str, Array], found: Screened
    ) -> Array:
        """Enter the metrics of poles, and return the growth: who has a number of 0 may have a state less, and is looked at with his like."""
        whole = np.asarray(~stack.zeros.any(axis=1))
        growth = self._poles(stack, here[whole[here]], found)
        if np.iscomplexobj(found.values):  # an infinitesimal keeps the state
            return growth
        others = here[~whole[here]]
        for members in (others[these] for these in stacks.alike(stack.zeros[others])):
            own = self._diagram.realize_stack({name: np.asarray(value)[members] for name, value in overrides.items()})
            part = Screened.unknown(len(members), len(self._requests))
            growth[members] = self._poles(own, np.flatnonzero(own.valid), part)
            found.values[np.ix_(members, np.array(self._of_poles))] = part.values[:, self._of_poles]
            found.doubtful[np.ix_(members, np.array(self._of_poles))] = part.doubtful[:, self._of_poles]
        return growth

    def _poles(self, stack: StackedSystem, here: Array, found: Screened) -> Array:
        growth = np.full(len(stack.valid), np.nan)
        if here.size:
            for column in self._of_poles:
                value, doubt, own = poles.measured(self._requests[column].metric, stack.a[here])
                found.values[here, column] = value if np.iscomplexobj(found.values) else value.real
                found.doubtful[here, column] = doubt
                growth[here] = own
        return growth

    def _response(self, response: ResponseRequests, spectra: Spectra, found: Screened) -> Array:
        """Enter the metrics of the responses to one command, and return the growth of what lies between it and its outputs."""
        stack, here = spectra.stack, spectra.told
        growth = np.full((2, len(stack.valid)), -np.inf)
        if not here.size:
            return np.full(len(stack.valid), np.nan)
        n, inputs, outputs = stack.a.shape[1], response.inputs, sorted(set(response.outputs))
        flow = spectra.flow[here]
        driven = np.concatenate([stack.b1, stack.d21], axis=1)[here][:, :, inputs]
        seen = np.concatenate([stack.c1, stack.d12], axis=2)[here][:, outputs]
        through = stack.d11[here][:, outputs][:, :, inputs]
        delays = stack.delays[here]
        for rows, kept, lanes in _alike(flow, driven, seen):
            states, lines = kept[kept < n], kept[kept >= n]
            if not len(states):
                growth[0, here[rows]] = np.nan
                continue
            part = response.of([outputs[lane] for lane in lanes])
            those, late = flow[rows][:, kept][:, :, kept], delays[rows][:, lines - n]
            values = spectra.roots(here[rows], kept)
            own = poles.growth_of(values)
            growth[0, here[rows]] = np.maximum(growth[0, here[rows]], own)
            growth[1, here[rows]] = np.fmax(growth[1, here[rows]], own)
            found.doubtful[np.ix_(here[rows][own >= 0], np.array(part.columns))] = False
            stable = np.flatnonzero(own < 0)
            if stable.size:
                these = rows[stable]
                self._follow(
                    part, those[stable], len(states), driven[these][:, kept], seen[these][:, lanes][:, :, kept],
                    through[these][:, lanes], late[stable], values[stable], found, here[these],
                )  # fmt: skip
        # What is unstable is so whatever is not known of others.
        return np.asarray(np.where(growth[1] >= 0, growth[1], growth[0]))

    def _follow(
        self, response: ResponseRequests, flow: Array, n: int, driven: Array, seen: Array, through: Array, delays: Array,
        values: Array, found: Screened, members: Array,
    ) -> None:  # fmt: skip
        """Enter the metrics of one response; the first n rows and columns are states, the others delay channels."""
        own = response.endless and np.isinf(response.until)
        if own:
            ends = poles.lifetime_of(values) + response.beyond
            ends = np.maximum(ends, response.marks[-1])
        else:
            ends = np.full(len(flow), response.until)
        ends = np.where((ends > _LONGEST) & np.isfinite(ends), np.nan, ends)
        for horizon, these in _horizons(ends) if own else [(response.until, slice(None))]:
            try:
                command = response.command(horizon if horizon <= _LONGEST else 0.0)
            except (NotCoveredError, UnresolvedError):
                continue
            parts = (part[these] for part in (flow, driven, seen, through, delays))
            self._follow_up_to(response, command, n, ends[these], found, members[these], *parts)

    def _follow_up_to(
        self, response: ResponseRequests, command: Command, n: int, ends: Array, found: Screened, members: Array, flow: Array,
        driven: Array, seen: Array, through: Array, delays: Array,
    ) -> None:  # fmt: skip
        """Enter the metrics of the responses to a command that is known far enough for them all."""
        plan, drive = plan_of(response, command)
        watched, wanted = readings_of(self._diagram, response, command)
        kind = np.result_type(flow, driven, seen, through, delays, found.values)
        arrays = [
            np.array(part, dtype=kind, order="C")
            for part in (
                flow[:, :n, :n], driven[:, :n], seen[:, :, :n], through, flow[:, :n, n:], flow[:, n:, :n], seen[:, :, n:],
                driven[:, n:], flow[:, n:, n:], delays,
            )
        ]  # fmt: skip
        numbers = np.full((len(flow), len(response.columns)), np.nan, dtype=kind)
        doubt = np.ones(numbers.shape, dtype=bool)

        def work(span: slice) -> None:
            a, b, c, d, *channels = (part[span] for part in arrays)
            evaluate(
                a, b, c, d, Delayed(*channels), plan, drive, watched, wanted, ends[span], numbers[span], doubt[span]
            )  # fmt: skip

        in_spans(members, work, self._threads)
        if drive.climbs:  # what is left of an error is the difference of two numbers that grow: the exact path decides
            for k, request in enumerate(response.requests):
                if request.metric in INTEGRALS and request.duration is None:
                    doubt[:, k] |= np.isfinite(numbers[:, k])
            numbers[doubt] = np.nan
        at = np.ix_(members, np.array(response.columns))
        found.values[at], found.doubtful[at] = numbers, doubt


def _covered(diagram: Diagram, varied: Sequence[str]) -> tuple[bool, bool]:
    """Return whether a diagram has states, not too many, and whether it has delays, or gets one where a parameter that varies is not 0."""
    values = {name: diagram.parameters[name].value for name in varied if name in diagram.parameters}
    try:
        stack = diagram.realize_stack({name: np.array([v, v or _BESIDE]) for name, v in values.items()}, members=2)
    except EngineError:
        return False, False
    channels = stack.delays.shape[1]
    return 0 < stack.a.shape[1] <= _MOST_STATES and channels <= _MOST_CHANNELS, channels > 0


def _horizons(ends: Array) -> list[tuple[float, Array]]:
    """Return up to when a command has to be known, s, and for whom: that is a quarter of an octave at a time, whoever else lives longer."""
    step = np.ceil(_PARTS * np.log2(ends))
    return [(float(2.0 ** (one / _PARTS)), np.flatnonzero(step == one)) for one in np.unique(step[np.isfinite(step)])]


def _alike(flow: Array, driven: Array, seen: Array) -> list[tuple[Array, Array, list[int]]]:
    """Return (members, states, outputs) for each pattern of what acts on what: outputs with the same states between them and the command."""
    count = len(flow)
    pattern = np.concatenate([(part != 0).reshape(count, -1) for part in (flow, driven, seen)], axis=1)
    found = []
    for members in stacks.alike(pattern):
        at = members[0]
        acts, reached = flow[at] != 0, (driven[at] != 0).any(axis=1)
        groups: dict[bytes, tuple[Array, list[int]]] = {}
        for output, own in enumerate(seen[at] != 0):
            kept = between(acts, reached, own)
            groups.setdefault(kept.tobytes(), (kept, []))[1].append(output)
        found += [(members, *group) for group in groups.values()]
    return found
