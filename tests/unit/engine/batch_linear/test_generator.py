"""Characteristic roots of systems with delays, beside Lambert's function."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import lambertw

from engine.batch.linear.generator import eigenvalues_of
from engine.batch.linear.poles import growth_of

TAU = 0.004


def integrator(gains, *delays: float):
    """s + k e^(-s τ) = 0, the delay in one line or in several one behind the other."""
    gains, m = np.asarray(gains, dtype=float), len(delays)
    count = len(gains)
    b2, c2, d22 = np.zeros((count, 1, m)), np.zeros((count, m, 1)), np.zeros((count, m, m))
    b2[:, 0, -1], c2[:, 0, 0] = -gains, 1.0
    d22[:, np.arange(1, m), np.arange(m - 1)] = 1.0
    return eigenvalues_of(np.zeros((count, 1, 1)), b2, c2, d22, np.tile(delays, (count, 1)))


@pytest.mark.parametrize("delays", [(TAU,), (0.75 * TAU, 0.25 * TAU), (0.5 * TAU, 0.375 * TAU, 0.125 * TAU)])
@pytest.mark.parametrize("product", [0.3, 1.5, 1.6, 5.0])
def test_the_rightmost_root_of_a_delayed_integrator(delays, product) -> None:
    # delays one behind the other pass on all that comes in: their gain is 1 at every frequency, that of the loop is not
    expected = lambertw(-product).real / TAU
    assert growth_of(integrator([product / TAU], *delays)) == pytest.approx([expected], rel=1e-6)


@pytest.mark.parametrize("product", [1e3, 1e6, 1e12])
def test_a_loop_far_beyond_stability_has_one_of_its_unstable_roots(product) -> None:
    found = integrator([product / TAU], TAU)[0, 0]
    assert found.real > 0
    assert found + product / TAU * np.exp(-found * TAU) == pytest.approx(0.0, abs=1e-6 * abs(found))
    assert found.real <= lambertw(-product).real / TAU * (1 + 1e-9)


def test_candidates_do_not_disturb_each_other() -> None:
    alone, together = integrator([300.0], TAU), integrator([1e15, 300.0, 1e3], TAU)
    assert growth_of(together)[1] == pytest.approx(growth_of(alone)[0], rel=1e-12)
    assert growth_of(together)[0] > 0
