"""Laws that switch by a signal that dies away: right as long as its sign is known, then a stated doubt, never a wrong number."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from engine.analysis.measuring import MetricRequest, measure
from engine.diagram.diagram import Diagram, compile_system
from engine.exact.nonlinear.integrate import Integration
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.reference.event_driven._loop import Command
from tests.reference.event_driven._semi_active import SemiActive
from tests.unit.engine.diagrams import block, document

STEP = {"r": make("step", {})}
OMEGA, ZETA = 30.0, 0.5
DAMPED = OMEGA * np.sqrt(1 - ZETA**2)


def behind(kind: str, oscillates: bool = True, **values: Any) -> Diagram:
    """Return ∫ law(v), where v is the velocity of an oscillation that dies away, or of a lag."""
    form = ([OMEGA**2, 0.0], [1.0, 2 * ZETA * OMEGA, OMEGA**2]) if oscillates else ([1.0, 0.0], [0.1, 1.0])
    blocks = {
        "r": block("input"), "v": block("transfer_function", numerator=form[0], denominator=form[1]), "law": block(kind, **values),
        "one": block("constant", value=1.0), "y": block("integrator"),
    }  # fmt: skip
    ports = ["v -> law.control", "one -> law.in1"] if kind == "switch" else ["v -> law"]
    wires = ["r -> v", *ports, "law -> y"]
    return compile_system(document(blocks, wires, {"y": "y"}))


def alternating(t: float) -> float:
    """Return ∫ sign(v): v has the sign of sin(ω_d t), which changes every π/ω_d."""
    half = np.pi / DAMPED
    count = int(t / half)
    return (count % 2) * half + (1 - 2 * (count % 2)) * (t - count * half)


@pytest.mark.parametrize(
    ("kind", "values", "scale"),
    [
        ("relay", {}, (-1.0, 1.0)),
        ("relay", {"hysteresis": 1e-15}, (-1.0, 1.0)),
        ("switch", {}, (0.0, 1.0)),
        ("function", {"expression": "3 + 2*sign(u1)"}, (1.0, 5.0)),
        ("user_equations", {"inputs": ["u"], "outputs": ["w"], "equations": "w = sign(u)"}, (-1.0, 1.0)),
    ],
)
def test_behind_an_oscillation_that_dies_away(kind: str, values: dict[str, Any], scale: tuple[float, float]) -> None:
    diagram = behind(kind, **values)
    outcome = Integration(diagram.laws(), STEP).advance(1.0)
    assert outcome.verdict is Verdict.OK, outcome.advice
    low, high = scale
    expected = 0.5 * (low + high) + 0.5 * (high - low) * alternating(1.0)
    assert outcome.after[0, 0] == pytest.approx(expected, abs=1e-9)

    # exp(-ζ ω t) is 1e-10 at 1.54 s: from then on the integral would run away with the last sign, to 3.5 at 5 s
    request = MetricRequest(metric="peak", signals=STEP, output="y", duration=5.0)
    ((found, _),) = measure(diagram, [request])
    assert found.verdict is Verdict.DOUBTFUL
    assert found.value is None
    assert "law is in is not known" in found.advice


def test_a_sign_of_what_is_0_with_it_does_not_matter() -> None:
    """∫ v |v|, written with a sign that changes for as long as anybody can tell, by a rule of Gauss on every half wave."""
    outcome = Integration(behind("function", expression="sign(u1)*u1**2").laws(), STEP).advance(5.0)
    assert outcome.verdict is Verdict.OK, outcome.advice
    nodes, weights = np.polynomial.legendre.leggauss(40)
    half = np.pi / DAMPED
    expected = 0.0
    for k in range(20):
        t = half * (k + 0.5 * (1 + nodes))
        v = OMEGA**2 / DAMPED * np.exp(-ZETA * OMEGA * t) * np.sin(DAMPED * t)
        expected += 0.5 * half * float(weights @ (v * np.abs(v)))
    assert outcome.after is not None
    assert outcome.after[0, 0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("oscillates", [True, False])
def test_a_hysteresis_that_is_seen_keeps_its_side(oscillates: bool) -> None:
    outcome = Integration(behind("relay", oscillates, hysteresis=1e-3).laws(), STEP).advance(20.0)
    assert outcome.verdict is Verdict.OK, outcome.advice


def test_a_quantizer_that_ends_on_an_edge() -> None:
    """It oscillates around 1, the edge between the levels 0 and 2."""
    blocks = {
        "r": block("input"), "v": block("transfer_function", numerator=[1.0], denominator=[0.01, 0.1, 1.0]),
        "law": block("quantizer", step=2.0), "y": block("integrator"),
    }  # fmt: skip
    diagram = compile_system(document(blocks, ["r -> v", "v -> law", "law -> y"], {"y": "y"}))
    outcome = Integration(diagram.laws(), STEP).advance(30.0)
    assert outcome.verdict is Verdict.DOUBTFUL
    assert outcome.end > 0.8 * np.log(1e10) / 5


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 6, 8, 9])
def test_a_groundhook_law_after_a_step(seed: int) -> None:
    """The base comes to rest before the body: from then on nobody knows the sign of its velocity."""
    made = SemiActive.random(np.random.default_rng(seed))
    loop = SemiActive({**made.p, "law": "groundhook"}, Command(kind="step", size=made.command.size))
    course = loop.course()
    outcome = Integration(loop.diagram().laws(), {"r": loop.command.signal()}).advance(loop.duration)
    unknown = np.log(1e10) / (made.p["d"] * np.sqrt(made.p["kp"]))  # when z' has gone down to 1e-10
    assert (outcome.verdict is Verdict.OK) == (loop.duration < unknown) or abs(loop.duration / unknown - 1) < 0.3
    times = np.linspace(0.0, min(outcome.end, loop.duration, 0.8 * unknown), 301)
    exact = course.outputs(times)
    for k, name in enumerate(loop.names):
        size = np.abs(exact[:, k]).max()
        assert np.abs(outcome.output(k).sample(times) - exact[:, k]).max() <= 1e-8 * size, name
    if outcome.verdict is not Verdict.OK:
        assert outcome.verdict is Verdict.DOUBTFUL
        assert "law is in is not known" in outcome.advice
