"""A mechanical correction: a mass on springs and dampers between a drive and its load, with and without it, and its values chosen.

The drive's motion x1 moves the load m2 through a spring and a damper, either directly or by way of a mass m3:
(h1, k1) from x1 to m3, k2 from m3 to the ground, (h2, k3) from m3 to m2, k4 from m2 to the ground. First by hand, then
by an optimisation. The service follows the force balances; eq. (5) of the paper is printed with h2 k3 in place of h2 k2 in a1 and
k3² in place of k2 k3 in a0, and the last curve shows what that would claim. Start a service with `make serve`, then

    .venv/bin/python examples/mechanical_correction.py --key KEY

where KEY is the key that the service printed when it started for the first time. The figure is written to mechanical-correction.png.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import servotune
from examples.presentation import label, panels, run, scaled, show, table
from servotune.replies import FrequencyResponse, Simulation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VALUES = {"m2": 50, "m3": 10, "h1": 300, "h2": 300, "k1": 6e4, "k2": 1e4, "k3": 6e4, "k4": 5e3}
"""kg, N·s/m and N/m; the direct connection has h1 and k1, too."""

A2 = "=h1*h2 + m2*(k1 + k2 + k3) + m3*(k3 + k4)"
STRUCTURE = {
    "name": "Mechanical correction",
    "parameters": {name: {"value": value} for name, value in VALUES.items()},
    "blocks": {
        "drive": {"kind": "input"},
        "direct": {"kind": "transfer_function", "numerator": ["=h1", "=k1"], "denominator": ["=m2", "=h1", "=k1 + k4"]},
        "corrected": {"kind": "two_mass_correction", **{name: f"={name}" for name in VALUES}},
        "printed": {
            "kind": "transfer_function",
            "numerator": ["=h1*h2", "=h1*k3 + h2*k1", "=k1*k3"],
            "denominator": [
                "=m2*m3",
                "=m3*h2 + m2*h1 + m2*h2",
                A2,
                "=h1*(k3 + k4) + h2*(k1 + k3 + k4)",
                "=k1*k3 + k1*k4 + k3*k3 + k2*k4 + k3*k4",
            ],
        },
    },
    "connections": [{"from": "drive", "to": name} for name in ("direct", "corrected", "printed")],
    "outputs": {name: name for name in ("direct", "corrected", "printed")},
}
STEP = {"port": "drive", "signal": {"kind": "step", "amplitude": {"value": 10, "unit": "mm"}}}
CHOSEN = {"m3": (2, 30), "h1": (100, 1e4), "h2": (100, 1e4), "k1": (2e4, 2e5), "k3": (2e4, 2e5)}
"""What the optimisation may change, and between which bounds."""


def study(client: servotune.Client) -> Figure:
    """Compare the load's motion without correction, with it, and with its values chosen."""
    best = choose(client)
    metrics = ["overshoot", "response_time", "peak", "steady_state_error"]
    steps = client.simulate(STRUCTURE, input=STEP, duration=1.0, metrics=metrics, variants=[{}, best])
    frequencies = [10 ** (place / 200) for place in range(601)]
    paths = {
        name: client.frequency_response(
            STRUCTURE, from_="drive", to=output, frequencies=frequencies, variants=[parameters]
        )
        for name, (output, parameters) in curves(best).items()
    }
    rows = []
    for name, (output, parameters) in curves(best).items():
        found = steps["variants"][int(parameters is best)]["metrics"][output]
        rows.append((
            name,
            show(found["overshoot"], 100, "%"),
            show(found["response_time"], 1, "s"),
            show(found["peak"], 1e3, "mm"),
            show(found["steady_state_error"], 1e3, "mm"),
            f"{max(paths[name]['variants'][0]['magnitude']):.2f}",
        ))  # fmt: skip
    table(("step of 10 mm", "overshoot", "response time", "peak", "remaining error", "largest magnitude"), rows)
    return draw(best, steps, paths)


def curves(best: Mapping[str, float]) -> dict[str, tuple[str, Mapping[str, float]]]:
    """Return what is compared: an output, and the values of the parameters where they differ from the document's."""
    return {
        "without correction": ("direct", {}),
        "with correction": ("corrected", {}),
        "with correction, chosen": ("corrected", best),
        "eq. (5) as printed": ("printed", {}),
    }


def choose(client: servotune.Client) -> Mapping[str, float]:
    """Let the service choose the values of the correction: the fastest load that overshoots by 20 % at most."""
    job = client.optimize(
        STRUCTURE,
        variables=[
            {"parameter": name, "lower": lower, "upper": upper, "scale": "log"}
            for name, (lower, upper) in CHOSEN.items()
        ],
        experiments=[{"name": "step", "input": STEP}],
        goals=[
            {"metric": "response_time", "experiment": "step", "output": "corrected", "sense": "minimize"},
            {"metric": "overshoot", "experiment": "step", "output": "corrected", "upper": 0.2},
            {"metric": "steady_state_error", "experiment": "step", "output": "corrected", "upper": 2e-3},
        ],
        method={"kind": "gradient", "starts": 1, "max_evaluations": 50},
    )
    result = job.wait(progress=False)
    best = {name: result["best"][name] for name in CHOSEN}
    print(f"Chosen: {', '.join(f'{name} {value:.3g}' for name, value in best.items())}; {result['status']}\n")
    return best


def draw(best: Mapping[str, float], steps: Simulation, paths: Mapping[str, FrequencyResponse]) -> Figure:
    """Return the load's motion after a step, and per motion of the drive over frequency."""
    figure, (motion, magnitude) = panels(1, 2, size=(11, 4.5))
    for name, (output, parameters) in curves(best).items():
        step, path = steps["variants"][int(parameters is best)], paths[name]["variants"][0]
        motion.plot(step["time"], scaled(step["outputs"][output], 1e3), label=name)
        magnitude.loglog(path["frequency"], path["magnitude"], label=name)
    label(motion, title="Load after a step of 10 mm", x="time, s", y="x₂, mm", xlim=(0, 1))
    label(magnitude, title="Load per drive", x="frequency, rad/s", y="|x₂/x₁|", xlim=(1, 1e3), legend=False)
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the script and return its exit code."""
    return run(study, arguments)


if __name__ == "__main__":
    sys.exit(main())
