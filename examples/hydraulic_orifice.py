"""The hydraulic motor of hydraulic_leakage.py with what its linear model leaves out: a spool valve's orifices, two chambers.

Leakage damps and slows, the PD2 law restores the speed: as in the linear study, whose law is used here as it was found. But the
flow through an orifice falls with the pressure behind it, which damps; and the spool has an end, so that the law has
nothing to give where the step is large. Start a service with `make serve`, then

    .venv/bin/python examples/hydraulic_orifice.py --key KEY

where KEY is the key that the service printed when it started for the first time. The figure is written to hydraulic-orifice.png.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import servotune
from examples.hydraulic_leakage import DRIVE, GAINS, LEAKAGE, LEAKY, TIGHT, choose
from examples.presentation import label, panels, run, scaled, show, table
from servotune.replies import Metric, Simulation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DISCHARGE, GRADIENT, DENSITY, SUPPLY = 0.62, 0.015, 870, 21e6
FLOW_GAIN = DISCHARGE * GRADIENT * math.sqrt(SUPPLY / DENSITY)
"""Flow for a spool displacement while the motor needs no pressure, m²/s: half the supply pressure over each edge."""
SPOOL_END = 1e-3
LARGEST_FLOW = FLOW_GAIN * SPOOL_END
"""Of the open valve while the motor needs no pressure, m³/s."""

AREA = {"value": 50, "unit": "cm**2"}
MOTOR = {
    "name": "Velocity of a hydraulic motor with an orifice valve",
    "blocks": {
        **{name: DRIVE["blocks"][name] for name in ("reference", "error", "law", "displaced", "flow")},
        "opening": {"kind": "gain", "gain": 1 / FLOW_GAIN},
        "spool": {"kind": "low_pass", "frequency": 1500, "order": 2, "damping_ratio": 0.8},
        "valve": {
            "kind": "orifice_valve",
            "discharge_coefficient": DISCHARGE,
            "area_gradient": GRADIENT,
            "density": DENSITY,
            "stroke": SPOOL_END,
            "supply_pressure": SUPPLY,
        },
        "motor": {
            "kind": "hydraulic_cylinder",
            "area_a": AREA,
            "area_b": AREA,
            "stroke": {"value": 400, "unit": "mm"},
            "initial_position": {"value": 200, "unit": "mm"},
            "dead_volume_a": {"value": 1, "unit": "l"},
            "dead_volume_b": {"value": 1, "unit": "l"},
            "bulk_modulus": {"value": 1.4, "unit": "GPa"},
            "leakage": TIGHT,
            "mass": {"value": 1500, "unit": "kg"},
            "viscous_friction": {"value": 1200, "unit": "N*s/m"},
            "initial_pressure_a": SUPPLY / 2,
        },
    },
    "connections": [
        {"from": "reference", "to": "error.in1"},
        {"from": "motor.velocity", "to": "error.in2"},
        {"from": "error", "to": "law"},
        {"from": "reference", "to": "displaced"},
        {"from": "displaced", "to": "flow.in1"},
        {"from": "law", "to": "flow.in2"},
        {"from": "flow", "to": "opening"},
        {"from": "opening", "to": "spool"},
        {"from": "spool", "to": "valve.spool"},
        {"from": "motor.pressure_a", "to": "valve.pressure_a"},
        {"from": "motor.pressure_b", "to": "valve.pressure_b"},
        {"from": "valve.flow_a", "to": "motor.flow_a"},
        {"from": "valve.flow_b", "to": "motor.flow_b"},
    ],
    "outputs": {"velocity": "motor.velocity", "flow": "valve.flow_a", "pressure": "motor.pressure_a"},
}
STEPS = {"small": 0.05, "large": 0.15}
"""Steps of the velocity, m/s."""

Replies = Mapping[str, Simulation]


def study(client: servotune.Client) -> Figure:
    """Compare little leakage, much, and much with the law of the linear study, for a small step and a large one."""
    off = {name: 0 for name, _ in GAINS}
    cases = {
        "9.1 cm⁵/(daN·s)": {LEAKAGE: TIGHT, **off},
        "45 cm⁵/(daN·s)": {LEAKAGE: LEAKY, **off},
        "45 cm⁵/(daN·s), PD2": {LEAKAGE: LEAKY, **choose(client)},
    }
    replies = {size: simulate(client, velocity, list(cases.values())) for size, velocity in STEPS.items()}
    linear = client.simulate(DRIVE, input=step(1.0), duration=0.15, outputs=["velocity"], variants=list(cases.values()))
    report(list(cases), replies, linear)
    return draw(list(cases), replies, linear)


def step(velocity: float) -> dict[str, Any]:
    """Return a step of the velocity wanted."""
    return {"port": "reference", "signal": {"kind": "step", "amplitude": velocity}}


def simulate(client: servotune.Client, velocity: float, variants: Sequence[Mapping[str, Any]]) -> Simulation:
    """Return the answers to a step, followed until nothing moves but the piston."""
    metrics = ["overshoot", "rise_time", "response_time", "peak"]
    return client.simulate(MOTOR, input=step(velocity), duration=1.25, samples=5001, metrics=metrics, variants=variants)


def report(cases: Sequence[str], replies: Replies, linear: Simulation) -> None:
    """Print what each case makes of each step."""
    rows = []
    for number, name in enumerate(cases):
        for size, reply in replies.items():
            metrics = reply["variants"][number]["metrics"]
            velocity, flow = metrics["velocity"], metrics["flow"]
            rows.append((
                f"{name}, {size} step",
                percent(velocity["overshoot"]),
                show(velocity["rise_time"], 1e3, "ms"),
                show(velocity["response_time"], 1e3, "ms"),
                show(flow["peak"], 1e3, "l/s"),
            ))  # fmt: skip
        velocity = linear["variants"][number]["metrics"]["velocity"]
        rows.append((
            f"{name}, linear",
            percent(velocity["overshoot"]),
            show(velocity["rise_time"], 1e3, "ms"),
            show(velocity["response_time"], 1e3, "ms"),
            "-",
        ))  # fmt: skip
    table(("leakage", "overshoot", "rise time", "response time", "largest flow"), rows)


def percent(metric: Metric) -> str:
    """Return a ratio in percent, to a tenth: what is left of a slow end is not an overshoot."""
    return metric["verdict"] if metric["value"] is None else f"{100 * metric['value']:.1f} %"


def draw(names: Sequence[str], replies: Replies, linear: Simulation) -> Figure:
    """Return the velocities in parts of their steps, and flow and pressure of the large one."""
    figure, (small, large, flow, pressure) = panels(2, 2, size=(11, 7))
    for panel, size in ((small, "small"), (large, "large")):
        velocities(panel, names, replies[size], STEPS[size])
    for number, variant in enumerate(linear["variants"]):
        note: Any = {"label": "linear model"} if number == 0 else {}
        curve = variant["outputs"]["velocity"]
        small.plot(scaled(variant["time"], 1e3), curve, color="0.6", linestyle="-", linewidth=0.8, zorder=1, **note)
    for name, variant in zip(names, replies["large"]["variants"], strict=True):
        time = scaled(variant["time"], 1e3)
        flow.plot(time, scaled(variant["outputs"]["flow"], 1e3), label=name)
        pressure.plot(time, scaled(variant["outputs"]["pressure"], 1e-5), label=name)
    flow.axhline(1e3 * LARGEST_FLOW, color="0.5", linewidth=0.8, linestyle="-", label="spool at its end")
    label(small, title="Step of 0.05 m/s", x="time, ms", y="velocity per step", xlim=SHOWN, ylim=(0, 1.4))
    label(large, title="Step of 0.15 m/s", x="time, ms", y="velocity per step", xlim=SHOWN, ylim=(0, 1.4), legend=False)
    label(flow, title="Flow into the chamber, step of 0.15 m/s", x="time, ms", y="flow, l/s", xlim=SHOWN, ylim=(0, 1.6))
    title = "Pressure of the chamber, step of 0.15 m/s"
    label(pressure, title=title, x="time, ms", y="pressure, bar", xlim=SHOWN, legend=False)
    return figure


SHOWN = (0, 120)


def velocities(panel: Axes, names: Sequence[str], reply: Simulation, step: float) -> None:
    """Draw the velocities of all cases in parts of the step."""
    for name, variant in zip(names, reply["variants"], strict=True):
        panel.plot(scaled(variant["time"], 1e3), scaled(variant["outputs"]["velocity"], 1 / step), label=name)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the script and return its exit code."""
    return run(study, arguments)


if __name__ == "__main__":
    sys.exit(main())
