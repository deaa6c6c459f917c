"""A model beside one experiment: errors and slopes, without what constants and free motions explain.

    r = P (y - ŷ),   J = -P (∂ŷ/∂p + Σ_k ξ_k ∂f_k/∂p),   P = 1 - Q Qᵀ

Q spans the constants of the offsets and the free motions f_k of a linear model; their coefficients are found by linear
regression inside, so that the search has nothing to do with them.

References
----------
L. Kaufman, "A variable projection method for solving separable nonlinear least squares problems", BIT 15 (1975) 49-57.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from engine.model.tangent import slopes
from optimizers.identification.answers import Answer, Model, Samples
from optimizers.recorded.recording import RecordedExperiment, Window

_UNSEEN = 1e-9
"""Free motions weaker than this part of the strongest are not told apart from the others."""
_EXPLAINED = 1e-6
"""A parameter whose effect is left by less than this part has none of its own."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Nuisance:
    """Coefficients of what is not asked for: a constant for each output, and a state (empty where none is estimated)."""

    offsets: Samples
    state: Samples


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Weighted errors (samples of all outputs,) and their slopes by the coordinates of the model."""

    residuals: Samples
    jacobian: Samples


class Part(Protocol):
    """One experiment with its model, as the search asks it: a recording, or a measured frequency response."""

    @property
    def states(self) -> int:
        """How many initial states are coordinates of the search."""
        ...

    @property
    def signals(self) -> list[tuple[int, int]]:
        """Parts and samples of each output's errors: one part in time; the real, then the imaginary one over frequency."""
        ...

    def errors(self, values: Mapping[str, float], deviation: Samples, slope: Samples) -> Errors | None:
        """Return errors and slopes; see :meth:`Comparison.errors`."""
        ...

    def widths(self) -> list[float]:
        """Return the factor by which each output's errors count more for the intervals."""
        ...


class Comparison:
    """One recording with its model."""

    def __init__(self, experiment: RecordedExperiment, model: Model, *, offsets: bool) -> None:
        self.experiment, self.model = experiment, model
        self._offsets = offsets
        self.measured = np.array(list(experiment.recording.outputs.values()))
        estimation, validation = experiment.windows
        # what only validates has constants and a state of its own, too: they are found where it is looked at
        self._part = experiment.recording.within(estimation or validation or (0.0, experiment.recording.end))
        inside = self.measured[:, self._part]
        spread = np.maximum(inside.std(axis=1), 1e-300)
        self._weight = 1 / (spread * math.sqrt(inside.shape[1]))

    @property
    def states(self) -> int:
        """How many initial states are coordinates of the search."""
        return self.model.states

    @property
    def signals(self) -> list[tuple[int, int]]:
        """Parts and samples of each output's errors."""
        return [(1, self._part.stop - self._part.start)] * len(self.measured)

    def widths(self) -> list[float]:
        """Return how much wider each output's errors let the intervals be: its weight is known."""
        return [1.0] * len(self.measured)

    def part(self, window: Window) -> slice:
        """Return the samples of a window."""
        return self.experiment.recording.within(window)

    def errors(self, values: Mapping[str, float], deviation: Samples, slope: Samples) -> Errors | None:
        """Return errors in the estimation window, None where the response is not finite.

        Parameters
        ----------
        values : mapping of str to float
            All unknown parameters (SI), in their order.
        deviation : ndarray, shape (states,)
            From rest, at the beginning.
        slope : ndarray, shape (coordinates,)
            What the slopes are multiplied by: those of the values by their coordinates.

        Raises
        ------
        EngineError
            Where there is no response at these values.
        """
        answer = self.model.answer(values, deviation)
        if not np.isfinite(answer.values).all():
            return None
        part = self._part
        errors = (self.measured - answer.values)[:, part] * self._weight[:, None]
        moves = answer.slopes[:, :, part]
        basis = self.basis(answer)
        if answer.free is not None:
            nuisance = self._solved(basis, errors)[len(self.measured) if self._offsets else 0 :]
            moves = moves + slopes(answer.free[:, :, part] @ nuisance)
        moves = -moves * (slope[:, None, None] * self._weight[:, None])
        residuals, jacobian = errors.ravel(), moves.reshape(len(moves), -1).T
        if basis is not None:
            q = basis / np.linalg.norm(basis, axis=0) if answer.free is None else orthonormal(basis)
            residuals = residuals - q @ (q.T @ residuals)
            left = jacobian - q @ (q.T @ jacobian)
            # what only moves a constant or a free motion that is free anyway would lead a search astray by its rounding
            seen = np.linalg.norm(left, axis=0) > _EXPLAINED * np.linalg.norm(jacobian, axis=0)
            jacobian = left * seen
        return Errors(residuals=residuals, jacobian=jacobian)

    def nuisance(self, answer: Answer, deviation: Samples) -> Nuisance:
        """Return the constants and the state that fit best."""
        errors = (self.measured - answer.values)[:, self._part] * self._weight[:, None]
        found = self._solved(self.basis(answer), errors)
        outputs = len(self.measured) if self._offsets else 0
        state = found[outputs:] if answer.free is not None else deviation
        return Nuisance(offsets=found[:outputs], state=state)

    def simulated(self, answer: Answer, nuisance: Nuisance) -> Samples:
        """Return the whole response with its constants and free motions."""
        values = answer.values
        if answer.free is not None:
            values = values + answer.free[0].real @ nuisance.state
        return values + nuisance.offsets[:, None] if nuisance.offsets.size else values

    def basis(self, answer: Answer) -> Samples | None:
        """Return weighted constants and free motions as columns; None where there are none."""
        outputs, samples = len(self.measured), self._part.stop - self._part.start
        columns = []
        if self._offsets:
            columns.append(np.kron(np.diag(self._weight), np.ones((samples, 1))))
        if answer.free is not None:
            free = answer.free[0].real[:, self._part] * self._weight[:, None, None]
            columns.append(free.reshape(outputs * samples, -1))
        return np.concatenate(columns, axis=1) if columns else None

    @staticmethod
    def _solved(basis: Samples | None, errors: Samples) -> Samples:
        """Return the coefficients of the basis that leave the least errors."""
        if basis is None:
            return np.zeros(0)
        scale = np.linalg.norm(basis, axis=0)
        scale[scale == 0] = 1.0
        return np.asarray(np.linalg.lstsq(basis / scale, errors.ravel(), rcond=_UNSEEN)[0] / scale)


def orthonormal(basis: Samples) -> Samples:
    """Return columns that span the same."""
    scale = np.linalg.norm(basis, axis=0)
    left, strength, _ = np.linalg.svd(basis / np.where(scale == 0, 1.0, scale), full_matrices=False)
    return np.asarray(left[:, strength > _UNSEEN * strength[0]])
