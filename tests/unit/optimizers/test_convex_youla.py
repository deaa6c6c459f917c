"""What no linear controller can beat, against limits that interpolation theory gives in closed form."""

import numpy as np
import pytest

from bench.optimizers.cases_convex import CHOSEN, LEAST_ERROR, LOAD, PI, gain, loop, tracking
from engine.diagram.diagram import Block, Connection, System, compile_system
from engine.model.masks import Corners, FrequencyBounds, Rational
from optimizers.convex.linear_controller import linear_loops
from optimizers.convex.ratios import ratios_of
from optimizers.convex.youla import best_linear
from optimizers.methods import minimize
from optimizers.problem import Goal, Problem, Sense, Variable


def limit(problem: Problem) -> float | None:
    start = np.array([axis.start for axis in problem.axes])
    return best_linear(problem, linear_loops(problem, ratios_of(problem)), start)


@pytest.mark.parametrize(("pole", "zero"), [(1.0, 4.0), (2.0, 5.0)])
def test_an_unstable_pole_and_zero_limit_the_sensitivity_peak(pole, zero) -> None:
    # min ||S||∞ = |z + p| / |z - p| over all controllers (Skogestad, Postlethwaite, 2nd ed., section 5.3.3)
    diagram = loop(
        controller=Block(kind="p", values={"kp": "=kp"}), parameters={"kp": gain(2.5 * pole)}, numerator=[-1.0, zero],
        denominator=np.polymul([1.0, -pole], [1.0, 8.0]).tolist(),
    )  # fmt: skip
    goal = Goal(metric="sensitivity_peak", open_at="controller", sense=Sense.MINIMIZE)
    problem = Problem(diagram=diagram, variables=(Variable(parameter="kp"),), goals=(goal,))

    expected = (zero + pole) / (zero - pole)
    assert limit(problem) == pytest.approx(expected, rel=1e-3)
    assert limit(problem) <= expected * (1 + 1e-9)


def test_a_zero_limits_the_weighted_sensitivity() -> None:
    # stable plant with one zero z in the right half plane: min ||W S||∞ = |W(z)|
    weight = FrequencyBounds(upper=Rational(numerator=(1.0, 0.01), denominator=(0.5, 1.0)))
    diagram = loop(
        controller=PI,
        parameters={"kp": gain(0.1), "ki": gain(0.02)},
        numerator=[-1.0, 4.0],
        denominator=[1.0, 3.0, 2.0],
    )
    goal = Goal(metric="sensitivity_bound", open_at="controller", sense=Sense.MINIMIZE, mask=weight)
    found = limit(Problem(diagram=diagram, variables=CHOSEN, goals=(goal,)))

    expected = (0.5 * 4 + 1) / (4 + 0.01)
    assert found == pytest.approx(expected, rel=2e-3)
    assert found is not None
    assert found <= expected * (1 + 1e-9)


def test_what_is_asked_of_a_band_alone_has_no_limit() -> None:
    band = FrequencyBounds(upper=Corners(frequencies=(0.1, 1.0), magnitudes=(0.5, 0.5)))
    diagram = loop(
        controller=PI,
        parameters={"kp": gain(0.1), "ki": gain(0.02)},
        numerator=[-1.0, 4.0],
        denominator=[1.0, 3.0, 2.0],
    )
    goal = Goal(metric="sensitivity_bound", open_at="controller", sense=Sense.MINIMIZE, mask=band)
    assert limit(Problem(diagram=diagram, variables=CHOSEN, goals=(goal,))) == 0.0


