"""Fast metrics of many candidates of a diagram in which samplers are all that is not linear."""

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
from engine.model.errors import UnresolvedError

if TYPE_CHECKING:
    from engine.analysis.measuring import MetricRequest
    from engine.diagram.connections import Opening
    from engine.diagram.diagram import Diagram
    from engine.exact.laws.system import NonlinearSystem
    from engine.model.linear_system import Array


class SampledBatch:
    """The batched evaluator of a diagram in which samplers, with limits or without, are all that is not linear.

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
        self._runs = runs_of(diagram, requests) if diagram.samplers_alone else []
        self._poles: dict[int, MetricRequest] = {}
        self._loops: dict[Opening, dict[int, MetricRequest]] = {}
        for column, request in enumerate(requests if diagram.samplers_alone else ()):
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
        system, exist = self._diagram.sampled_members(overrides)
        found = Screened.unknown(len(exist), len(self._requests), dtype=complex if moves else float)
        found.valid[:] = exist
        found.doubtful[~exist] = False
        if self._runs or self._poles:
            for rows in alike(system, exist):
                with suppress(UnresolvedError):
                    self._measure(system.members(rows), rows, found)
        for place, requests in self._loops.items():
            measure_loops(self._diagram, place, requests, overrides, found)
        return found

    def _measure(self, system: NonlinearSystem, rows: Array, found: Screened) -> None:
        """Enter what poles and responses of some members tell."""
        sampled = sampled_system(system)
        if np.isfinite(sampled.pace):
            return
        if self._poles:
            poles.measure_poles(self._poles, sampled, rows, found)
        for run in self._runs if not np.any(system.start) else ():
            follow_run(run, self._diagram, sampled, rows, found, self._threads)
