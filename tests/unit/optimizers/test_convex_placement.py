"""Springs and dampers: one place by the convex-concave procedure, several by linear matrix inequalities."""

import numpy as np
import pytest

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from optimizers.methods import minimize
from optimizers.problem import Goal, Problem, Sense, Variable
from optimizers.search.result import Status

OMEGA = np.linspace(0.3, 2.0, 1201)
STIFFNESS, MASSES = [1.0, 0.1, 0.05], [1.0, 0.1, 0.05]


def chain(
    stiffness: list[float | str], damping: list[float | str], masses: list[float], parameters: dict[str, Parameter]
) -> Diagram:
    """Masses in a row from the ground, a spring and a damper before each; forces on the first and the last."""
    last = len(masses) - 1
    blocks = {"force": Block(kind="input"), "first": Block(kind="input")}
    links = [("first", "sum0.in2"), ("force", f"sum{last}.in2" if last else "sum0.in3")]
    for i, mass in enumerate(masses):
        blocks[f"sum{i}"] = Block(kind="sum", values={"signs": "-" + "+" * (2 if i in {0, last} and last else 1)})
        blocks[f"acceleration{i}"] = Block(kind="gain", values={"gain": 1 / mass})
        blocks[f"v{i}"], blocks[f"x{i}"] = Block(kind="integrator"), Block(kind="integrator")
        blocks[f"dv{i}"] = blocks[f"dx{i}"] = Block(kind="sum", values={"signs": "+-"})
        blocks[f"damper{i}"] = Block(kind="viscous_damper", values={"damping": damping[i]})
        blocks[f"spring{i}"] = Block(kind="gain", values={"gain": stiffness[i]})
        blocks[f"link{i}"] = Block(kind="sum", values={"signs": "++"})
        links += [
            (f"v{i}", f"dv{i}.in1"), (f"x{i}", f"dx{i}.in1"), (f"dv{i}", f"damper{i}"), (f"dx{i}", f"spring{i}"),
            (f"damper{i}", f"link{i}.in1"), (f"spring{i}", f"link{i}.in2"), (f"link{i}", f"sum{i}.in1"),
            (f"sum{i}", f"acceleration{i}"), (f"acceleration{i}", f"v{i}"), (f"v{i}", f"x{i}"),
        ]  # fmt: skip
        if i:
            links += [(f"v{i - 1}", f"dv{i}.in2"), (f"x{i - 1}", f"dx{i}.in2")]
            links.append((f"link{i}", f"sum{i - 1}.in{3 if i == 1 else 2}"))
    blocks["sum0"] = Block(kind="sum", values={"signs": "-++"})
    return compile_system(
        System(
            name="chain", parameters=parameters, blocks=blocks,
            connections=tuple(Connection(source=a, target=b) for a, b in links),
            outputs={"x0": "x0", "x": f"x{last}"},
        )
    )  # fmt: skip


def compliance(c0: float, c1: float, at: int = 0) -> float:
    """Return the largest |x/F| of the chain where the force acts on the mass that is looked at."""
    impedance = np.zeros((len(OMEGA), 3, 3), dtype=complex)
    for i, (k, c) in enumerate(zip(STIFFNESS, [0.0, c0, c1], strict=True)):
        ends = np.zeros(3)
        ends[i] = 1.0
        if i:
            ends[i - 1] = -1.0
        impedance += (k + 1j * OMEGA[:, None, None] * c) * np.outer(ends, ends)
    impedance -= OMEGA[:, None, None] ** 2 * np.diag(MASSES)
    return float(np.abs(np.linalg.inv(impedance)[:, at, at]).max())


