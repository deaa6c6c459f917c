"""Where a linear system with delays rests under a constant command: what is left of a transient is counted from there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from engine.model.tangent import solve

if TYPE_CHECKING:
    from engine.model.linear_system import Array, LaneSystem


@dataclass(frozen=True, kw_only=True, eq=False)
class Equilibrium:
    """States (lanes, n), inputs (lanes, inputs), delayed signals (lanes, m) and outputs (lanes, outputs) at rest."""

    x: Array
    u: Array
    w: Array
    y: Array

    @classmethod
    def of(cls, system: LaneSystem, u: Array) -> Self:
        """Solve 0 = A x + B1 u + B2 w, w = C2 x + D21 u + D22 w, and once more for what rounding left; NaN where nothing does."""
        n, m = system.n, system.m
        upper = np.concatenate([system.a, system.b2], axis=2)
        lower = np.concatenate([system.c2, system.d22 - np.eye(m)], axis=2)
        whole = np.concatenate([upper, lower], axis=1)
        right = -np.concatenate([system.b1, system.d21], axis=1) @ u[:, :, None]
        try:
            found = solve(whole, right)
            found = found + solve(whole, right - whole @ found)
        except np.linalg.LinAlgError:  # a pole at 0: it rests nowhere, or anywhere
            found = np.full_like(right, np.nan)
        x, w = found[:, :n, 0], found[:, n:, 0]
        y = (system.c1 @ x[:, :, None] + system.d11 @ u[:, :, None] + system.d12 @ w[:, :, None])[:, :, 0]
        return cls(x=x, u=u, w=w, y=y)
