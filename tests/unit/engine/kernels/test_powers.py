"""Powers of the matrix exponential against scipy's, eight different matrices side by side."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import expm

from engine.batch.kernels.compiled import LANES
from engine.batch.kernels.powers import LEVELS, raise_powers


class Raised(NamedTuple):
    """What the kernel made of matrices (LANES, n, n) and drives (LANES, n, 1)."""

    levels: int
    step: np.ndarray
    powers: np.ndarray
    norms: np.ndarray
    rest: np.ndarray
    growth: np.ndarray
    alive: np.ndarray


def raised(matrices: np.ndarray, drives: np.ndarray) -> Raised:
    n = matrices.shape[-1]
    padded = -(-n // 4) * 4
    a, b = np.zeros((padded, padded, LANES)), np.zeros((padded, 1, LANES))
    a[:n, :n] = matrices.transpose(1, 2, 0)
    b[:n] = drives.transpose(1, 2, 0)
    powers, norms = np.full((LEVELS, padded, padded, LANES), np.nan), np.full((LEVELS, LANES), np.nan)
    rest, work = np.full((padded, 1, LANES), np.nan), np.full((6, padded, padded, LANES), np.nan)
    alive, step, growth = np.ones(LANES), np.full(LANES, np.nan), np.full(LANES, np.nan)
    levels = raise_powers(
        a, b, n, padded, 1, alive, step, powers, norms, rest, growth, work, np.empty((2, padded, 1, LANES)), 0
    )
    return Raised(levels, step, powers[:, :n, :n], norms, rest[:n], growth, alive)


def stable(n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return matrices with eigenvalues left of -0.3, of sizes from 1 to 1000, and drives."""
    rng = np.random.default_rng(seed)
    matrices = rng.standard_normal((LANES, n, n))
    rightmost = np.linalg.eigvals(matrices).real.max(axis=1)
    matrices -= (rightmost + 0.3)[:, None, None] * np.eye(n)
    matrices *= 10.0 ** (np.arange(LANES) % 4)[:, None, None]
    return matrices, rng.standard_normal((LANES, n, 1))


@pytest.mark.parametrize("n", [1, 3, 4, 8, 13])
def test_the_powers_are_those_of_scipy(n: int) -> None:
    matrices, drives = stable(n, n)
    made = raised(matrices, drives)
    for lane, matrix in enumerate(matrices):
        # by the eighth power, and by no less than a quarter of the norm
        norm = min(np.abs(matrix).sum(axis=k).max() for k in (0, 1))
        speed = np.abs(np.linalg.matrix_power(matrix / norm, 8)).sum(axis=1).max() ** 0.125
        assert made.step[lane] * norm * max(speed, 0.25) == pytest.approx(0.64)
        for level in range(0, made.levels, 3):
            exact = expm(matrix * made.step[lane] * 2.0**level)
            # squaring doubles what rounding did before
            np.testing.assert_allclose(
                made.powers[level, :, :, lane], exact, atol=1e-13 * 2 ** min(level, 12) * max(1.0, np.abs(exact).max())
            )


@pytest.mark.parametrize("n", [1, 5, 8])
def test_the_state_at_rest_is_that_of_a_constant_drive(n: int) -> None:
    matrices, drives = stable(n, 10 + n)
    made = raised(matrices, drives)
    for lane in range(LANES):
        rest = np.linalg.solve(matrices[lane], -drives[lane])
        np.testing.assert_allclose(made.rest[:, :, lane], rest, rtol=1e-10, atol=1e-11 * np.abs(rest).max())


def test_growth_has_the_sign_of_the_rightmost_eigenvalue() -> None:
    matrices, drives = stable(6, 3)
    for lane in (1, 4, 5):
        matrices[lane] += (0.4 * 10.0 ** (lane % 4)) * np.eye(6)
    rightmost = np.linalg.eigvals(matrices).real.max(axis=1)
    made = raised(matrices, drives)
    assert (np.sign(made.growth) == np.sign(rightmost)).all()
    assert made.growth == pytest.approx(rightmost, rel=0.5)


def test_a_lane_that_diverges_leaves_its_neighbours_as_they_were() -> None:
    matrices, drives = stable(6, 4)
    calm = raised(matrices, drives)
    wild = matrices.copy()
    wild[2] = 50.0 * np.eye(6)
    wild[7] = np.diag([1e3, -1e3, 1.0, -1.0, 0.0, 2.0])
    mixed = raised(wild, drives)
    others = [0, 1, 3, 4, 5, 6]
    shared = min(calm.levels, mixed.levels)
    np.testing.assert_array_equal(mixed.powers[:shared, :, :, others], calm.powers[:shared, :, :, others])
    np.testing.assert_allclose(mixed.rest[..., others], calm.rest[..., others], rtol=1e-13)
    np.testing.assert_array_equal(mixed.growth[others], calm.growth[others])
    assert (mixed.growth[[2, 7]] > 0).all()


@pytest.mark.parametrize("where", [(0, 0), (1, 2), (2, 1)])
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e250])
def test_a_matrix_that_is_not_finite_is_no_candidate_and_harms_nobody(where: tuple[int, int], value: float) -> None:
    matrices, drives = stable(4, 5)
    calm = raised(matrices, drives)
    broken = matrices.copy()
    broken[0][where] = broken[6][where] = value
    made = raised(broken, drives)
    assert made.alive.tolist() == [0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 1.0]
    others = [1, 2, 3, 4, 5, 7]
    np.testing.assert_allclose(made.rest[..., others], calm.rest[..., others], rtol=1e-13)
    np.testing.assert_array_equal(made.growth[others], calm.growth[others])


def test_an_integrator_neither_grows_nor_decays() -> None:
    matrices, drives = stable(3, 6)
    matrices[2] = np.diag([0.0, -1.0, -2.0])
    assert np.isnan(raised(matrices, drives).growth[2])