def test_an_absorber_is_tuned_to_its_exact_optimum() -> None:
    # undamped mass 1 on a spring 1, absorber of mass 0.1: least peak of the compliance, in closed form: Asami, Nishihara,
    # "Closed-form exact solution to H∞ optimization of dynamic vibration absorbers", J. Vib. Acoust. 125 (2003) 398-405
    mu = 0.1
    peak = np.sqrt(((8 + 9 * mu) ** 2 * (16 + 9 * mu) - 128 * (4 + 3 * mu) ** 1.5) / (3 * (32 + 27 * mu))) / (3 * mu)
    damping = 0.25 * np.sqrt((8 + 9 * mu - 4 * np.sqrt(4 + 3 * mu)) / (1 + mu))
    diagram = chain(
        [1.0, "=k"], [0.0, "=c"], [1.0, mu],
        {"k": Parameter(value=0.05, lower=0.01, upper=0.5), "c": Parameter(value=0.1, lower=0.001, upper=1.0)},
    )  # fmt: skip
    problem = Problem(
        diagram=diagram, variables=(Variable(parameter="k"), Variable(parameter="c")),
        goals=(Goal(metric="compliance_peak", source="first", target="x0", sense=Sense.MINIMIZE),),
    )  # fmt: skip
    result = minimize("convex", problem, {"starts": 1})

    assert result.status is Status.CONVERGED
    assert result.objective == pytest.approx(peak, rel=1e-6)
    ratio = np.sqrt(result.best["k"] / mu)
    assert result.best["c"] / (2 * mu * ratio) == pytest.approx(damping, rel=1e-3)


def dampers(**changes: object) -> Problem:
    """Two absorbers in a row on an undamped mass: the product of their dampers matters, so this is no linear loop."""
    gains = {f"c{i}": Parameter(value=0.02, lower=0.0, upper=0.5) for i in range(2)}
    diagram = chain(list(STIFFNESS), [0.0, "=c0", "=c1"], MASSES, gains)
    parts: dict[str, object] = {
        "diagram": diagram, "variables": tuple(Variable(parameter=name) for name in gains),
        "goals": (Goal(metric="compliance_peak", source="first", target="x0", sense=Sense.MINIMIZE),),
    }  # fmt: skip
    return Problem(**{**parts, **changes})


def test_two_dampers_reach_the_optimum_of_a_dense_search() -> None:
    result = minimize("convex", dampers(), {"starts": 1})

    least = min(compliance(a, b) for a in np.linspace(0.04, 0.08, 21) for b in np.linspace(0.0, 0.5, 51))
    assert result.status is Status.CONVERGED
    assert result.objective <= least
    assert result.objective == pytest.approx(least, rel=5e-3)  # what the grid of the search leaves
    assert result.objective == pytest.approx(compliance(result.best["c0"], result.best["c1"]), rel=1e-4)


def test_a_budget_of_damping_goes_where_it_serves_best() -> None:
    # c0 + c1 = 0.1: one line through the plane, searched densely
    total = Variable(parameter="c1", expression="=0.1 - c0")
    problem = dampers(variables=(Variable(parameter="c0", lower=0.0, upper=0.1), total))
    result = minimize("convex", problem, {"starts": 1})

    least = min(compliance(share, 0.1 - share) for share in np.linspace(0.0, 0.1, 401))
    assert result.status is Status.CONVERGED
    assert result.objective == pytest.approx(least, rel=1e-4)
    assert result.best["c0"] + result.best["c1"] == pytest.approx(0.1, rel=1e-12)


def test_a_bound_on_another_place_is_held() -> None:
    free = minimize("convex", dampers(), {"starts": 1})
    there = compliance(free.best["c0"], free.best["c1"], 2)
    elsewhere = Goal(metric="compliance_peak", source="force", target="x", upper=0.95 * there)
    result = minimize("convex", dampers(goals=(*dampers().goals, elsewhere)), {"starts": 1})

    assert result.status is Status.CONVERGED
    assert result.certificate.valid
    assert compliance(result.best["c0"], result.best["c1"], 2) == pytest.approx(0.95 * there, rel=1e-3)
    assert result.objective > free.objective
