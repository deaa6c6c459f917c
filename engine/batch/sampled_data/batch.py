"""Fast metrics of many candidates of a diagram that is nonlinear at the instants of its samplers alone."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from engine.batch.sampled_data import loops, poles
from engine.batch.sampled_data.cycle import alike
from engine.batch.sampled_data.loops import measure_loops
from engine.batch.sampled_data.responses import follow_run, runs_of
from engine.batch.screened import Screened
from engine.exact.sampled_data.build import sampled_system
from engine.exact.sampled_data.followers import turns, with_outputs
from engine.model.errors import UnresolvedError

if TYPE_CHECKING:
    from engine.analysis.measuring import MetricRequest
    from engine.diagram.connections import Opening
    from engine.diagram.diagram import Diagram
    from engine.exact.laws.system import NonlinearSystem
    from engine.model.linear_system import Array


class SampledBatch:
    """The batched evaluator of a sampled diagram.

    Parameters
    ----------
    diagram : Diagram
    requests : sequence of MetricRequest
    threads : int, optional
        As many as there are processors for this process by default.

    Attributes
    ----------
    measured : tuple of bool
        Which requests it answers; the others stay NaN and doubtful.
    """

    def __init__(self, diagram: Diagram, requests: Sequence[MetricRequest], *, threads: int | None = None) -> None:
        self._diagram = diagram
        self._requests = tuple(requests)
        self._threads = threads or len(os.sched_getaffinity(0))
        self._runs = runs_of(diagram, requests) if at_samples_alone(diagram) else []
        self._poles: dict[int, MetricRequest] = {}
        self._loops: dict[Opening, dict[int, MetricRequest]] = {}
        for column, request in enumerate(requests):
            if poles.is_measured(request):
                self._poles[column] = request
            elif loops.is_measured(request):
                assert request.open_at is not None
                self._loops.setdefault(request.open_at, {})[column] = request
        mine = {column for run in self._runs for column in run.requests.columns}.union(
            self._poles, *self._loops.values()
        )
        self.measured = tuple(column in mine for column in range(len(self._requests)))

    def __call__(self, overrides: Mapping[str, Array]) -> Screened:
        """Return the metrics for arrays (B,) of parameter values; complex ones carry derivatives."""
        moves = any(np.iscomplexobj(values) for values in overrides.values())
        system, exist = self._diagram.sampled_members(overrides, linearized=False)
        found = Screened.unknown(len(exist), len(self._requests), dtype=complex if moves else float)
        found.valid[:] = exist
        found.doubtful[~exist] = False
        if self._runs:
            for rows in alike(system, exist):
                with suppress(UnresolvedError):
                    self._follow(system.members(rows), rows, found)
        if self._poles:
            alone = self._diagram.samplers_alone
            linear, rest = (system, exist) if alone else self._diagram.sampled_members(overrides)
            for rows in alike(linear, exist & rest):
                with suppress(UnresolvedError):
                    sampled = sampled_system(linear.members(rows))
                    if not np.isfinite(sampled.pace):
                        poles.measure_poles(self._poles, sampled, rows, found)
        for place, requests in self._loops.items():
            measure_loops(self._diagram, place, requests, overrides, found)
        return found

    def _follow(self, system: NonlinearSystem, rows: Array, found: Screened) -> None:
        """Enter what the responses of some members tell."""
        looked_at = sorted({output for run in self._runs for output in run.requests.outputs})
        others = turns(system, looked_at)
        if others is None or np.any(system.matrices["x0"]):
            return
        sampled = sampled_system(with_outputs(system), others=others)
        for run in self._runs if not np.isfinite(sampled.pace) else ():
            follow_run(run, self._diagram, sampled, rows, found, self._threads)


def at_samples_alone(diagram: Diagram) -> bool:
    """Return whether nothing is nonlinear in a sampled diagram but at the instants of its samplers."""
    return diagram.sampled and (diagram.samplers_alone or turns(diagram.laws(), ()) is not None)
