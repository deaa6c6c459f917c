"""Metrics of the poles of many systems with samplers, where every loop has one sampler: s = ln z / T."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.linear.poles import METRICS, poles_of, read
from engine.batch.sampled_data.cycle import Cycle
from engine.exact.sampled_data.poles import parts_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from engine.analysis.measuring import MetricRequest
    from engine.batch.screened import Screened
    from engine.exact.sampled_data.system import SampledSystem

Array = npt.NDArray[Any]

_EMPTY: Final = 1e-12
"""A smaller eigenvalue is a memory that is empty after one period, and no pole."""
_CLEAR: Final = 1e-9
"""Up to this the exact path tells which it is."""


def is_measured(request: MetricRequest) -> bool:
    """Return whether a request is one of poles."""
    return request.metric in METRICS


def measure_poles(
    requests: Mapping[int, MetricRequest], system: SampledSystem, members: Array, found: Screened
) -> None:  # fmt: skip
    """Enter the metrics of the poles, by their columns, of the ``members`` of a batch that ``system`` consists of."""
    parts = [_poles_of(part) for part in parts_of(system)]
    told = [part for part in parts if part is not None]
    if len(told) < len(parts):
        return
    values, motion, unsure = (np.concatenate(column, axis=1) for column in zip(*told, strict=True))
    if not values.shape[1]:
        return
    growth = values.real.max(axis=1)
    found.growth[members] = np.fmax(found.growth[members], np.where(unsure.any(axis=1), np.nan, growth))
    for column, request in requests.items():
        value, doubt = read(request.metric, values, motion, unsure)
        found.values[members, column] = value if np.iscomplexobj(found.values) else value.real
        found.doubtful[members, column] = doubt


def _poles_of(part: SampledSystem) -> tuple[Array, Array, Array] | None:
    """Return the poles (B, n) of a part whose states follow each other, with their motion and which are not known well enough."""
    if not part.samplings:
        return poles_of(part.flow)
    cycle = Cycle.of(part) if len(part.samplings) == 1 else None
    if cycle is None:
        return None
    if not len(cycle.alive):  # all that is in it is overwritten before it counts
        return np.zeros((part.lanes, 0), complex), np.zeros((part.lanes, 0), complex), np.zeros((part.lanes, 0), bool)
    less_one, motion, unsure = poles_of(cycle.own)
    z = 1 + less_one
    empty = np.abs(z) <= _EMPTY
    unsure |= (np.abs(z) < _CLEAR) & ~empty
    with np.errstate(all="ignore"):
        values = (np.log1p(2 * less_one.real + np.abs(less_one) ** 2) / 2 + 1j * np.angle(z)) / cycle.length
        moved = motion / z / cycle.length
    # what is empty is no pole: the fastest one stands in its place
    fastest = np.abs(np.where(empty | unsure, 0.0, values)).max(axis=1, keepdims=True)
    return np.where(empty | unsure, -fastest, values), np.where(empty | unsure, 0.0, moved), unsure
