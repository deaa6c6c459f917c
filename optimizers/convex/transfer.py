"""The exact frequency response from all inputs to all outputs of a system with delays.

G(jω) = D11 + [C1 D12] F(jω)⁻¹ [B1; D21],   F(s) = [[s I - A, -B2], [-C2, diag(e^{s τ}) - D22]]
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.exact.frequency.path import merged
from engine.model.linear_system import LaneSystem

if TYPE_CHECKING:
    from engine.diagram.diagram import Diagram

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

_BESIDE = 1e-12
"""Where a frequency is exactly a pole, so far beside it, relative to it."""

_STILL = 1e-7
"""Poles this much slower than the fastest are integrators: two in a row are known to half the digits."""

_MOST_NUMBERS = 2_000_000
"""Complex numbers in one chunk: 32 MB."""


class Transfer:
    """The response of a diagram at some parameter values, with the loop cut at ``open_at``.

    Parameters
    ----------
    diagram : Diagram
    overrides : mapping of str to float
        Parameter values, SI.
    open_at : str, optional
        As in `Diagram.realize`: the added last input and output are those of the cut.
    """

    def __init__(self, diagram: Diagram, overrides: Mapping[str, float], open_at: str | None = None) -> None:
        system = merged(LaneSystem.of([diagram.realize(overrides, open_at)]).balanced())
        self.inputs = system.inputs
        self.outputs = system.outputs
        self._states = system.n
        self._delays = system.delays[0]
        self._inner = np.block([[system.a[0], system.b2[0]], [system.c2[0], system.d22[0]]])
        self._right = np.concatenate([system.b1[0], system.d21[0]]).astype(complex)
        self._read = np.concatenate([system.c1[0], system.d12[0]], axis=1)
        self._direct = system.d11[0]

    @property
    def corners(self) -> tuple[float, float]:
        """The slowest and the fastest corner frequency of what has one, rad/s; integrators have none."""
        n = self._states
        found = np.append(np.abs(np.linalg.eigvals(self._inner[:n, :n])), 1 / self._delays)
        found = found[found > _STILL * found.max(initial=0.0)]
        return (float(found.min()), float(found.max())) if len(found) else (1.0, 1.0)

    def __call__(self, frequencies: Real) -> Complex:
        """Return G(jω), shape (k, outputs, inputs), at ``frequencies`` (k,) in rad/s, all > 0."""
        size = len(self._inner)
        if not size:
            return np.broadcast_to(self._direct.astype(complex), (len(frequencies), *self._direct.shape))
        step = max(1, _MOST_NUMBERS // (size * size))
        parts = [self._some(frequencies[k : k + step]) for k in range(0, len(frequencies), step)]
        return np.concatenate(parts) if parts else np.zeros((0, *self._direct.shape), dtype=complex)

    def _some(self, frequencies: Real) -> Complex:
        n, m = self._states, len(self._delays)
        f = np.empty((len(frequencies), n + m, n + m), dtype=complex)
        f[:] = -self._inner
        f[:, range(n), range(n)] += 1j * frequencies[:, None]
        f[:, range(n, n + m), range(n, n + m)] += np.exp(1j * frequencies[:, None] * self._delays)
        right = np.broadcast_to(self._right, (len(f), *self._right.shape))
        try:
            inner = np.linalg.solve(f, right)
        except np.linalg.LinAlgError:
            return self._some(frequencies * (1 + _BESIDE))
        return np.asarray(self._read @ inner + self._direct)
