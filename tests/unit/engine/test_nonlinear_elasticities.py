"""Elasticities of nonlinear systems: exact where the response is smooth, converged differences where not, and marked."""

from __future__ import annotations

import math

import numpy as np
import pytest

from engine.analysis.commanded import CommandParameter
from engine.analysis.influence import Method, influence
from engine.analysis.measuring import MetricRequest
from engine.diagram.diagram import compile_system
from engine.elements import catalogue
from engine.elements._nonlinear import NonlinearElement
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document


def saturated():
    return compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+-"), "s": block("saturation"), "x": block("integrator")},
            ["r -> e.in1", "x -> e.in2", "e -> s", "s -> x"],
            {"y": "x"},
        )
    )


def test_a_number_of_the_command():
    """x' = sat(A - x): t_r = (A - 1) + ln(10/A) - A/10, so dt_r/dA = 9/10 - 1/A."""
    signals = {"r": make("step", {"amplitude": 3.0})}
    request = {"t": MetricRequest(metric="rise_time", signals=signals, output="y")}
    commands = {"signals.r.amplitude": CommandParameter(signal=signals["r"], path="amplitude")}
    found = influence(saturated(), request, ["signals.r.amplitude", "s.upper"], commands=commands)
    value = 2 + math.log(10 / 3) - 0.3
    cell = found.elasticities["t"]["signals.r.amplitude"]
    expected = (0.9 - 1 / 3) * 3 / value
    assert (cell.method, cell.one_sided, cell.verdict) == (Method.DIFFERENCES, False, Verdict.OK)
    assert cell.value == pytest.approx(expected, rel=1e-7)
    assert abs(cell.value - expected) <= 4 * cell.error + 1e-12
    exact = found.elasticities["t"]["s.upper"]
    assert (exact.method, exact.error) == (Method.EXACT, None)
    changed = 2.3 + math.log(10 / 3.3) - 0.33
    coefficient = found.coefficients["t"]["signals.r.amplitude"]
    assert coefficient.final == pytest.approx(changed, abs=1e-9)
    assert coefficient.value == pytest.approx((changed / value - 1) / 0.1, rel=1e-7)


def test_a_number_of_the_command_of_a_linear_system_is_exact():
    """The overshoot of a step is relative, its peak is proportional to the amplitude."""
    made = compile_system(
        document({"r": block("input"), "m": block("mass_spring_damper", mass=1.0, stiffness=4.0, damping=0.4)},
                 ["r -> m.force"], {"y": "m.position"})
    )  # fmt: skip
    signals = {"r": make("step", {"amplitude": 2.0})}
    requests = {m: MetricRequest(metric=m, signals=signals, output="y") for m in ("peak", "overshoot")}
    commands = {"a": CommandParameter(signal=signals["r"], path="amplitude")}
    found = influence(made, requests, ["a"], commands=commands).elasticities
    assert found["peak"]["a"].value == pytest.approx(1.0, abs=1e-12)
    assert found["overshoot"]["a"].value == pytest.approx(0.0, abs=1e-12)
    assert found["peak"]["a"].method is Method.EXACT


def test_a_limit_that_is_only_touched():
    """max min(A sin t, u) at A = u: nothing more for a higher limit, all of it for a lower one."""
    made = compile_system(
        document({"r": block("input"), "s": block("saturation", lower=-0.5)}, ["r -> s"], {"y": "s"}),
    )
    signals = {"r": make("sine", {"amplitude": 1.0, "frequency": 1.0})}
    request = {"peak": MetricRequest(metric="peak", signals=signals, output="y", duration=6.0)}
    cell = influence(made, request, ["s.upper"]).elasticities["peak"]["s.upper"]
    assert (cell.method, cell.one_sided, cell.verdict) == (Method.DIFFERENCES, True, Verdict.DISCONTINUOUS)
    assert cell.value == pytest.approx(0.0, abs=1e-6)


def test_a_law_that_slides_along_one_of_its_factors():
    """f = a - (a - 0.1) e^-10t up to the force wanted, 2, then exactly 2; a = g/10.

    ∫|2 - f| = (2 - a) t + 0.19 with t = ln((a - 0.1)/(a - 2))/10.
    """
    made = compile_system(
        document(
            {"r": block("input"), "k": block("clipped_optimal"), "g": block("gain", gain=40.0),
             "f": block("integrator", initial=0.1), "n": block("sum", signs="+-"), "b": block("gain", gain=10.0)},
            ["r -> k.wanted_force", "f -> k.force", "k -> g", "g -> n.in1", "f -> b", "b -> n.in2", "n -> f"],
            {"f": "f"},
        )
    )  # fmt: skip
    signals = {"r": make("step", {"amplitude": 2.0})}
    request = {"iae": MetricRequest(metric="iae", signals=signals, output="f", duration=1.0)}
    found = influence(made, request, ["g.gain"])
    a = 4.0
    t, slope = math.log((a - 0.1) / (a - 2)) / 10, (1 / (a - 0.1) - 1 / (a - 2)) / 10
    value = (2 - a) * t + 0.19
    assert found.base["iae"].value == pytest.approx(value, abs=1e-9)
    cell = found.elasticities["iae"]["g.gain"]
    assert (cell.method, cell.one_sided) == (Method.EXACT, False)
    assert cell.value == pytest.approx((-t + (2 - a) * slope) * a / value, rel=1e-6)


LAWS = [kind for kind, element in catalogue().items() if issubclass(element, NonlinearElement)]


@pytest.mark.parametrize("kind", LAWS)
def test_every_law_has_a_table(kind):
    """Every cell has a value that is finite, or the word why there is none."""
    element = catalogue()[kind]
    values = {p.name: p.default for p in element.parameters} | dict(element.example)
    ports = element.ports(values)
    blocks = {"r": block("input"), "law": block(kind, **element.example),
              "lag": block("transfer_function", numerator=[1.0], denominator=[0.05, 1.0])}  # fmt: skip
    wires = [f"r -> law.{port}" for port in ports.inputs] + [f"law.{ports.outputs[0]} -> lag"]
    made = compile_system(document(blocks, wires, {"y": "lag"}))
    signals = {"r": make("sine", {"amplitude": 0.05, "frequency": 30.0})}
    requests = {m: MetricRequest(metric=m, signals=signals, output="y", duration=0.15) for m in ("peak", "ise")}
    numbers = [path for path, info in made.parameters.items() if path.startswith("law.") and not info.bound][:1]
    commands = {"signals.r.amplitude": CommandParameter(signal=signals["r"], path="amplitude")}
    found = influence(made, requests, [*numbers, "signals.r.amplitude"], commands=commands)
    for row in found.elasticities.values():
        for cell in row.values():
            assert (cell.value is None) == (cell.verdict not in {Verdict.OK, Verdict.DISCONTINUOUS}) or cell.one_sided
            assert cell.value is None or np.isfinite(cell.value)


def test_of_a_value_that_has_not_settled_the_elasticity_says_so():
    """x' = sat(3 - x) for 1.5 s: x = t, of which the window knows no end."""
    signals = {"r": make("step", {"amplitude": 3.0})}
    request = {"e": MetricRequest(metric="steady_state_error", signals=signals, output="y", duration=1.5)}
    found = influence(saturated(), request, ["s.upper"])
    assert found.base["e"].verdict is Verdict.NOT_SETTLED
    assert found.elasticities["e"]["s.upper"].verdict is Verdict.NOT_SETTLED
    # e = 3 - 1.5 u
    assert found.elasticities["e"]["s.upper"].value == pytest.approx(-1.0, rel=1e-9)
