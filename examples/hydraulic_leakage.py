"""More leakage in a hydraulic motor damps it and makes it slow; a PD2 law then makes it fast again, without vibration.

The gradient of the leakage between the two rooms is raised from 9.1 to 45 cm⁵/(daN·s). The valve gets the flow that the velocity
asks for, and, in the third case, that of a law kp + kd1 s + kd2 s² of the velocity's error; its three gains are found
by an optimisation that limits overshoot, sensitivity and flow. Start a service with `make serve`, then

    .venv/bin/python examples/hydraulic_leakage.py --key KEY

where KEY is the key that the service printed when it started for the first time. The figure is written to hydraulic-leakage.png.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import servotune
from examples.presentation import label, panels, run, scaled, show, table
from servotune.replies import FrequencyResponse, Simulation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEAKAGE = "motor.leakage"
TIGHT, LEAKY = ({"value": value, "unit": "cm**5/(daN*s)"} for value in (9.1, 45))
DRIVE: dict[str, Any] = {
    "name": "Velocity of a hydraulic motor",
    "blocks": {
        "reference": {"kind": "input"},
        "error": {"kind": "sum", "signs": "+-"},
        "law": {"kind": "pd2", "kp": 0.01, "kd1": 1e-5, "kd2": 1e-8, "filter_frequency": 2000},
        "displaced": {"kind": "gain", "gain": {"value": 50, "unit": "cm**2"}},
        "flow": {"kind": "sum", "signs": "++"},
        "valve": {"kind": "proportional_valve", "flow_gain": 1, "natural_frequency": 1500, "damping_ratio": 0.8},
        "motor": {
            "kind": "linear_hydraulic_motor",
            "area": {"value": 50, "unit": "cm**2"},
            "volume": {"value": 4, "unit": "l"},
            "bulk_modulus": {"value": 1.4, "unit": "GPa"},
            "leakage": TIGHT,
            "mass": {"value": 1500, "unit": "kg"},
            "viscous_friction": {"value": 1200, "unit": "N*s/m"},
        },
    },
    "connections": [
        {"from": "reference", "to": "error.in1"},
        {"from": "motor.velocity", "to": "error.in2"},
        {"from": "error", "to": "law"},
        {"from": "reference", "to": "displaced"},
        {"from": "displaced", "to": "flow.in1"},
        {"from": "law", "to": "flow.in2"},
        {"from": "flow", "to": "valve"},
        {"from": "valve", "to": "motor.flow"},
    ],
    "outputs": {"velocity": "motor.velocity", "flow": "valve"},
}
STEP = {"port": "reference", "signal": {"kind": "step", "amplitude": {"value": 0.1, "unit": "m/s"}}}

LARGEST_FLOW = {"value": 2, "unit": "l/s"}
GAINS = (("law.kp", 0.02), ("law.kd1", 5e-5), ("law.kd2", 5e-8))
"""The gains of the law and their upper bounds, m³/s of flow per m/s, m/s² and m/s³."""


def study(client: servotune.Client) -> Figure:
    """Compare little leakage, much, and much with the law that an optimisation finds."""
    off = {name: 0 for name, _ in GAINS}
    cases = {
        "9.1 cm⁵/(daN·s)": {LEAKAGE: TIGHT, **off},
        "45 cm⁵/(daN·s)": {LEAKAGE: LEAKY, **off},
        "45 cm⁵/(daN·s), PD2": {LEAKAGE: LEAKY, **choose(client)},
    }
    variants = list(cases.values())
    steps = client.simulate(
        DRIVE,
        input=STEP,
        duration=0.15,
        metrics=["overshoot", "rise_time", "response_time", "control_effort"],
        variants=variants,
    )
    paths = client.frequency_response(DRIVE, from_="reference", to="velocity", variants=variants)
    rows = []
    for name, step, path in zip(cases, steps["variants"], paths["variants"], strict=True):
        velocity, flow = step["metrics"]["velocity"], step["metrics"]["flow"]
        rows.append((
            name,
            show(velocity["overshoot"], 100, "%"),
            show(velocity["rise_time"], 1e3, "ms"),
            show(velocity["response_time"], 1e3, "ms"),
            show(path["metrics"]["bandwidth"], 1, "rad/s"),
            show(flow["control_effort"], 1e3, "l/s"),
        ))  # fmt: skip
    table(("leakage", "overshoot", "rise time", "response time", "bandwidth", "largest flow"), rows)
    return draw(list(cases), steps, paths)


def choose(client: servotune.Client) -> Mapping[str, float]:
    """Let the service find the gains that make the leaky motor fastest."""
    job = client.optimize(
        DRIVE,
        variables=[{"parameter": name, "lower": 0, "upper": upper} for name, upper in GAINS],
        experiments=[{"name": "step", "input": STEP}],
        goals=[
            {"metric": "response_time", "experiment": "step", "output": "velocity", "sense": "minimize"},
            {"metric": "overshoot", "experiment": "step", "output": "velocity", "upper": 0.02},
            {"metric": "control_effort", "experiment": "step", "output": "flow", "upper": LARGEST_FLOW},
            {"metric": "sensitivity_peak", "open_at": "law", "upper": 1.6},
        ],
        scenarios=[{LEAKAGE: LEAKY}],
        method={"kind": "gradient", "starts": 1, "max_evaluations": 40},
    )
    result = job.wait(progress=False)
    best = {name: result["best"][name] for name, _ in GAINS}
    found = ", ".join(f"{name} {value:.3g}" for name, value in best.items())
    valid = "valid" if result["certificate"]["valid"] else "not valid"
    print(f"The law found: {found}; {result['status']}, certificate {valid}\n")
    return best


def draw(names: Sequence[str], steps: Simulation, paths: FrequencyResponse) -> Figure:
    """Return the velocities and the flows over time, and the frequency responses."""
    figure, (velocity, flow, magnitude) = panels(1, 3, size=(12, 4))
    for name, step, path in zip(names, steps["variants"], paths["variants"], strict=True):
        time = scaled(step["time"], 1e3)
        velocity.plot(time, step["outputs"]["velocity"], label=name)
        flow.plot(time, scaled(step["outputs"]["flow"], 1e3), label=name)
        magnitude.loglog(path["frequency"], path["magnitude"], label=name)
    label(velocity, title="Velocity", x="time, ms", y="velocity, m/s", xlim=(0, 120), ylim=(0, 0.16))
    label(flow, title="Flow of the valve", x="time, ms", y="flow, l/s", xlim=(0, 120), legend=False)
    label(
        magnitude,
        title="Velocity per reference",
        x="frequency, rad/s",
        y="magnitude",
        legend=False,
        xlim=(3, 3e3),
        ylim=(1e-2, 3),
    )
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the script and return its exit code."""
    return run(study, arguments)


if __name__ == "__main__":
    sys.exit(main())
