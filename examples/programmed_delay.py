"""A delay programmed into the command of a flexible arm: the spectrum of its movement over the delay, and the best delay.

The arm is moved in two halves, the second one later. Which delay leaves the arm at rest is read from the spectrum of its
velocity and acceleration, then found by an optimisation of delay and share, and compared with shaped commands.
Start a service with `make serve`, then

    .venv/bin/python examples/programmed_delay.py --key KEY

where KEY is the key that the service printed when it started for the first time. The figure is written to programmed-delay.png.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import servotune
from examples.presentation import label, panels, run, scaled, show
from servotune.replies import Simulation, Spectrum

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ARM = {
    "name": "Flexible arm on a servo axis",
    "blocks": {
        "reference": {"kind": "input"},
        "error": {"kind": "sum", "signs": "+-"},
        "controller": {"kind": "pd", "kp": 72e3, "kd": 2400, "filter_frequency": 2000},
        "arm": {
            "kind": "compliant_arm",
            "frequencies": [0, 25, 80],
            "damping_ratios": [0, 0.01, 0.015],
            "base_shape": [0.22, 0.10, 0.12],
            "end_effector_shape": [0.22, -0.35, 0.18],
        },
    },
    "connections": [
        {"from": "reference", "to": "error.in1"},
        {"from": "arm.base_position", "to": "error.in2"},
        {"from": "error", "to": "controller"},
        {"from": "controller", "to": "arm.base_force"},
    ],
    "outputs": {
        "position": "arm.end_effector_position",
        "velocity": "arm.end_effector_velocity",
        "acceleration": "arm.end_effector_acceleration",
    },
}
MOVE = {"kind": "trapezoid", "distance": 0.1, "max_velocity": 0.5, "max_acceleration": 10}
DELAYED = {"port": "reference", "signal": {"kind": "programmed_delay", "delay": 0, "command": MOVE}}
DELAY, SHARE = "delay", "share"
MOVEMENTS = ("velocity", "acceleration")

DELAYS = 41
"""Rows of the waterfall."""


def study(client: servotune.Client) -> Figure:
    """Look at the spectrum over the delay, find the best delay, compare commands; return the figure."""
    frequency, damping_ratio = resonance(client)
    period = 2 * math.pi / (frequency * math.sqrt(1 - damping_ratio**2))
    delays = [1.5 * period * row / (DELAYS - 1) for row in range(DELAYS)]
    falls = {name: waterfall(client, name, delays, frequency) for name in MOVEMENTS}
    best = choose(client, period)
    replies = compare(client, candidates(best, frequency, damping_ratio))
    return draw(falls, delays, best[DELAY], replies)


def resonance(client: servotune.Client) -> tuple[float, float]:
    """Return undamped frequency (rad/s) and damping ratio of the arm's least damped mode under control."""
    reply = client.frequency_response(ARM, from_="reference", to="position")
    poles = [complex(pole["real"], pole["imag"]) for pole in reply["variants"][0]["poles"]]
    weakest = min((pole for pole in poles if pole.imag > 0), key=lambda pole: -pole.real / abs(pole))
    frequency, damping_ratio = abs(weakest), -weakest.real / abs(weakest)
    print(f"The arm resonates at {frequency:.2f} rad/s with a damping ratio of {damping_ratio:.4f}")
    return frequency, damping_ratio


def waterfall(client: servotune.Client, output: str, delays: Sequence[float], frequency: float) -> Spectrum:
    """Return the exact spectrum of a movement for every delay, and print where the resonance holds the least energy."""
    band = (0.9 * frequency, 1.1 * frequency)
    reply = client.spectrum(
        ARM,
        input=DELAYED,
        output=output,
        quantity="transform",
        frequencies=[frequency * (0.05 + 0.02 * line) for line in range(125)],
        band=band,
        variants=[{f"signals.reference.{DELAY}": delay} for delay in delays],
    )
    energies = energy(reply)
    least = min(range(len(delays)), key=energies.__getitem__)
    print(
        f"{output:>12}: least energy within 10 % of the resonance at a delay of {1e3 * delays[least]:.1f} ms: "
        f"{100 * energies[least] / energies[0]:.2f} % of that without"
    )
    return reply


def energy(reply: Spectrum) -> list[float]:
    """Return the energy in the band, variant by variant."""
    bands = [variant.get("band") for variant in reply["variants"]]
    return [math.nan if band is None else band["value"] for band in bands]


