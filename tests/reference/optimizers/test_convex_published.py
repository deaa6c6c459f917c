"""The method convex against published optima, every bound held on the continuous frequency axis."""

import numpy as np
import pytest

from bench.optimizers.cases_convex import Case, astrom_hagglund, cases
from optimizers.methods import minimize
from optimizers.search.result import Status

# of the table every plant once; `make bench-optimizers` runs the rest
CASES = [case for case in cases() if "Ms = 2" not in case.name]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_published_optima_are_reached_with_bounds_that_hold_at_every_frequency(case: Case):
    result = minimize("convex", case.problem, {"starts": 1, **case.options})

    reached = result.objective if case.parameter is None else result.best[case.parameter]
    assert result.status is Status.CONVERGED
    assert reached == pytest.approx(case.published, rel=case.tolerance)
    assert result.certificate.valid


def test_the_largest_integral_gain_of_three_lags_is_that_of_a_dense_search():
    # |1 + L|² >= 1/Ms² for all ω is quadratic in (kp, ki): for each kp the largest ki follows from a root at every ω.
    sensitivity, omega = 1.4, np.geomspace(1e-2, 1e2, 20_001)
    plant = 1 / (1j * omega + 1) ** 3
    best = 0.0
    for kp in np.linspace(0.60, 0.67, 141):
        fixed, turning = 1 + kp * plant, plant / (1j * omega)
        a, b, c = np.abs(turning) ** 2, np.real(fixed * np.conj(turning)), np.abs(fixed) ** 2 - 1 / sensitivity**2
        discriminant = b**2 - a * c
        roots = (-b - np.sqrt(np.maximum(discriminant, 0))) / a
        limits = roots[(discriminant >= 0) & (roots > 0)]
        best = max(best, float(limits.min(initial=np.inf)))

    result = minimize("convex", astrom_hagglund("1/(s+1)^3", 1.4).problem, {"starts": 1})

    assert result.best["ki"] == pytest.approx(best, rel=1e-6)
