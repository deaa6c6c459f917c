"""Margins, peaks, bandwidths and ratios to bounds of many candidates of one linear diagram, by a scan over frequencies.

Complex overrides carry derivatives through: ``parameter * (1 + 1e-30j)`` gives d metric / d ln parameter in the imaginary part,
divided by 1e-30. Poles tell who is stable, with delays of any lengths. A candidate that cannot be vouched for is flagged
``doubtful``; what is no metric of a frequency response is said in advance by :attr:`FrequencyBatch.measured`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.batch import stacks
from engine.batch.frequency.balance import balance
from engine.batch.frequency.bounds import LOOP_MASKS, PATH_MASKS, ratio
from engine.batch.frequency.margins import LOOP_METRICS, PATH_METRICS
from engine.batch.frequency.scan import Path, Scan
from engine.batch.linear.poles import growth_of
from engine.batch.linear.spectra import Spectra, between
from engine.batch.screened import Screened

if TYPE_CHECKING:
    from engine.analysis.measuring import MetricRequest
    from engine.batch.stacks import Numbers
    from engine.diagram.connections import Opening
    from engine.diagram.diagram import Diagram
    from engine.model.linear_system import Array, StackedSystem

    _Ends = tuple[Opening | None] | tuple[str, str]
    """The place where a loop is opened, or an input and an output."""

_CHUNK = 256


class FrequencyBatch:
    """The batched evaluator of those metrics of a linear diagram that frequency responses tell.

    Parameters
    ----------
    diagram : Diagram
    requests : sequence of MetricRequest

    Attributes
    ----------
    measured : tuple of bool
        Which requests it answers; the others stay NaN and doubtful.
    """

    def __init__(self, diagram: Diagram, requests: Sequence[MetricRequest]) -> None:
        self._diagram = diagram
        self._requests = tuple(requests)
        self.measured = tuple(self._is_measured(request) for request in requests)

    def __call__(self, overrides: Mapping[str, Array], spectra: Spectra | None = None) -> Screened:
        """Return the metrics for arrays (B,) of parameter values; ``spectra`` are those of the stack there, where known."""
        spectra = Spectra(self._diagram.realize_stack(overrides)) if spectra is None else spectra
        stack = spectra.stack
        complex_lanes = any(np.iscomplexobj(values) for values in overrides.values())
        found = Screened.unknown(len(stack.valid), len(self._requests), dtype=complex if complex_lanes else float)
        found.valid[:] = stack.valid
        groups = self._alike()
        worst, known = np.full((2, len(stack.valid)), -np.inf)
        if not groups:  # what others are asked for is a matter of the whole
            worst = _growth(spectra, np.arange(len(stack.valid)), np.arange(spectra.flow.shape[1]))
        for ends, columns in groups.items():
            own = np.full(len(stack.valid), np.nan)
            for members, path in self._paths(ends, overrides, stack):
                own[members] = _growth(spectra, members, path.kept)
                # Where nothing moves by itself there is no frequency to begin a scan at.
                found.doubtful[np.ix_(members, np.array(columns))] = (stack.valid & ~np.isfinite(own))[members, None]
                stable = members[np.isfinite(own[members]) & (own[members] < 0)]
                for start in range(0, len(stable), _CHUNK):
                    self._read(path, columns, stable[start : start + _CHUNK], own, found)
            worst, known = np.maximum(worst, own), np.fmax(known, own)
        # What is unstable is so whatever is not known of others.
        found.growth[:] = np.where(known >= 0, known, worst)
        return found

    def _alike(self) -> dict[_Ends, list[int]]:
        """Return the requests, by number, that look at the same path or loop."""
        groups: dict[_Ends, list[int]] = {}
        for index, request in enumerate(self._requests):
            if self.measured[index]:
                ends = (request.open_at,) if _is_loop(request) else (str(request.source), str(request.target))
                groups.setdefault(ends, []).append(index)
        return groups

    def _paths(
        self, ends: _Ends, overrides: Mapping[str, Array], stack: StackedSystem
    ) -> list[tuple[Numbers, _Between]]:
        """Return what lies between two ends, or around a loop that is opened, of the members for whom the same acts on the same."""
        if len(ends) == 1:
            opened = self._diagram.realize_stack(overrides, open_at=ends[0])
            return _Between.each(opened, "loop", "loop", sign=-1.0)
        return _Between.each(stack, *ends, sign=1.0)

    def _is_measured(self, request: MetricRequest) -> bool:
        if self._diagram.sampled:  # what stands for samplers here is continuous: margins and poles of another system
            return False
        if request.opened_besides or not request.as_told(self._diagram):
            return False
        if request.metric in LOOP_METRICS or request.metric in PATH_METRICS:
            return True
        return request.mask is not None and (request.metric in LOOP_MASKS or request.metric in PATH_MASKS)

    def _read(self, between: _Between, columns: list[int], here: Array, growth: Array, found: Screened) -> None:
        """Enter the metrics of the candidates ``here``, which are stable."""
        path = between.balanced(here)
        scan = Scan(path)
        # What is slower than the lowest frequency of the table crosses and bends below it.
        slow = np.abs(growth[here]) < scan.frequencies[:, 0]
        for index in columns:
            request = self._requests[index]
            loop = _is_loop(request)
            if request.mask is not None:
                quantity = (LOOP_MASKS if loop else PATH_MASKS)[request.metric]
                read = ratio(path, scan, request.mask, quantity)
            else:
                metric = LOOP_METRICS[request.metric] if loop else PATH_METRICS[request.metric]
                read = metric(path, scan)
            found.values[here, index] = read.value if np.iscomplexobj(found.values) else read.value.real
            found.doubtful[here, index] = read.doubtful | slow


def _is_loop(request: MetricRequest) -> bool:
    return request.metric in LOOP_METRICS or request.metric in LOOP_MASKS


@dataclass(frozen=True, kw_only=True, eq=False)
class _Between:
    """One path of a stack: from input ``i`` to output ``o`` through those states and delayed signals that ``kept`` numbers."""

    stack: StackedSystem
    i: int
    o: int
    sign: float
    kept: npt.NDArray[np.intp]

    @classmethod
    def each(cls, stack: StackedSystem, source: str, target: str, *, sign: float) -> list[tuple[Numbers, _Between]]:
        i, o = stack.inputs.index(source), stack.outputs.index(target)
        acts = np.concatenate(
            [np.concatenate([stack.a, stack.b2], axis=2), np.concatenate([stack.c2, stack.d22], axis=2)], axis=1
        ) != 0  # fmt: skip
        driven = np.concatenate([stack.b1[:, :, i], stack.d21[:, :, i]], axis=1) != 0
        seen = np.concatenate([stack.c1[:, o], stack.d12[:, o]], axis=1) != 0
        found = []
        for members in stacks.alike(np.concatenate([acts.reshape(len(acts), -1), driven, seen], axis=1)):
            one = members[0]
            kept = between(acts[one], driven[one], seen[one])
            found.append((members, cls(stack=stack, i=i, o=o, sign=sign, kept=kept)))
        return found

    def balanced(self, here: Array) -> Path:
        """Return the path of the candidates ``here``."""
        stack, i, o, n = self.stack, self.i, self.o, self.stack.a.shape[1]
        x, w = self.kept[self.kept < n], self.kept[self.kept >= n] - n
        a = stack.a[here][:, x][:, :, x]
        scale = balance(a)
        b = np.concatenate([stack.b1[here][:, x, i : i + 1], stack.b2[here][:, x][:, :, w]], axis=2)
        c = np.concatenate([self.sign * stack.c1[here][:, o : o + 1, x], stack.c2[here][:, w][:, :, x]], axis=1)
        through = self.sign * stack.d11[here][:, o : o + 1, i : i + 1], self.sign * stack.d12[here][:, o : o + 1, w]
        late = stack.d21[here][:, w, i : i + 1], stack.d22[here][:, w][:, :, w]
        return Path(
            a=a * scale[:, None, :] / scale[:, :, None], b=b / scale[:, :, None], c=c * scale[:, None, :],
            d=np.concatenate([np.concatenate(through, axis=2), np.concatenate(late, axis=2)], axis=1),
            delays=stack.delays[here][:, w],
        )  # fmt: skip


def _growth(spectra: Spectra, members: Numbers, kept: Numbers) -> Array:
    """Return the growth of the part that consists of these states and delayed signals, (members,): NaN where it is not known."""
    if not kept.size:
        return np.where(spectra.stack.valid[members], -np.inf, np.nan)
    growth, known = np.full(len(members), np.nan), np.isin(members, spectra.told)
    if kept[0] < spectra.stack.a.shape[1] and known.any():  # of delays alone the exact path knows
        growth[known] = growth_of(spectra.roots(members[known], kept))
    return growth
