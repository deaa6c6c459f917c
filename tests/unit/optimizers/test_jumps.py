"""Where the best value lies at the very jump of a metric: found from both sides, with and without slopes."""

from __future__ import annotations

import math

import pytest
from scipy.optimize import brentq

from optimizers.methods import minimize
from optimizers.problem import Goal, Sense
from tests.unit.optimizers.test_methods import problem

SETTLING = Goal(metric="settling_time", experiment="step", output="y", sense=Sense.MINIMIZE)

# At this damping the overshoot exp(-πζ/√(1-ζ²)) is the half width of the band, 2 %: with less the response enters it half a period later.
EDGE = -math.log(0.02) / math.hypot(math.pi, math.log(0.02))


def first_entry(damping: float, frequency: float) -> float:
    """Return when y = 1 - e^(-ζωt) (cos ω_d t + ζ/√(1-ζ²) sin ω_d t) reaches 0.98, s."""
    root = math.sqrt(1 - damping**2)

    def below(t: float) -> float:
        angle = root * frequency * t
        return 0.02 - math.exp(-damping * frequency * t) * (math.cos(angle) + damping / root * math.sin(angle))

    return float(brentq(below, 1e-9, math.pi / (root * frequency), xtol=1e-14))


@pytest.mark.parametrize(("method", "seed"), [("gradient", 0), ("gradient", 1), ("gradient", 2), ("global", 0)])
def test_the_optimum_at_a_jump_of_the_settling_time(method: str, seed: int) -> None:
    best = first_entry(EDGE, 2.0)
    found = minimize(method, problem(SETTLING), {"seed": seed})
    assert found.objective == pytest.approx(best, rel=1e-4)
    assert found.objective >= best * (1 - 1e-9)
    assert found.certificate.valid


def test_the_optimum_at_a_jump_along_a_valley() -> None:
    """The jump lies along a line of both variables: as fast as allowed, and damped to the edge."""
    found = minimize("gradient", problem(SETTLING, variables=("z", "w")), {"seed": 1})
    assert found.objective == pytest.approx(first_entry(EDGE, 10.0), rel=1e-3)
    assert found.best["w"] == pytest.approx(10.0, rel=1e-3)
    assert found.best["z"] == pytest.approx(EDGE, rel=1e-3)
