"""A movement from rest to rest whose highest derivative is constant in phases: a polynomial on each of them.

u(t) = Σ_n c_kn (t - t_k)^n on phase k;   0 before the first phase, the distance after the last one
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from engine.model.linear_system import Array
from engine.signals._base import FloatArray, Signal

_NEGLIGIBLE = 1e-12
"""A phase shorter than this part of the movement is none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Profile:
    """Polynomial phases side by side; every number may carry an infinitesimal.

    Parameters
    ----------
    knots : ndarray, shape (phases + 1,)
        Instants at which phases begin, s; the last one ends the movement.
    coefficients : ndarray, shape (phases, degree + 1)
        Of the time since the phase began, lowest power first.
    distance : float or complex
        Where the movement ends.
    """

    knots: Array
    coefficients: Array
    distance: float

    @classmethod
    def of(cls, start: float, phases: Sequence[tuple[float, float]], *, degree: int, distance: float) -> Self:
        """Return the movement whose derivative of order ``degree`` is constant in phases of (duration, value)."""
        whole = sum(duration.real for duration, _ in phases)
        lasting = [phase for phase in phases if phase[0].real > _NEGLIGIBLE * whole]
        knots, rows = [start], []
        state = [0.0] * degree  # u and its derivatives below the highest
        for duration, highest in lasting:
            derivatives = [*state, highest]
            rows.append([value / _factorial(n) for n, value in enumerate(derivatives)])
            state = [
                sum(derivatives[m] * duration ** (m - n) / _factorial(m - n) for m in range(n, degree + 1))
                for n in range(degree)
            ]
            knots.append(knots[-1] + duration)
        coefficients = np.array(rows) if rows else np.zeros((0, degree + 1))
        return cls(knots=np.array(knots), coefficients=coefficients, distance=distance)

    def value(self, t: Array) -> Array:
        """Return u at the instants ``t`` (s), of the same shape."""
        edges = np.real(self.knots)
        phase = np.searchsorted(edges, np.real(t), side="right") - 1
        moving = np.clip(phase, 0, max(len(self.coefficients) - 1, 0))
        after = np.where(np.real(t) >= edges[-1], self.distance, 0.0)
        if not len(self.coefficients):
            return after
        local = t - self.knots[moving]
        inside = self.coefficients[moving, -1] + 0.0 * local
        for power in range(self.coefficients.shape[1] - 2, -1, -1):
            inside = inside * local + self.coefficients[moving, power]
        return np.asarray(np.where((phase >= 0) & (phase < len(self.coefficients)), inside, after))

    def breakpoints(self) -> tuple[float, ...]:
        """Return the instants at which a derivative jumps."""
        found: tuple[float, ...] = tuple(self.knots.tolist())
        return found

    @property
    def degree(self) -> int:
        """Which derivative is constant in phases."""
        return int(self.coefficients.shape[1]) - 1

    @property
    def end(self) -> float:
        """When the movement has ended, s."""
        last: float = self.knots[-1].item()
        return last


@dataclass(frozen=True, slots=True, kw_only=True)
class Movement(Signal):
    """A command that goes from 0 to ``distance`` on a profile."""

    distance: float
    profile: Profile = field(repr=False, compare=False)

    def value(self, t: FloatArray) -> FloatArray:
        """Return u(t)."""
        return self.profile.value(t)

    def breakpoints(self) -> tuple[float, ...]:
        """Return the instants at which the highest derivative jumps."""
        return self.profile.breakpoints()

    def final(self) -> float | None:
        """Return the distance."""
        return self.distance

    def end(self) -> float | None:
        """Return when the movement has ended."""
        return self.profile.end

    def degree(self) -> int | None:
        """Return the degree of the pieces, 0 where nothing moves."""
        return self.profile.degree if self.distance else 0


def _factorial(n: int) -> float:
    return (1.0, 1.0, 2.0, 6.0)[n]
