"""Numerical failures never leave the engine: a run ends with a verdict, an instant and the cause, a metric with a verdict."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import lu_factor

from engine.analysis.influence import influence
from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import simulate
from engine.diagram.diagram import compile_system
from engine.elements.integrator import Integrator
from engine.elements.multiplication import Multiplication
from engine.model.errors import EngineError, UnresolvedError
from engine.model.failures import numerical
from engine.model.verdicts import Verdict
from engine.signals import make
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable
from tests.unit.engine.diagrams import block, document


def _checked() -> None:
    with np.errstate(all="raise"):
        np.sqrt(np.array([-1.0]))


FAILURES = {
    "linear algebra": lambda: np.linalg.svd(np.full((2, 2), np.nan)),
    "not finite": lambda: lu_factor(np.full((2, 2), np.inf)),
    "overflow": lambda: 10.0**400,
    "division": lambda: 1.0 / float("0"),
    "floating point": _checked,
}


@pytest.mark.parametrize("kind", FAILURES)
def test_a_numerical_failure_becomes_an_error_of_the_engine(kind: str) -> None:
    with (
        pytest.raises(UnresolvedError, match="the loop must have values here that float64 can compute, got: "),
        numerical("the loop"),
    ):
        FAILURES[kind]()


@pytest.mark.parametrize("fault", [ValueError("a fault"), TypeError("a fault"), IndexError("a fault")])
def test_a_fault_of_the_program_stays_one(fault: Exception) -> None:
    with pytest.raises(type(fault), match="a fault"), numerical():
        raise fault


def failing(monkeypatch: pytest.MonkeyPatch, beyond: float, kind: str):
    """Return x' = u, y = g x²; the product fails numerically once x is beyond a value."""
    plain = Multiplication.outputs

    def outputs(m, mode, values):
        if np.any(np.real(m.z[0]) > beyond):
            FAILURES[kind]()
        return plain(m, mode, values)

    made = compile_system(
        document(
            {"u": block("input"), "x": block("integrator"), "q": block("multiplication"), "g": block("gain", gain="=g")},
            ["u -> x", "x -> q.in1", "x -> q.in2", "q -> g"], {"y": "g"}, g=2.0,
        )
    )  # fmt: skip
    monkeypatch.setattr(Multiplication, "outputs", outputs)
    return made


@pytest.mark.parametrize("kind", FAILURES)
def test_a_run_that_fails_ends_with_its_instant_and_cause(monkeypatch, kind) -> None:
    """x = t until 0.4, where the law fails."""
    made = failing(monkeypatch, 0.4, kind)
    found = simulate(made, signals={"u": make("step", {})}, duration=1.0)
    assert found.verdict is Verdict.DOUBTFUL
    (said,) = (warning.detail for warning in found.warnings)
    assert "t = 0.4" in said
    assert "float64" in said
    known = np.isfinite(found.curves["y"])
    assert 0.39 < found.time[known].max() <= 0.4
    np.testing.assert_allclose(found.curves["y"][known], 2 * found.time[known] ** 2, rtol=1e-9)


def test_what_fails_at_once_has_a_verdict_everywhere(monkeypatch) -> None:
    made = failing(monkeypatch, -1.0, "linear algebra")
    request = MetricRequest(metric="peak", signals={"u": make("step", {})}, output="y", duration=1.0)
    ((found, _),) = measure(made, [request])
    assert found.verdict is Verdict.DOUBTFUL
    table = influence(made, {"p": request}, ["g"])
    assert table.elasticities["p"]["g"].value is None


def test_a_candidate_that_fails_is_one_candidate(monkeypatch) -> None:
    """v' = 4 - v - sign v from v = k: a peak of k for k > 3, but above 5 there is a failure that no code foresees."""
    plain, met = Integrator.realize, []

    def realize(values):
        if np.any(np.real(values["initial"]) > 5.0):
            met.append(values["initial"])
            np.linalg.svd(np.full((2, 2), np.nan))
        return plain(values)

    made = compile_system(
        document(
            {"u": block("input"), "e": block("sum", signs="+-"), "x": block("integrator", initial="=k"),
             "f": block("friction", coulomb=1.0, viscous=1.0)},
            ["u -> e.in1", "f -> e.in2", "e -> x", "x -> f"], {"v": "x"}, k=1.0,
        )
    )  # fmt: skip
    monkeypatch.setattr(Integrator, "realize", realize)
    problem = Problem(
        diagram=made, variables=(Variable(parameter="k", lower=2.0, upper=8.0),),
        experiments=(Experiment(name="step", signals={"u": make("step", {"amplitude": 4.0})}),),
        goals=(Goal(metric="peak", experiment="step", output="v", sense=Sense.MAXIMIZE),),
    )  # fmt: skip
    found = minimize("grid", problem, {"points": 13})
    assert found.best["k"] == pytest.approx(5.0)
    assert met


def test_a_matrix_that_is_not_finite_is_named() -> None:
    with pytest.raises(EngineError, match="array must not contain infs or NaNs"), numerical():
        FAILURES["not finite"]()
