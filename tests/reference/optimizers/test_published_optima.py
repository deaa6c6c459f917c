"""A share of the benchmark of the optimisers; `make bench-optimizers` runs all of it."""

from __future__ import annotations

import pytest

from bench.optimizers import cases_integrals, cases_servo
from bench.optimizers.cases_convex import Case
from bench.optimizers.outcome import solve


@pytest.mark.parametrize(
    ("case", "method"),
    [
        (cases_integrals.parabola(), "gradient"),
        (cases_integrals.parabola(), "global"),
        (cases_integrals.itae_form(3), "gradient"),
        (cases_integrals.formulas("load", "iae"), "gradient"),
        (cases_integrals.robust_pi("1/(s+1)^3", 1.4, 3.0739), "gradient"),
        (cases_servo.settling(), "gradient"),
    ],
    ids=lambda value: value.name if isinstance(value, Case) else value,
)
def test_a_published_optimum_is_reached_and_proven(case: Case, method: str) -> None:
    outcome = solve(case, method, {"seed": 1, "starts": 2} if method == "gradient" else {"seed": 1, "restarts": 0})
    assert outcome.violation <= 1e-6
    assert outcome.gap <= case.tolerance
    assert outcome.met
