"""What a batched evaluator tells of many candidates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from engine.model.linear_system import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Screened:
    """Metrics of B candidates.

    Attributes
    ----------
    values : ndarray, shape (B, R)
        Metrics in SI; complex where the overrides are. Infinite where a frequency metric never crosses, NaN where there
        is no value.
    doubtful : ndarray of bool, shape (B, R)
        The exact path has to decide.
    growth : ndarray, shape (B,)
        Real part of the rightmost characteristic root of the closed system (1/s), about; >= 0: unstable, no values; NaN: not known.
    valid : ndarray of bool, shape (B,)
        The system exists at these parameters.
    """

    values: Array
    doubtful: npt.NDArray[np.bool_]
    growth: npt.NDArray[np.float64]
    valid: npt.NDArray[np.bool_]

    @classmethod
    def unknown(cls, members: int, requests: int, *, dtype: type[float | complex] = float) -> Self:
        """Return candidates of which nothing is known: every value belongs to the exact path."""
        return cls(
            values=np.full((members, requests), np.nan, dtype=dtype), doubtful=np.ones((members, requests), dtype=bool),
            growth=np.full(members, np.nan), valid=np.ones(members, dtype=bool),
        )  # fmt: skip
