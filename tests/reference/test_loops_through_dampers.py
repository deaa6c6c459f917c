"""A damper whose current follows its own force at once: an algebraic loop that is solved at every instant, held against LSODA.

The reference finds the current by bisection, with the force that it makes; the law's slope by it is below 1, so that there is one.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from engine.analysis.evaluation import Evaluation
from engine.diagram.diagram import Diagram, compile_system
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document

SPRING, TYRE, BODY, WHEEL, WANTED = 18_000.0, 180_000.0, 300.0, 40.0, 2000.0
DAMPERS = {
    "dahl": block("mr_damper_dahl", damping=[300, 200], friction=[50, 400], rho=500.0),
    "bingham": block("mr_damper_bingham", yield_force=[50, 400], damping=[300, 200], transition_velocity=0.02),
}


def quarter_car(damper: str, transition: float) -> Diagram:
    body = [-SPRING / BODY, 0.0, SPRING / BODY, 0.0]
    wheel = [SPRING / WHEEL, 0.0, -(SPRING + TYRE) / WHEEL, 0.0]
    car = block(
        "state_space", A=[[0, 1, 0, 0], body, [0, 0, 0, 1], wheel], B=[[0, 0], [0, -1 / BODY], [0, 0], [TYRE / WHEEL, 1 / WHEEL]],
        C=[[1, 0, 0, 0], [0, 1, 0, 0], [0, 1, 0, -1]], D=[[0, 0]] * 3, inputs=["road", "force"],
        outputs=["position", "velocity", "relative"],
    )  # fmt: skip
    blocks = {
        "road": block("input"), "car": car, "damper": DAMPERS[damper], "wanted": block("gain", gain=WANTED),
        "law": block("clipped_optimal", off=0.0, on=1.0, transition=transition),
    }  # fmt: skip
    wires = [
        "road -> car.road", "car.relative -> damper.velocity", "damper.force -> car.force", "law.current -> damper.current",
        "car.velocity -> wanted", "wanted -> law.wanted_force", "damper.force -> law.force",
    ]  # fmt: skip
    return compile_system(document(blocks, wires, {"position": "car.position", "current": "law.current"}))


def force(damper: str, relative: float, hysteresis: float) -> Callable[[float], float]:
    friction = hysteresis if damper == "dahl" else np.tanh(relative / 0.02)
    return lambda current: (300 + 200 * current) * relative + (50 + 400 * current) * friction


@pytest.mark.parametrize(("damper", "transition"), [("dahl", 2e4), ("bingham", 2e5)])
def test_it_is_followed_to_its_end(damper: str, transition: float) -> None:
    def rates(t: float, x: np.ndarray) -> list[float]:
        relative = x[1] - x[3]
        made = force(damper, relative, x[4])
        missing = lambda i: i - 0.5 * (1 + np.tanh((WANTED * x[1] - made(i)) * made(i) / transition))  # noqa: E731
        found = made(brentq(missing, -1e-9, 1 + 1e-9, xtol=1e-15))
        pushed = SPRING * (x[0] - x[2])
        road = TYRE * (x[2] - 0.05 * np.sin(8 * t))
        return [
            x[1],
            (-pushed - found) / BODY,
            x[3],
            (pushed + found - road) / WHEEL,
            500 * (relative - abs(relative) * x[4]),
        ]

    time = np.linspace(0.0, 1.0, 41)
    expected = solve_ivp(rates, (0, 1), np.zeros(5), "LSODA", time, rtol=1e-10, atol=1e-13, max_step=2e-3).y[0]
    road = {"road": make("sine", {"amplitude": 0.05, "frequency": 8.0})}
    found = Evaluation(quarter_car(damper, transition)).simulated(road, 1.0)
    assert found.outcome.verdict is Verdict.OK
    np.testing.assert_allclose(np.ravel(found.sample("position", time)), expected, atol=1e-8)
