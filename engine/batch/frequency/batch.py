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
from engine.batch.linear.generator import eigenvalues_of
from engine.batch.linear.poles import growth_of
from engine.batch.screened import Screened

if TYPE_CHECKING:
    from engine.analysis.measuring import MetricRequest
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

    def __call__(self, overrides: Mapping[str, Array]) -> Screened:
        """Return the metrics for arrays (B,) of parameter values."""
        (batch,) = {len(values) for values in overrides.values()}
        complex_lanes = any(np.iscomplexobj(values) for values in overrides.values())
        found = Screened.unknown(batch, len(self._requests), dtype=complex if complex_lanes else float)
        found.doubtful[:] = ~np.array(self.measured, dtype=bool)
        for start in range(0, batch, _CHUNK):
            span = slice(start, min(start + _CHUNK, batch))
            part = {name: column[span] for name, column in overrides.items()}
            self._chunk(
                part, Screened(values=found.values[span], doubtful=found.doubtful[span], growth=found.growth[span],
                               valid=found.valid[span]),
            )  # fmt: skip
        return found

    def _is_measured(self, request: MetricRequest) -> bool:
        if request.opened_besides or not request.as_told(self._diagram):
            return False
        if request.metric in LOOP_METRICS or request.metric in PATH_METRICS:
            return True
        return request.mask is not None and (request.metric in LOOP_MASKS or request.metric in PATH_MASKS)

    def _chunk(self, overrides: Mapping[str, Array], found: Screened) -> None:
        """Enter the metrics of some candidates."""
        stack = self._diagram.realize_stack(overrides)
        found.valid[:] = stack.valid
        here = np.flatnonzero(stack.valid)
        if not here.size:
            return
        if not stack.a.shape[1] and not stack.delays.shape[1]:
            # Nothing moves by itself: there is no frequency to begin a scan at.
            found.doubtful[here], found.growth[here] = True, -np.inf
            return
        told = (stack.delays[here].real > 0).all(axis=1) & ~np.any(stack.x0[here] != 0, axis=1)
        found.doubtful[here[~told]] = True
        here = here[told]
        if not here.size:
            return
        flow = [np.asarray(part[here].real) for part in (stack.a, stack.b2, stack.c2, stack.d22, stack.delays)]
        roots = eigenvalues_of(*flow) if stack.delays.shape[1] else np.linalg.eigvals(flow[0])
        found.growth[here] = growth_of(roots)
        found.doubtful[here[np.isnan(found.growth[here])]] = True
        stable = here[found.growth[here] < 0]
        if stable.size:
            self._read(stack, overrides, stable, found)

    def _read(self, stack: StackedSystem, overrides: Mapping[str, Array], here: Array, found: Screened) -> None:
        """Enter the metrics of the candidates ``here``, which are stable."""
        scans: dict[tuple[object, ...], tuple[Path, Scan]] = {}
        for index, request in enumerate(self._requests):
            if not self.measured[index]:
                continue
            loop = request.metric in LOOP_METRICS or request.metric in LOOP_MASKS
            key = (request.open_at,) if loop else (request.source, request.target)
            if key not in scans:
                if loop:
                    opened = self._diagram.realize_stack(overrides, open_at=request.open_at)
                    path = _path(opened, here, "loop", "loop", sign=-1.0)
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
