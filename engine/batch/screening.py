"""Fast metrics of many candidates of one diagram: what an optimiser looks at, never what a user is shown.

Of linear systems without delays the compiled kernels answer steps, loops and paths; `engine.batch.linear` answers responses with
delays, to every other command, integrals and poles. Of nonlinear systems responses to any command are marched, where their laws
can be written as formulas. Each metric is evaluated by its own evaluator, so that none waits for another. Frequency metrics that
the kernels do not answer are read off a scan over frequencies by `engine.batch.frequency`, of nonlinear systems where they rest;
responses for which the kernels cannot vouch are followed by `engine.batch.linear`. Where samplers are all that is not linear,
`engine.batch.sampled_data` follows what flows and jumps. What these cannot vouch for either is flagged doubtful and belongs to the
exact path.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from engine.batch.frequency.batch import FrequencyBatch
from engine.batch.kernels.batch import NEIGHBOURS, Batch, Slopes, UnsuitableError
from engine.batch.kernels.readings import TIME_READINGS
from engine.batch.linear.responses import Responses
from engine.batch.linear.spans import FOLLOWED
from engine.batch.linear.spectra import Spectra
from engine.batch.nonlinear.batch import MARCHED, NonlinearBatch
from engine.batch.sampled_data.batch import SampledBatch, at_samples_alone
from engine.batch.sampled_data.loops import SCANNED
from engine.batch.screened import Screened
from engine.model.errors import EngineError
from engine.model.traced import UnsuitableError as NoFormulaError

if TYPE_CHECKING:
    from engine.analysis.measuring import MetricRequest
    from engine.batch.kernels.batch import Results
    from engine.diagram.diagram import Diagram
    from engine.model.linear_system import Array

__all__ = ["Screened", "Screening", "Slopes"]

_STEP = 1e-30


class Screening:
    """The batched evaluator of some metrics of a diagram.

    Parameters
    ----------
    diagram : Diagram
    requests : sequence of MetricRequest
    threads : int, optional
        How many threads the kernels use; as many as there are processors for this process by default.
    """

    def __init__(self, diagram: Diagram, requests: Sequence[MetricRequest], *, threads: int | None = None) -> None:
        self._diagram = diagram
        self._threads = threads
        self._requests = tuple(requests)
        self._in_frequency = FrequencyBatch(diagram, requests).measured
        self._shares: dict[tuple[str, ...], _Shares] = {}
        self._batches: dict[tuple[str, ...], Batch | None] = {}
        self._marches: dict[tuple[str, ...], NonlinearBatch | None] = {}
        self._scans: dict[tuple[int, ...], FrequencyBatch] = {}
        self._sampled = SampledBatch(diagram, requests, threads=threads) if at_samples_alone(diagram) else None

    def compiled(self, parameters: Sequence[str]) -> bool:
        """Return whether compiled kernels answer every request, for these parameters varied."""
        shares = None if self._diagram.nonlinear else self._shared(tuple(parameters))
        return shares is not None and shares.complete

    def batched(self, parameters: Sequence[str]) -> bool:
        """Return whether batches answer every request, compiled or marched, for these parameters varied."""
        if not self._diagram.nonlinear:
            return self.compiled(parameters)
        if self._sampled is not None:
            return all(self._sampled.measured)
        march = self._march(tuple(parameters))
        return march is not None and all(np.array(march.measured) | np.array(self._in_frequency))

    def together(self, parameters: Sequence[str]) -> int:
        """Return how many candidates, counted from the first of a call, are neighbours for these parameters varied.

        Who shares a vector or a march with whom is decided within them alone, whatever follows.
        """
        if not self._diagram.nonlinear:
            return NEIGHBOURS if self.compiled(parameters) else FOLLOWED
        if self._sampled is not None and any(self._sampled.measured):
            return SCANNED
        return 1 if self._march(tuple(parameters)) is None else MARCHED

    def __call__(self, overrides: Mapping[str, Array], *, second_opinion: bool = True) -> Screened:
        """Return the metrics for arrays (B,) of parameter values; those that are not measurable stay NaN and doubtful.

        Complex overrides carry derivatives, which the kernels do not. Without a second opinion, what these doubt stays so.
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
        if self._sampled is not None:
            return self._sampled(overrides)
        if self._diagram.nonlinear:
            return self._marched(overrides)
        points = _side_by_side(overrides.values())
        shares, infinitesimals = self._shared(tuple(overrides)), np.iscomplexobj(points)
        scanned = [*(shares.framed if infinitesimals else ()), *shares.others]
        found = Screened.unknown(len(points), len(self._requests), dtype=complex if infinitesimals else float)
        parts: list[tuple[list[int], Screened | Results]] = []
        if shares.batch is not None and not infinitesimals:
            asked = partial(self._second_opinion, shares, overrides) if second_opinion and shares.timed else None
            parts.append((list(shares.kernels), shares.batch(points, threads=self._threads, then=asked)))
        spectra = None
        if shares.responses is not None or infinitesimals or scanned or not parts:
            spectra = Spectra(self._diagram.realize_stack(overrides))
        if shares.responses is not None:
            parts.append((list(shares.own), shares.responses(overrides, spectra)))
        if infinitesimals and shares.again is not None:
            parts.append((list(shares.timed), shares.again(overrides, spectra)))
        if scanned or not parts:
            parts.append((scanned, self._scan(tuple(scanned))(overrides, spectra)))
        for columns, part in parts:
            whole = part.values.shape[1] == len(self._requests)
            own = columns if whole else list(range(len(columns)))
            found.values[:, columns], found.doubtful[:, columns] = part.values[:, own], part.doubtful[:, own]
        growths = np.stack([part.growth for _, part in parts])
        unstable = (growths >= 0).any(axis=0)
        found.growth[:] = np.where(unstable, np.where(growths >= 0, growths, 0.0).max(axis=0), growths.max(axis=0))
        found.valid[:] = np.all([part.valid for _, part in parts], axis=0)
        return found

    def _shared(self, varied: tuple[str, ...]) -> _Shares:
        """Return who evaluates what where parameters vary."""
        if varied not in self._shares:
            batch = self._batch(varied)
            everyone = range(len(self._requests))
            kernels = [k for k in everyone if batch is not None and batch.measured[k]]
            left = [k for k in everyone if k not in kernels]
            responses = Responses(self._diagram, [self._requests[k] for k in left], varied, threads=self._threads)
            own = [k for k, measured in zip(left, responses.measured, strict=True) if measured]
            if len(own) < len(left):
                responses = Responses(self._diagram, [self._requests[k] for k in own], varied, threads=self._threads)
            others = [k for k in left if k not in own and self._in_frequency[k]]
            timed = [k for k in kernels if self._requests[k].metric in TIME_READINGS]
            again = Responses(self._diagram, [self._requests[k] for k in timed], varied, threads=self._threads)
            self._shares[varied] = _Shares(
                batch=batch if kernels else None, responses=responses if own else None, again=again if timed else None,
                kernels=tuple(kernels), timed=tuple(timed), framed=tuple(k for k in kernels if k not in timed), own=tuple(own),
                others=tuple(others), complete=len(kernels) + len(own) == len(self._requests),
            )  # fmt: skip
        return self._shares[varied]

    def _second_opinion(self, shares: _Shares, overrides: Mapping[str, Array], found: Results, span: slice) -> None:
        """Follow those responses of a span for which the kernels could not vouch; in frequency nobody else looks closer."""
        assert shares.again is not None
        timed = np.array(shares.timed, dtype=int)
        values, doubtful, growth = found.values[span], found.doubtful[span], found.growth[span]
        exists = found.valid[span] & ~(growth >= 0)
        unsure = np.flatnonzero(doubtful[:, timed].any(axis=1) & exists)
        if not unsure.size:
            return
        again = shares.again({name: np.asarray(column)[span][unsure] for name, column in overrides.items()})
        at = np.ix_(unsure, timed)
        vouched = doubtful[at] & ~again.doubtful & (again.growth < 0)[:, None]
        values[at] = np.where(vouched, again.values, values[at])
        doubtful[at] &= ~vouched
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
        shares = None if self._diagram.nonlinear else self._shared(tuple(overrides))
        if shares is None or not shares.complete:
            return None
        found = None
        if shares.batch is not None:
            points = _side_by_side(overrides.values())
            found = shares.batch.slopes(points, _side_by_side(directions[name] for name in overrides))
        if shares.responses is None:
            return found
        own = _moved(shares.responses, overrides, directions)
        if found is None:
            return own
        columns = list(shares.own)
        found.values[:, columns], found.doubtful[:, columns] = own.values, own.doubtful
        found.slopes[:, columns] = own.slopes
        found.growth[:] = np.where(own.growth >= 0, own.growth, found.growth)
        return found

    def _marched(self, overrides: Mapping[str, Array]) -> Screened:
        """Return the metrics of a nonlinear diagram: responses are marched, and where it rests it is scanned as a linear one."""
        points = _side_by_side(overrides.values())
        moves = np.iscomplexobj(points)
        found = Screened.unknown(len(points), len(self._requests), dtype=complex if moves else float)
        march = None if moves else self._march(tuple(overrides))
        parts = [] if march is None else [(np.flatnonzero(march.measured), march(points, threads=self._threads))]
        framed = np.flatnonzero(self._in_frequency)
        if framed.size:
            parts.append((framed, self._scan(tuple(framed.tolist()))(overrides)))
        for columns, part in parts:
            own = columns if part.values.shape[1] == len(self._requests) else slice(None)
            found.values[:, columns], found.doubtful[:, columns] = part.values[:, own], part.doubtful[:, own]
            found.growth[:] = np.fmax(found.growth, part.growth)
            found.valid[:] &= part.valid
        return found

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

    def _scan(self, columns: tuple[int, ...]) -> FrequencyBatch:
        """Return what scans some of the requests."""
        if columns not in self._scans:
            self._scans[columns] = FrequencyBatch(self._diagram, [self._requests[column] for column in columns])
        return self._scans[columns]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Shares:
    """Who evaluates which columns where certain parameters vary; ``complete``: the compiled evaluators do it all.

    Of the kernels' columns some are ``timed`` and can be followed ``again``, the others are ``framed`` by frequencies.
    """

    batch: Batch | None
    responses: Responses | None
    again: Responses | None
    kernels: tuple[int, ...]
    timed: tuple[int, ...]
    framed: tuple[int, ...]
    own: tuple[int, ...]
    others: tuple[int, ...]
    complete: bool


def _moved(responses: Responses, overrides: Mapping[str, Array], directions: Mapping[str, Array]) -> Slopes:
    """Return metrics with their derivatives: every direction of every candidate is one with infinitesimals."""
    count = next(iter(directions.values())).shape[1]
    lanes = {
        name: (np.asarray(value)[:, None] + 1j * _STEP * directions[name]).ravel() for name, value in overrides.items()
    }
    found = responses(lanes)
    values = found.values.reshape(-1, count, found.values.shape[1])
    return Slopes(
        values=values[:, 0].real.copy(), doubtful=np.asarray(found.doubtful.reshape(values.shape).any(axis=1)),
        growth=found.growth.reshape(-1, count)[:, 0], valid=found.valid.reshape(-1, count)[:, 0],
        slopes=values.imag.swapaxes(1, 2) / _STEP,
    )  # fmt: skip


def _side_by_side(arrays: Iterable[Array]) -> Array:
    """Return arrays of one shape (B, ...) as one (B, arrays, ...): `numpy.stack`, which takes longer to look at them than to copy."""
    return np.concatenate([np.asarray(array)[:, None] for array in arrays], axis=1)
