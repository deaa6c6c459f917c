"""Hydraulic and pneumatic drives against an independent integration of their equations (scipy, DOP853 at 1e-12)."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from engine.analysis.study import simulate
from engine.diagram.diagram import compile_system
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document


def servo_cylinder(**cylinder: float):
    """Return a valve on a cylinder, the spool driven by the input."""
    return compile_system(
        document(
            {"r": block("input"), "v": block("orifice_valve", overlap=5e-5, tank_pressure=1e5),
             "c": block("hydraulic_cylinder", leakage=2e-12, **cylinder)},
            ["r -> v.spool", "c.pressure_a -> v.pressure_a", "c.pressure_b -> v.pressure_b",
             "v.flow_a -> c.flow_a", "v.flow_b -> c.flow_b"],
            {"x": "c.position", "v": "c.velocity", "pa": "c.pressure_a", "pb": "c.pressure_b", "q": "v.flow_a"},
        )
    )  # fmt: skip


def orifice(opening: float, difference: float) -> float:
    gain = 0.62 * 0.02 * np.sqrt(2 / 870)
    return gain * opening * difference / (difference**2 + 1e8) ** 0.25


def oil(_t: float, s: np.ndarray, spool: float) -> list[float]:
    x, v, a, b = s
    o = np.sign(spool) * max(abs(np.clip(spool, -1e-3, 1e-3)) - 5e-5, 0)
    qa = orifice(o, 10e6 - a) if o > 0 else orifice(o, a - 1e5)
    qb = -orifice(o, b - 1e5) if o > 0 else -orifice(o, 10e6 - b)
    leak = 2e-12 * (a - b)
    return [
        v, (2e-3 * a - 1.2e-3 * b - 500 * v) / 100,
        1e9 / (1e-4 + 2e-3 * x) * (qa - 2e-3 * v - leak),
        1e9 / (1e-4 + 1.2e-3 * (0.5 - x)) * (qb + 1.2e-3 * v + leak),
    ]  # fmt: skip


@pytest.mark.parametrize("spool", [3e-4, -2e-4, 5e-3])
def test_hydraulic_cylinder(spool):
    found = simulate(servo_cylinder(), signals={"r": make("step", {"amplitude": spool})}, duration=0.08, samples=201)
    ours = np.array([found.curves[name] for name in ("x", "v", "pa", "pb")])
    exact = solve_ivp(
        oil, (0, 0.08), [0.25, 0, 3e6, 5e6], args=(spool,), method="DOP853", rtol=1e-12, atol=1e-12, t_eval=found.time
    ).y
    assert found.verdict is Verdict.OK
    for mine, reference in zip(ours, exact, strict=True):
        np.testing.assert_allclose(mine, reference, atol=2e-10 * np.abs(reference).max())


def test_a_covered_spool_lets_nothing_through():
    found = simulate(servo_cylinder(), signals={"r": make("step", {"amplitude": 4e-5})}, duration=0.1)
    assert np.all(found.curves["q"] == 0.0)


def test_the_piston_stays_at_its_end():
    found = simulate(servo_cylinder(), signals={"r": make("step", {"amplitude": 1e-3})}, duration=3.0)
    assert found.verdict is Verdict.OK
    assert found.curves["x"].max() <= 0.5 * (1 + 1e-12)
    assert found.curves["x"][-1] == pytest.approx(0.5, abs=1e-12)
    assert found.curves["v"][-1] == 0.0
    # no flow any more: only the leakage passes the valve, whose pressure drop is then almost nothing
    assert found.curves["pa"][-1] == pytest.approx(10e6, rel=1e-2)


def test_a_rebounding_piston_comes_to_rest():
    found = simulate(servo_cylinder(restitution=0.5), signals={"r": make("step", {"amplitude": 1e-3})}, duration=3.0)
    assert found.verdict is Verdict.OK
    assert found.curves["x"].max() <= 0.5 * (1 + 1e-12)
    assert found.curves["v"].min() < -1e-3
    assert found.curves["v"][-1] == 0.0


def pneumatic(**given: float):
    return compile_system(
        document(
            {"r": block("input"), "c": block("pneumatic_cylinder", **given)},
            ["r -> c.command"],
            {"x": "c.position", "v": "c.velocity", "pa": "c.pressure_a", "pb": "c.pressure_b"},
        )
    )


def air(_t: float, s: np.ndarray, command: float) -> list[float]:
    x, v, pa, pb, ma, mb = s
    gas = 287.05
    volumes = (2e-5 + 8e-4 * x, 2e-5 + 6.9e-4 * (0.5 - x))
    outside = (7e5, 1e5) if command > 0 else (1e5, 7e5)
    rates = []
    for p, mass, volume, grows, other in zip(
        (pa, pb), (ma, mb), volumes, (8e-4 * v, -6.9e-4 * v), outside, strict=True
    ):
        inward = other >= p
        high, low = (other, p) if inward else (p, other)
        heat = gas * 293.15 if inward else p * volume / mass
        ratio = low / high
        linear = np.sqrt(1 - ((0.99 - 0.3) / 0.7) ** 2) / 0.01
        shape = 1.0 if ratio <= 0.3 else np.sqrt(1 - ((ratio - 0.3) / 0.7) ** 2)
        # laminar: proportional to the difference, which joins the curve where the inner pressure is 1 % from the other
        psi = high * shape if abs(1 - ratio) > 0.01 else linear * (high - low)
        flow = (1 if inward else -1) * abs(command) * 2e-8 * 1.185 * np.sqrt(293.15 * gas / heat) * psi
        rates.append((1.4 / volume * (heat * flow - p * grows), flow))
    force = 8e-4 * pa - 6.9e-4 * pb - 1.1e-4 * 1e5 - 50 * v
    return [v, force / 5, rates[0][0], rates[1][0], rates[0][1], rates[1][1]]


@pytest.mark.parametrize("command", [1.0, -0.3])
def test_pneumatic_cylinder(command):
    found = simulate(pneumatic(), signals={"r": make("step", {"amplitude": command})}, duration=0.12, samples=101)
    pb = (8e-4 * 3e5 - 1.1e-4 * 1e5) / 6.9e-4
    heat = 287.05 * 293.15
    start = [0.25, 0, 3e5, pb, 3e5 * (2e-5 + 8e-4 * 0.25) / heat, pb * (2e-5 + 6.9e-4 * 0.25) / heat]
    exact = solve_ivp(
        air, (0, 0.12), start, args=(command,), method="DOP853", rtol=1e-11, atol=1e-13, max_step=2e-4,
        t_eval=found.time,
    ).y  # fmt: skip
    for name, reference in zip(("x", "v", "pa", "pb"), exact, strict=False):
        np.testing.assert_allclose(found.curves[name], reference, atol=1e-7 * np.abs(reference).max())


def test_a_pneumatic_piston_reaches_its_end_and_the_pressures_those_outside():
    found = simulate(pneumatic(), signals={"r": make("step", {"amplitude": 1.0})}, duration=8.0)
    assert found.verdict is Verdict.OK
    assert found.curves["x"][-1] == pytest.approx(0.5, abs=1e-12)
    assert found.curves["v"][-1] == 0.0
    assert found.curves["pa"][-1] == pytest.approx(7e5, rel=1e-6)
    assert found.curves["pb"][-1] == pytest.approx(1e5, rel=1e-6)
