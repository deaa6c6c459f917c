"""Answers of linear diagrams: exact between the samples, with exact slopes.

free motion f(t_k) = C e^(A k h)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from engine.exact.frequency.path import connected, path
from engine.exact.time.chebyshev import weights
from engine.exact.time.propagate import exponentials
from engine.exact.time.sampled import Drive
from engine.exact.time.short_delay import lifted
from engine.exact.time.trajectory import respond
from engine.model.between_samples import told
from engine.model.linear_system import LaneSystem
from engine.model.tangent import INFINITESIMAL
from optimizers.identification.answers import Answer, Samples

if TYPE_CHECKING:
    from engine.diagram.diagram import Diagram
    from engine.exact.time.curve import Curve
    from optimizers.recorded.recording import RecordedExperiment

Array = npt.NDArray[Any]

GROWTH_LIMIT = 1e6
"""A trial model that could grow more within the recording explains no machine that stayed in one piece."""

_BLOCK = 256


class LinearModel:
    """A linear diagram driven by one recording; ``initial`` tells whether free motions are wanted."""

    states = 0

    def __init__(self, diagram: Diagram, experiment: RecordedExperiment, *, initial: bool) -> None:
        recording = experiment.recording
        self._diagram, self._known, self._initial = diagram, dict(experiment.values), initial
        self._from = [diagram.inputs.index(name) for name in recording.inputs]
        self._to = [diagram.outputs.index(name) for name in recording.outputs]
        self._h, self._samples = recording.sample_time, recording.samples
        inputs = np.array(list(recording.inputs.values())).reshape(len(recording.inputs), recording.samples)
        between = told(recording.between_samples, list(recording.inputs))
        self._drive = Drive(inputs, self._h, between=between, growth_limit=GROWTH_LIMIT)

    def answer(self, values: Mapping[str, float], deviation: Samples) -> Answer:
        """Return the response; its initial state is left to linear regression."""
        assert not deviation.size
        lanes = self._diagram.realize_lanes(dict.fromkeys(values, INFINITESIMAL), {**self._known, **values})
        found, slopes = self._drive.respond(connected(lanes, self._from, self._to))
        wanted = self._initial and bool(np.isfinite(found).all())
        return Answer(values=found, slopes=slopes, free=self._free(lanes) if wanted else None)

    def shown(self, values: Mapping[str, float], deviation: Samples) -> Answer:
        """Return the same: it is exact."""
        return self.answer(values, deviation)

    def _free(self, system: LaneSystem) -> Array:
        """Return the free motions, (lanes, outputs, samples, states)."""
        if system.m:
            return self._free_with_delays(system)
        balanced = replace(system, c1=system.c1[:, self._to])
        advance = exponentials(self._h * balanced.a)
        powers, count = np.broadcast_to(np.eye(system.n), advance.shape)[:, None], 1
        while count < min(_BLOCK, self._samples):  # C, CA, CA², ... by doubling, then block by block
            powers, count = np.concatenate([powers, powers @ advance[:, None]], axis=1), 2 * count
            advance = advance @ advance
        rows = balanced.c1[:, None] @ powers
        blocks = [rows]
        for _ in range(1, -(-self._samples // count)):
            rows = rows @ advance[:, None]
            blocks.append(rows)
        return np.concatenate(blocks, axis=1)[:, : self._samples].transpose(0, 2, 1, 3)

    def _free_with_delays(self, system: LaneSystem) -> Array:
        lanes = system.lanes
        system, _ = lifted(system, self._h)  # 1e-4 samples do not matter to a free motion
        instants: Samples = self._h * np.arange(self._samples, dtype=np.float64)
        found = np.zeros((lanes, len(self._to), self._samples, system.n), dtype=complex)
        for state in range(system.n):
            begun = replace(system, x0=np.broadcast_to(np.eye(system.n)[state], (system.lanes, system.n)))
            for place, output in enumerate(self._to):
                part = path(begun, [], [output])
                if part.n:
                    curve = respond(part, [], float(instants[-1]) + self._h).output(0)
                    found[:, place, :, state] = _sampled(curve, instants)[:lanes]
        return found


def _sampled(curve: Curve, instants: Samples) -> Array:
    """Return all lanes of a curve at fixed instants, (lanes, instants)."""
    edges = curve.times
    piece = np.clip(np.searchsorted(edges, instants, side="right") - 1, 0, len(edges) - 2)
    local = (instants[:, None] - curve.edges[piece]) / (curve.edges[piece + 1] - curve.edges[piece])
    return np.asarray(np.einsum("tlj,tjl->lt", weights(local), curve.values[piece]))
