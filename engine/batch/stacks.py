"""Stacks of matrices, one of each candidate: what is found of a member does not depend on who else is in the stack."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
Numbers = npt.NDArray[np.intp]


def alike(features: Array) -> list[Numbers]:
    """Return the members whose rows of ``features`` (B, K) are equal, by number and together."""
    if not len(features):
        return []
    if (features == features[0]).all():
        return [np.arange(len(features))]
    _, which = np.unique(features, axis=0, return_inverse=True)
    return [np.flatnonzero(which.ravel() == k) for k in range(which.max() + 1)]


def contract(left: Array, right: Array) -> Array:
    """Return Σ_j L_ij R_ji for stacks (..., n, n): numpy.einsum would add up in another order where a stack has one member."""
    return np.asarray(np.multiply(left, right.swapaxes(-1, -2), order="C").sum(axis=-1))


def solve(matrices: Array, right: Array) -> Array:
    """Return the solutions X of A X = B for stacks A (..., n, n) and B (..., n, k): NaN where A is singular to the last digit."""
    try:
        return np.asarray(np.linalg.solve(matrices, right))
    except np.linalg.LinAlgError:
        regular = np.asarray(np.linalg.slogdet(matrices)[0] != 0)[..., None, None]
        return np.where(
            regular, np.linalg.solve(np.where(regular, matrices, np.eye(matrices.shape[-1])), right), np.nan
        )
