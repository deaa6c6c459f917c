"""Margins, peaks, bandwidths and ratios to bounds of many candidates of one linear diagram, by a scan over frequencies.

Complex overrides carry derivatives through: ``parameter * (1 + 1e-30j)`` gives d metric / d ln parameter in the imaginary part,
divided by 1e-30. Poles tell who is stable, with delays of any lengths. A candidate that cannot be vouched for is flagged
``doubtful``; what is no metric of a frequency response is said in advance by :attr:`FrequencyBatch.measured`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from engine.batch.frequency.balance import balance
from engine.batch.frequency.bounds import LOOP_MASKS, PATH_MASKS, ratio
from engine.batch.frequency.margins import LOOP_METRICS, PATH_METRICS
from engine.batch.frequency.scan import Path, Scan
from engine.batch.linear.poles import growth_of
from engine.batch.linear.spectra import Spectra
from engine.batch.screened import Screened

if TYPE_CHECKING:
    from engine.analysis.measuring import MetricRequest
    from engine.diagram.connections import Opening
    from engine.diagram.diagram import Diagram
    from engine.model.linear_system import Array, StackedSystem

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
        stack, here = spectra.stack, spectra.told
        complex_lanes = any(np.iscomplexobj(values) for values in overrides.values())
        found = Screened.unknown(len(stack.valid), len(self._requests), dtype=complex if complex_lanes else float)
        found.valid[:] = stack.valid
        if not stack.a.shape[1] and not stack.delays.shape[1]:
            # Nothing moves by itself: there is no frequency to begin a scan at.
            found.growth[stack.valid] = -np.inf
            found.doubtful[:, self.measured] = stack.valid[:, None]
            return found
        if here.size:
            found.growth[here] = growth_of(spectra.roots(here))
        found.doubtful[:, self.measured] = (stack.valid & np.isnan(found.growth))[:, None]
        stable = here[found.growth[here] < 0]
        loops = {
            request.open_at
            for request, own in zip(self._requests, self.measured, strict=True)
            if own and _is_loop(request)
        }
        opened = {at: self._diagram.realize_stack(overrides, open_at=at) for at in loops if stable.size}
        for start in range(0, len(stable), _CHUNK):
            self._read(stack, opened, stable[start : start + _CHUNK], found)
        return found

    def _is_measured(self, request: MetricRequest) -> bool:
        if request.opened_besides or not request.as_told(self._diagram):
            return False
        if request.metric in LOOP_METRICS or request.metric in PATH_METRICS:
            return True
        return request.mask is not None and (request.metric in LOOP_MASKS or request.metric in PATH_MASKS)

    def _read(
        self, stack: StackedSystem, opened: Mapping[Opening | None, StackedSystem], here: Array, found: Screened
    ) -> None:
        """Enter the metrics of the candidates ``here``, which are stable."""
        scans: dict[tuple[object, ...], tuple[Path, Scan]] = {}
        for index, request in enumerate(self._requests):
            if not self.measured[index]:
                continue
            loop = _is_loop(request)
            key = (request.open_at,) if loop else (request.source, request.target)
            if key not in scans:
                if loop:
                    path = _path(opened[request.open_at], here, "loop", "loop", sign=-1.0)
                else:
                    path = _path(stack, here, str(request.source), str(request.target), sign=1.0)
                scans[key] = path, Scan(path)
            path, scan = scans[key]
            if request.mask is not None:
                quantity = (LOOP_MASKS if loop else PATH_MASKS)[request.metric]
                read = ratio(path, scan, request.mask, quantity)
            else:
                metric = LOOP_METRICS[request.metric] if loop else PATH_METRICS[request.metric]
                read = metric(path, scan)
            found.values[here, index] = read.value if np.iscomplexobj(found.values) else read.value.real
            # What is slower than the lowest frequency of the table crosses and bends below it.
            slow = np.abs(found.growth[here]) < scan.frequencies[:, 0]
            found.doubtful[here, index] = read.doubtful | slow


def _is_loop(request: MetricRequest) -> bool:
    return request.metric in LOOP_METRICS or request.metric in LOOP_MASKS


def _path(stack: StackedSystem, here: Array, source: str, target: str, *, sign: float) -> Path:
    """Return one path of the candidates ``here``, balanced."""
    i, o = stack.inputs.index(source), stack.outputs.index(target)
    scale = balance(stack.a[here])
    b = np.concatenate([stack.b1[here][:, :, i : i + 1], stack.b2[here]], axis=2) / scale[:, :, None]
    c = np.concatenate([sign * stack.c1[here][:, o : o + 1], stack.c2[here]], axis=1) * scale[:, None, :]
    top = np.concatenate(
        [sign * stack.d11[here][:, o : o + 1, i : i + 1], sign * stack.d12[here][:, o : o + 1]], axis=2
    )
    bottom = np.concatenate([stack.d21[here][:, :, i : i + 1], stack.d22[here]], axis=2)
    return Path(
        a=stack.a[here] * scale[:, None, :] / scale[:, :, None], b=b, c=c,
        d=np.concatenate([top, bottom], axis=1), delays=stack.delays[here],
    )  # fmt: skip
