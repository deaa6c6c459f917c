"""From rest, neither cylinder gives back more than it took and had.

Hydraulic: oil of constant bulk modulus, V p' = β (Q - V'), stores V φ(p) with φ = β (e^(p/β) - 1) - p and brings w = β (e^(p/β) - 1) along
for each volume that flows in, its compression included: (V φ)' = w Q - p V', checked by differentiating. Hence

    ∫ (w_a Q_a + w_b Q_b - F v) dt = E - E_0 + ∫ (b v² + (w_a - w_b) c (p_a - p_b)) dt + what impacts take,   E = m v²/2 + Σ V φ >= 0

Pneumatic, valve closed: a chamber is a spring of air, p V^κ constant, which stores (p V - p_0 V_0)/(κ - 1). Valve open: the first law,
air coming in with at most the enthalpy κ R T/(κ - 1) of the sonic flow.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from engine.analysis.study import simulate
from engine.diagram.diagram import compile_system
from engine.signals import make
from tests.unit.engine.diagrams import block, document

SAMPLES = 16_001


def swinging(scale: float, fundamental: float):
    return make("multisine", {"amplitude": scale, "fundamental": fundamental, "harmonics": [1, 2, 3, 5, 8]})


def integral(time, power):
    return cumulative_simpson(power, x=time, initial=0.0)


def run(kind: str, commands, **values: object):
    made = compile_system(
        document(
            {name: block("input") for name in commands} | {"c": block(kind, **values)},
            [f"{name} -> c.{name}" for name in commands],
            {name: f"c.{name}" for name in ("position", "velocity", "pressure_a", "pressure_b")},
        )
    )
    found = simulate(made, signals=commands, duration=1.0, samples=SAMPLES)
    inputs = {name: signal.value(found.time) for name, signal in commands.items()}
    return found.time, found.curves, inputs


HYDRAULIC = {
    "area_a": 2e-3, "area_b": 1.2e-3, "stroke": 0.04, "dead_volume_a": 1e-4, "dead_volume_b": 1e-4, "bulk_modulus": 1e9,
    "mass": 100.0, "viscous_friction": 500.0,
}  # fmt: skip


@pytest.mark.parametrize(
    ("scale", "leakage", "restitution"), [(2e-5, 0.0, 0.0), (1e-3, 2e-12, 0.0), (1e-3, 2e-12, 0.8)]
)
def test_hydraulic_cylinder(scale, leakage, restitution):
    """The larger flows drive the piston against its ends."""
    c = HYDRAULIC
    commands = {"flow_a": swinging(scale, 9.0), "flow_b": swinging(-0.6 * scale, 9.0), "force": swinging(300.0, 11.0)}
    t, y, u = run(
        "hydraulic_cylinder", commands, **c, leakage=leakage, restitution=restitution, initial_position=0.02,
        initial_pressure_a=3e6,
    )  # fmt: skip
    x, v = y["position"], y["velocity"]
    a, b = y["pressure_a"], y["pressure_b"]
    volume_a = c["dead_volume_a"] + c["area_a"] * x
    volume_b = c["dead_volume_b"] + c["area_b"] * (c["stroke"] - x)
    w_a, w_b = (c["bulk_modulus"] * np.expm1(p / c["bulk_modulus"]) for p in (a, b))
    energy = 0.5 * c["mass"] * v**2 + volume_a * (w_a - a) + volume_b * (w_b - b)
    taken = integral(t, w_a * u["flow_a"] + w_b * u["flow_b"] - u["force"] * v)
    lost = integral(t, c["viscous_friction"] * v**2 + (w_a - w_b) * leakage * (a - b))
    by_impacts = taken - (energy - energy[0]) - lost
    size = np.abs(taken).max()
    assert energy.min() >= 0
    assert (taken + energy[0]).min() >= -1e-5 * size
    assert by_impacts.min() >= -1e-5 * size
    hit = x.min() <= 1e-9 or x.max() >= c["stroke"] - 1e-9
    assert hit == (scale > 1e-4)
    if not hit:
        assert np.abs(by_impacts).max() <= 1e-5 * size


PNEUMATIC = {
    "area_a": 8e-4, "area_b": 6.9e-4, "stroke": 0.5, "dead_volume_a": 2e-5, "dead_volume_b": 2e-5, "mass": 5.0,
    "viscous_friction": 50.0, "adiabatic_index": 1.4, "ambient_pressure": 1e5,
}  # fmt: skip


@pytest.mark.parametrize(("scale", "restitution"), [(60.0, 0.0), (4000.0, 0.8)])
def test_pneumatic_cylinder_with_its_valve_closed(scale, restitution):
    """The work of the load is kinetic energy, the energy of two springs of air, and what friction and impacts take."""
    c = PNEUMATIC
    t, y, u = run(
        "pneumatic_cylinder", {"force": swinging(scale, 4.0)}, **c, restitution=restitution, initial_position=0.2,
        initial_pressure_a=3e5,
    )  # fmt: skip
    taken = integral(t, -u["force"] * y["velocity"])
    x = y["position"]
    volume = c["dead_volume_a"] + c["area_a"] * x, c["dead_volume_b"] + c["area_b"] * (c["stroke"] - x)
    stored = 0.5 * c["mass"] * y["velocity"] ** 2
    for p, v in zip((y["pressure_a"], y["pressure_b"]), volume, strict=True):
        np.testing.assert_allclose(p * v**1.4, p[0] * v[0] ** 1.4, rtol=1e-8)  # adiabatic, whatever the piston does
        stored = stored + (p * v - p[0] * v[0]) / 0.4
    stored = stored + (c["area_a"] - c["area_b"]) * c["ambient_pressure"] * (x - x[0])
    lost = integral(t, c["viscous_friction"] * y["velocity"] ** 2)
    left = taken - stored - lost
    size = max(np.abs(taken).max(), stored.max())
    assert left.min() >= -1e-5 * size
    assert (taken - stored).min() >= -1e-5 * size
    assert stored.min() >= -1e-9 * size  # it began at rest, where the stored energy is least
    hit = x.min() <= 1e-9 or x.max() >= c["stroke"] - 1e-9
    assert hit == (scale > 100.0)
    if not hit:
        assert np.abs(left).max() <= 1e-5 * size


def test_pneumatic_cylinder_takes_its_energy_from_the_supply():
    """Stored and delivered together never exceed what the sonic flow C ρ_0 p_s through the open valve can have brought."""
    c = PNEUMATIC
    command, force = swinging(1.0, 3.0), swinging(100.0, 7.0)
    t, y, u = run("pneumatic_cylinder", {"command": command, "force": force}, **c, restitution=0.3)
    delivered = integral(t, u["force"] * y["velocity"])
    x = y["position"]
    volume = c["dead_volume_a"] + c["area_a"] * x, c["dead_volume_b"] + c["area_b"] * (c["stroke"] - x)
    inner = sum(p * v for p, v in zip((y["pressure_a"], y["pressure_b"]), volume, strict=True)) / 0.4
    surroundings = (c["area_a"] - c["area_b"]) * c["ambient_pressure"] * (x - x[0])
    kinetic = 0.5 * c["mass"] * y["velocity"] ** 2
    enthalpy = 1.4 / 0.4 * 287.05 * 293.15 * 2e-8 * 1.185 * 7e5  # of the sonic flow, W
    most = enthalpy * integral(t, np.abs(u["command"]))
    assert np.all(inner - inner[0] + surroundings + kinetic + delivered <= most + 1e-6 * most[-1])
    assert most[-1] > 0