def choose(client: servotune.Client, period: float) -> dict[str, float]:
    """Let the service find delay and share that leave the least residual vibration."""
    start = {"kind": "programmed_delay", "delay": 0.4 * period, "command": MOVE}
    path = "signals.move.reference"
    job = client.optimize(
        ARM,
        variables=[
            {"parameter": f"{path}.{DELAY}", "lower": 0.3 * period, "upper": 0.7 * period},
            {"parameter": f"{path}.{SHARE}", "lower": 0.3, "upper": 0.7},
        ],
        experiments=[{"name": "move", "input": {"port": "reference", "signal": start}}],
        goals=[{"metric": "residual_vibration", "experiment": "move", "output": "position", "sense": "minimize"}],
        method={"kind": "gradient", "starts": 1, "max_evaluations": 20},
    )
    result = job.wait(progress=False)
    best = {name: result["best"][f"{path}.{name}"] for name in (DELAY, SHARE)}
    print(
        f"Best delay {1e3 * best[DELAY]:.2f} ms (half a damped period is {500 * period:.2f} ms), "
        f"share of the second movement {best[SHARE]:.4f}; {result['status']}, certificate {result['certificate']['valid']}"
    )
    return best


def candidates(best: Mapping[str, float], frequency: float, damping_ratio: float) -> dict[str, dict[str, Any]]:
    """Return the commands to compare."""
    mode = {"kind": "shaped", "frequency": frequency, "damping_ratio": damping_ratio, "command": MOVE}
    return {
        "trapezoid": MOVE,
        "programmed delay": {"kind": "programmed_delay", **best, "command": MOVE},
        **{f"shaped, {shaper.upper()}": {**mode, "shaper": shaper} for shaper in ("zv", "zvd", "ei")},
    }


def compare(client: servotune.Client, commands: Mapping[str, Mapping[str, Any]]) -> dict[str, Simulation]:
    """Simulate the arm under every command and print what is left when it has ended."""
    print(f"\n{'command':<18}{'residual vibration':>20}{'settling time':>16}{'largest acceleration':>23}")
    replies = {}
    for name, signal in commands.items():
        metrics = ["residual_vibration", "settling_time", "max_acceleration"]
        reply = client.simulate(
            ARM, input={"port": "reference", "signal": signal}, duration=2.0, samples=1500, metrics=metrics
        )
        found = reply["variants"][0]["metrics"]
        vibration, settling = found["position"]["residual_vibration"], found["position"]["settling_time"]
        largest = found["acceleration"]["max_acceleration"]
        print(f"{name:<18}{show(vibration, 1e3, 'mm'):>20}{show(settling, 1, 's'):>16}{show(largest, 1, 'm/s²'):>23}")
        replies[name] = reply
    return replies


def draw(
    falls: Mapping[str, Spectrum], delays: Sequence[float], best: float, replies: Mapping[str, Simulation]
) -> Figure:
    """Return the figure: both waterfalls, the energy at the resonance over the delay, and the movements."""
    figure, (first, second, below, last) = panels(2, 2, size=(11, 7.5))
    for panel, (name, reply) in zip((first, second), falls.items(), strict=True):
        rows = [variant["value"] for variant in reply["variants"]]
        top = max(map(max, rows))
        decibels = [[20 * math.log10(max(value / top, 1e-4)) for value in row] for row in rows]
        mesh = panel.pcolormesh(reply["variants"][0]["frequency"], delays, decibels, vmin=-60, shading="nearest")
        panel.axhline(best, color="white", linewidth=0.8, linestyle="--")
        panel.set(title=f"Spectrum of the {name}, dB", xlabel="frequency, rad/s", ylabel="programmed delay, s")
        figure.colorbar(mesh, ax=panel)
    for name, reply in falls.items():
        energies = energy(reply)
        below.semilogy(delays, [value / energies[0] for value in energies], label=name)
    below.axvline(best, color="0.5", linewidth=0.8, linestyle="--")
    label(below, title="Energy at the resonance", x="programmed delay, s", y="part of that without delay")
    for name in ("trapezoid", "programmed delay"):
        variant = replies[name]["variants"][0]
        last.plot(variant["time"], scaled(variant["outputs"]["position"], 1e3), label=name)
    label(last, title="End-effector", x="time, s", y="position, mm")
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the script and return its exit code."""
    return run(study, arguments)


if __name__ == "__main__":
    sys.exit(main())
