"""What is around a method: ranges, discrete variables, other methods as a check, the yield, structures."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from engine.diagram.diagram import Block, Connection, Parameter, System, compile_system
from engine.signals import make
from optimizers.problem import Experiment, Goal, Problem, ProblemError, Sense, Uncertain, Variable
from optimizers.search.result import Status, Unwatched
from optimizers.solving.expectation import expected, wilson
from optimizers.solving.robust import adversary
from optimizers.solving.solve import check_applicable, compare, solve
from tests.unit.optimizers.oscillator import damping_for, oscillator, problem

FEW = {"starts": 2, "seed": 1, "max_evaluations": 1500}
MASS = Uncertain(parameter="m", lower=0.5, upper=2.0)


def test_the_worst_corner_of_a_range_is_served() -> None:
    result = solve("gradient", problem(uncertain=(MASS,)), FEW, samples=400)
    # ζ = c / (2 √(m k)) is least for the largest mass.
    assert result.best["c"] == pytest.approx(2 * damping_for(0.04) * math.sqrt(2.0), rel=1e-5)
    assert result.robustness is not None
    assert result.robustness.violation <= 1e-6
    assert {scenario["m"] for scenario in result.robustness.scenarios} == {1.0, 0.5, 2.0}
    assert result.expected is not None
    assert result.expected.share == 1.0


def within() -> Problem:
    """A gain that is worst inside the range of w, not at its ends: a notch at 1 rad/s, its depth d, hit by w = 1 alone."""
    diagram = compile_system(
        System(
            parameters={"d": Parameter(value=0.5), "w": Parameter(value=1.4)},
            blocks={
                "u": Block(kind="input"),
                # (w s / (s² + w s + 1) has its summit of height 1 at 1 rad/s; (1 - (w - 1)²) scales it.
                "mode": Block(
                    kind="transfer_function",
                    values={"numerator": ["=d*(1-(w-1)**2)", 0.0], "denominator": [1.0, 1.0, 1.0]},
                ),
            },
            connections=(Connection(source="u", target="mode"),),
            outputs={"y": "mode"},
        )
    )
    return Problem(
        diagram=diagram,
        variables=(Variable(parameter="d", lower=0.1, upper=5.0),),
        goals=(
            Goal(metric="control_sensitivity_peak", source="u", target="y", sense=Sense.MAXIMIZE, upper=2.0),
        ),
        uncertain=(Uncertain(parameter="w", lower=0.5, upper=1.5),),
    )  # fmt: skip


def test_an_adversary_finds_what_is_worst_inside_a_range() -> None:
    threat = adversary(within(), {"d": 3.0}, 0, Unwatched())
    assert threat.scenario["w"] == pytest.approx(1.0, abs=1e-4)
    assert threat.violation == pytest.approx(0.5, rel=1e-6)
    result = solve("gradient", within(), FEW)
    # Height d at w = 1 may be 2; at the corners alone it would be d = 2 / 0.75.
    assert result.best["d"] == pytest.approx(2.0, rel=1e-5)
    assert result.robustness is not None
    assert result.robustness.rounds == 2
    assert result.certificate.valid


def test_the_yield_is_the_share_of_the_range() -> None:
    made = problem(uncertain=(MASS,))
    # The overshoot stays below 4 % for m up to (c / 2ζ)² / k; with c for m = 1.25 that is half of 0.5 … 2.
    c = 2 * damping_for(0.04) * math.sqrt(1.25)
    found = expected(made, {"c": c}, samples=2000, rng=np.random.default_rng(7), monitor=Unwatched())
    assert found.samples == 2000
    assert found.lower95 <= 0.5 <= found.upper95
    assert found.failures == {0: 0, 1: 2000 - round(found.share * 2000)}
    assert found.unstable == 0


@pytest.mark.parametrize(("k", "n", "interval"), [(0, 10, (0.0, 0.2775)), (10, 10, (0.7225, 1.0)), (5, 10, (0.2366, 0.7634))])  # fmt: skip
def test_wilsons_interval_is_that_of_the_tables(k, n, interval) -> None:
    # R. G. Newcombe, Statistics in Medicine 17 (1998) 857-872, method 3.
    assert wilson(k, n) == pytest.approx(interval, abs=1e-4)


def test_values_of_a_catalogue_are_the_only_ones() -> None:
    sizes = (0.5, 1.0, 1.5, 2.0, 3.0)
    result = solve("gradient", problem(variables=(Variable(parameter="c", choices=sizes),)), FEW, checks=("grid",))
    assert result.best["c"] == 1.5  # the smallest above 2 ζ = 1.431
    (gap,) = result.gaps
    assert gap.method == "grid"
    assert gap.gap == pytest.approx(0.0, abs=1e-9)


def test_discrete_and_continuous_variables_settle_together() -> None:
    # k is a whole number; the bandwidth grows with it, and c follows it.
    variables = (
        Variable(parameter="k", lower=1.0, upper=7.5, integer=True),
        Variable(parameter="c", lower=0.1, upper=20.0),
    )
    result = solve("gradient", problem(variables=variables), FEW)
    assert result.best["k"] == 7.0
    assert result.best["c"] == pytest.approx(2 * damping_for(0.04) * math.sqrt(7.0), rel=1e-4)


def test_structures_are_compared_by_their_goals() -> None:
    def arm(places: Mapping[str, float]) -> Problem:
        """Two masses between springs, free at one end; a damper to the ground beside the first or the second one."""
        diagram = compile_system(
            System(
                parameters={"c1": Parameter(value=places["c1"]), "c2": Parameter(value=places["c2"]), "c": Parameter(value=1.0)},
                blocks={
                    "force": Block(kind="input"),
                    "arm": Block(
                        kind="state_space",
                        values={
                            "A": [[0, 0, 1, 0], [0, 0, 0, 1], [-2, 1, "=-0.01-c*c1", 0], [1, -1, 0, "=-0.01-c*c2"]],
                            "B": [[0], [0], [0], [1]], "C": [[0, 1, 0, 0]], "D": [[0]],
                        },
                    ),
                },
                connections=(Connection(source="force", target="arm"),),
                outputs={"tip": "arm"},
            )
        )  # fmt: skip
        return Problem(
            diagram=diagram,
            variables=(Variable(parameter="c", lower=0.0, upper=5.0),),
            experiments=(Experiment(name="step", signals={"force": make("step", {})}),),
            goals=(Goal(metric="compliance_peak", source="force", target="tip", sense=Sense.MINIMIZE),),
        )

    compared = compare("gradient", {"base": arm({"c1": 1, "c2": 0}), "tip": arm({"c1": 0, "c2": 1})}, FEW)
    # At the tip both modes are damped; beside the base the tip can swing on its own spring.
    assert compared.best == "tip"
    assert compared.objectives["tip"] < compared.objectives["base"]
    assert compared.objectives["tip"] == pytest.approx(compared.results["tip"].objective, rel=1e-9)
    with pytest.raises(ProblemError, match="at least two"):
        compare("gradient", {"alone": arm({"c1": 1, "c2": 0})})


def test_what_cannot_be_had_is_refused() -> None:
    with pytest.raises(ProblemError, match="without uncertain") as caught:
        solve("gradient", problem(), FEW, samples=10)
    assert caught.value.at == ("yield_samples",)
    with pytest.raises(ProblemError, match="must name methods") as caught:
        solve("gradient", problem(), FEW, checks=("annealing",))
    assert caught.value.at == ("cross_check", 0)


def test_a_metric_that_its_experiment_does_not_define_is_refused() -> None:
    sine = Experiment(name="sine", signals={"force": make("sine", {"frequency": 2.0})})
    made = problem(
        experiments=(sine,), goals=(Goal(metric="overshoot", experiment="sine", output="x", sense=Sense.MINIMIZE),)
    )
    with pytest.raises(ProblemError, match="settles at a constant") as caught:
        check_applicable(made)
    assert caught.value.at == ("goals", 0, "metric")


def test_cancelled_before_it_began_it_still_has_a_result() -> None:
    class Impatient(Unwatched):
        def cancelled(self) -> bool:
            return True

    result = solve("gradient", problem(uncertain=(MASS,)), FEW, monitor=Impatient(), samples=100)
    assert result.status is Status.CANCELLED
    assert result.expected is None
    assert oscillator().parameters["c"].value == result.best["c"]
