"""Fast metrics of many candidates of one diagram: what an optimiser looks at, never what a user is shown.

The compiled kernels answer what they cover: step responses, loops and paths of linear systems without delays; of nonlinear ones
responses to any command, marched, where their laws are formulas of the instant. Everything else, and
every candidate for which they cannot vouch, goes to the batched collocation of `engine.batch.collocation.screening`; what that cannot
vouch for either is flagged doubtful and belongs to the exact path.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from engine.batch.collocation.screening import Screened
from engine.batch.collocation.screening import Screening as Collocation
from engine.batch.kernels.batch import Batch, Slopes, UnsuitableError
from engine.batch.kernels.readings import TIME_READINGS
from engine.batch.nonlinear.batch import NonlinearBatch
from engine.model.errors import EngineError
from engine.model.traced import UnsuitableError as NoFormulaError

if TYPE_CHECKING:
    from engine.analysis.measuring import MetricRequest
    from engine.batch.kernels.batch import Results
    from engine.diagram.diagram import Diagram
    from engine.model.linear_system import Array

__all__ = ["Screened", "Screening", "Slopes"]

_AGREED = 1e-4
"""Relative difference of two methods that mean the same; collocation alone is right to about 1e-6."""


class Screening:
    """The batched evaluator of some metrics of a diagram.

    Parameters
    ----------
    diagram : Diagram
    requests : sequence of MetricRequest
    threads : int, optional
        How many threads the kernels use; as many as there are processors for this process by default.

    Attributes
    ----------
    measurable : tuple of bool
        Which requests can be screened at all.
    """

    def __init__(self, diagram: Diagram, requests: Sequence[MetricRequest], *, threads: int | None = None) -> None:
        self._diagram = diagram
        self._threads = threads
        self._requests = tuple(requests)
        self._all = Collocation(diagram, requests)
        self.measurable = self._all.measurable
        self._batches: dict[tuple[str, ...], Batch | None] = {}
        self._marches: dict[tuple[str, ...], NonlinearBatch | None] = {}
        self._rest: dict[tuple[int, ...], Collocation] = {}

    def compiled(self, parameters: Sequence[str]) -> bool:
        """Return whether compiled kernels answer every request, for these parameters varied."""
        batch = self._batch(tuple(parameters))
        return batch is not None and all(batch.measured)

    def __call__(self, overrides: Mapping[str, Array], *, second_opinion: bool = True) -> Screened:
        """Return the metrics for arrays (B,) of parameter values; those that are not measurable stay NaN and doubtful.

        Complex overrides carry derivatives, by collocation. Without a second opinion, what the kernels doubt stays so.
        """
        return self._with_odd_members(overrides, self._screened(overrides, second_opinion=second_opinion))

    def _with_odd_members(self, overrides: Mapping[str, Array], found: Screened) -> Screened:
        """Leave to the exact path what has no place in a batch and yet no value out of bounds.

        All candidates of a batch share their states; one that has fewer, as the coefficient of its highest power is 0,
        is a system all the same.
        """
        if not found.valid.all():
            missing = np.flatnonzero(~found.valid)
            here = missing[self._diagram.admits({name: np.asarray(v)[missing] for name, v in overrides.items()})]
            found.valid[here], found.doubtful[here], found.values[here] = True, True, np.nan
            found.growth[here] = np.nan
        return found

    def _screened(self, overrides: Mapping[str, Array], *, second_opinion: bool) -> Screened:
        if self._diagram.nonlinear:
            return self._marched(overrides)
        points = _side_by_side(overrides.values())
        batch = None if np.iscomplexobj(points) else self._batch(tuple(overrides))
        if batch is None:
            return self._all(overrides)
        asked = partial(self._second_opinion, batch, overrides) if second_opinion else None
        found = batch(points, threads=self._threads, then=asked)
        others = tuple(k for k, own in enumerate(batch.measured) if self.measurable[k] and not own)
        if others:
            rest = self._only(others)(overrides)
            columns = list(others)
            found.values[:, columns], found.doubtful[:, columns] = rest.values, rest.doubtful
        return Screened(values=found.values, doubtful=found.doubtful, growth=found.growth, valid=found.valid)

    def _second_opinion(self, batch: Batch, overrides: Mapping[str, Array], found: Results, span: slice) -> None:
        """Ask collocation for the responses of a span for which the kernels could not vouch.

        Two methods that agree have found the same event, and the kernels' value of it is the more exact one. In frequency
        both read a table and may err alike.
        """
        mine = np.array(
            [k for k, own in enumerate(batch.measured) if own and self._requests[k].metric in TIME_READINGS], int
        )
        values, doubtful, growth = found.values[span], found.doubtful[span], found.growth[span]
        exists = found.valid[span] & ~(growth >= 0)
        unsure = np.flatnonzero(doubtful[:, mine].any(axis=1) & exists)
        if not unsure.size:
            return
        part = {name: np.asarray(column)[span][unsure] for name, column in overrides.items()}
        again = self._only(tuple(mine.tolist()))(part)
        first, second = values[np.ix_(unsure, mine)], again.values
        agree = (np.abs(first - second) <= _AGREED * np.abs(second)) | (np.isnan(first) & np.isnan(second))
        vouched = ~again.doubtful & (again.growth < 0)[:, None]
        open_ = doubtful[np.ix_(unsure, mine)] & ~(agree & vouched)
        values[np.ix_(unsure, mine)] = np.where(open_ & vouched, second, first)
        doubtful[np.ix_(unsure, mine)] = open_
        growth[unsure] = np.where(np.isnan(growth[unsure]), again.growth, growth[unsure])

    def slopes(self, overrides: Mapping[str, Array], directions: Mapping[str, Array]) -> Slopes | None:
        """Return metrics with their exact derivatives by compiled kernels; None where these do not answer every request.

        Parameters
        ----------
        overrides : mapping of str to ndarray, shape (B,)
            Parameter values, SI.
        directions : mapping of str to ndarray, shape (B, D)
            By how much each parameter changes for the same infinitesimal change of D variables.
        """
        batch = None if self._diagram.nonlinear else self._batch(tuple(overrides))
        if batch is None or not all(batch.measured):
            return None
        return batch.slopes(_side_by_side(overrides.values()), _side_by_side(directions[name] for name in overrides))

    def _marched(self, overrides: Mapping[str, Array]) -> Screened:
        """Return the metrics of a nonlinear diagram."""
        points = _side_by_side(overrides.values())
        march = None if np.iscomplexobj(points) else self._march(tuple(overrides))
        return self._all(overrides) if march is None else march(points, threads=self._threads)

    def _march(self, varied: tuple[str, ...]) -> NonlinearBatch | None:
        """Return what marches a nonlinear diagram; None where its laws are no formulas."""
        if varied not in self._marches:
            try:
                self._marches[varied] = NonlinearBatch(self._diagram, varied, self._requests)
            except (NoFormulaError, EngineError):
                self._marches[varied] = None
        return self._marches[varied]

    def _batch(self, varied: tuple[str, ...]) -> Batch | None:
        """Return the kernels' evaluator for parameters that vary; None where they do not cover the diagram."""
        if varied not in self._batches:
            try:
                self._batches[varied] = Batch(self._diagram, varied, self._requests)
            except (UnsuitableError, EngineError, ZeroDivisionError):
                self._batches[varied] = None
        return self._batches[varied]

    def _only(self, columns: tuple[int, ...]) -> Collocation:
        if columns not in self._rest:
            self._rest[columns] = Collocation(self._diagram, [self._requests[column] for column in columns])
        return self._rest[columns]


def _side_by_side(arrays: Iterable[Array]) -> Array:
    """Return arrays of one shape (B, ...) as one (B, arrays, ...): `numpy.stack`, which takes longer to look at them than to copy."""
    return np.concatenate([np.asarray(array)[:, None] for array in arrays], axis=1)
