"""What a model answers to the inputs of one experiment, and how that moves with the unknowns.

    y(t) = ŷ(t; p) + Σ_k f_k(t; p) ξ_k

ŷ starts at rest; f_k is the free motion from a state of its own. A linear model's answer is linear in the initial
state ξ, which is then found by linear regression; a nonlinear model is given ξ and answers with its slopes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

Samples = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer:
    """One response with its slopes.

    Attributes
    ----------
    values : ndarray, shape (outputs, samples)
        Infinite where the response grows beyond what can be followed.
    slopes : ndarray, shape (coordinates, outputs, samples)
        By each unknown parameter, then by each initial state of a nonlinear model.
    free : ndarray, shape (parameters, outputs, samples, states), optional
        Free motions of a linear model, the imaginary parts carrying the slopes by each parameter.
    """

    values: Samples
    slopes: Samples
    free: npt.NDArray[Any] | None = None


class Model(Protocol):
    """A diagram with the inputs of one experiment."""

    states: int
    """How many initial states are coordinates of the search; 0 for linear models, and unless they are asked for."""

    def answer(self, values: Mapping[str, float], deviation: Samples) -> Answer:
        """Return the response at parameter values (SI), from a state that deviates from rest, with its slopes.

        Parameters
        ----------
        values : mapping of str to float
            All unknown parameters, in their order.
        deviation : ndarray, shape (states,)

        Raises
        ------
        EngineError
            Where there is no response at these values.
        """
        ...

    def shown(self, values: Mapping[str, float], deviation: Samples) -> Answer:
        """Return the same response as precisely as it is shown; the slopes do not matter then."""
        ...