def test_richer_controllers_come_near_the_limit() -> None:
    # the same plant and weight: PI, then five gains in parallel; nothing linear gets below |W(z)| = 0.7481
    poles = (0.3, 3.0, 30.0)
    laws = {
        "p": Block(kind="gain", values={"gain": "=g0"}),
        "i": Block(kind="integrator", values={"gain": "=g1"}),
        **{
            f"lag{k}": Block(
                kind="transfer_function", values={"numerator": [f"=g{k + 2}"], "denominator": [1 / a, 1.0]}
            )
            for k, a in enumerate(poles)
        },
    }
    links = [("reference", "error.in1"), ("plant", "error.in2"), ("law", "plant")]
    links += [link for k, name in enumerate(laws) for link in (("error", name), (name, f"law.in{k + 1}"))]
    diagram = compile_system(
        System(
            parameters={f"g{k}": gain(0.02 if k < 2 else 0.0, lower=-50.0, upper=50.0) for k in range(len(laws))},
            blocks={
                "reference": Block(kind="input"),
                "error": Block(kind="sum", values={"signs": "+-"}),
                "law": Block(kind="sum", values={"signs": "+" * len(laws)}),
                "plant": Block(
                    kind="transfer_function", values={"numerator": [-1.0, 4.0], "denominator": [1.0, 3.0, 2.0]}
                ),
                **laws,
            },
            connections=tuple(Connection(source=a, target=b) for a, b in links),
            outputs={"y": "plant"},
        )
    )
    weight = FrequencyBounds(upper=Rational(numerator=(1.0, 0.01), denominator=(0.5, 1.0)))
    goal = Goal(metric="sensitivity_bound", open_at="law", sense=Sense.MINIMIZE, mask=weight)
    variables = tuple(Variable(parameter=f"g{k}") for k in range(len(laws)))
    reached = [
        minimize(
            "convex", Problem(diagram=diagram, variables=variables[:count], goals=(goal,)), {"starts": 1}
        ).objective
        for count in (2, 5)
    ]
    assert 3 / 4.01 < reached[1] < 0.8
    assert reached[0] > 1.2


def test_a_bound_on_the_control_raises_the_limit() -> None:
    diagram = loop(
        controller=PI, parameters={"kp": gain(0.1), "ki": gain(0.02)}, numerator=[1.0], denominator=[1.0, 2.0, 1.0]
    )
    weight = FrequencyBounds(upper=Rational(numerator=(1.0, 0.01), denominator=(0.5, 1.0)))
    goal = Goal(metric="sensitivity_bound", open_at="controller", sense=Sense.MINIMIZE, mask=weight)
    limits = [
        limit(
            Problem(
                diagram=diagram, variables=CHOSEN,
                goals=(goal, Goal(metric="control_sensitivity_peak", source="reference", target="u", upper=upper)),
            )
        )
        for upper in (1.0, 10.0)
    ]  # fmt: skip
    # without control nothing beats S = 1, whose worst ratio is the inverse of the least weight, 1/2
    assert limits[0] is not None
    assert limits[1] is not None
    assert limits[1] < limits[0]
    # at rest |K S| ≤ 1 = 1/P(0) leaves S free; beyond, |1 - P R| ≥ 1 - |P(jω)| / |P(0)| for whatever R of that size
    omega = np.geomspace(1e-3, 1e2, 2001)
    least = ((1 - 1 / (1 + omega**2)) * np.abs((0.5j * omega + 1) / (1j * omega + 0.01))).max()
    assert limits[0] >= least * (1 - 1e-3)


def test_the_limit_is_told_beside_the_optimum() -> None:
    # systune's case: 1.4296 with PI and its filter; the limit must lie below what a controller reaches
    result = minimize("convex", tracking().problem, {"starts": 1, "limit": "linear"})
    assert result.bound is not None
    assert 1.0 < result.bound < result.objective
    assert f"{result.bound:.4g}" in result.advice


def test_the_integrated_error_has_no_limit() -> None:
    diagram = loop(
        controller=PI, parameters={"kp": gain(0.2), "ki": gain(0.05)}, numerator=[1.0], denominator=[1.0, 2.0, 1.0]
    )
    goals = (LEAST_ERROR, Goal(metric="sensitivity_peak", open_at="controller", upper=1.4))
    problem = Problem(diagram=diagram, variables=CHOSEN, experiments=(LOAD,), goals=goals)
    result = minimize("convex", problem, {"starts": 1, "limit": "linear"})
    assert result.bound is None
    assert "second integrator" in result.advice
