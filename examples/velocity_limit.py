"""A limit of velocity as a design rule: how fast a flexible arm may be commanded before its resonance is excited.

A trapezoidal movement of length h with velocity v and acceleration a has |V(jω)| = h |sinc(ω h/(2 v)) sinc(ω v/(2 a))| as the
spectrum of its velocity, sinc x = sin x / x. At a resonance ω that is 2 v/ω at most, so a lower limit excites less; and it is
nothing where h/v is a whole number of periods. The limit is swept, then the best one near the rule's is found by an
optimisation. Start a service with `make serve`, then

    .venv/bin/python examples/velocity_limit.py --key KEY

where KEY is the key that the service printed when it started for the first time. The figure is written to velocity-limit.png.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import servotune
from examples.presentation import label, panels, run, scaled, show, table
from examples.programmed_delay import ARM, energy
from servotune.replies import Simulation, Spectrum

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DISTANCE = 0.1
MOVE = {"kind": "trapezoid", "distance": DISTANCE, "max_velocity": 1, "max_acceleration": 20}
INPUT = {"port": "reference", "signal": MOVE}
LIMIT = "signals.reference.max_velocity"
LIMITS = [0.1 * 1.04**place for place in range(60)]
"""Velocities that are compared, 0.1 to 1 m/s."""


def study(client: servotune.Client) -> Figure:
    """Sweep the limit, find the best one below that of the rule, and compare the movements."""
    frequency = resonance(client)
    rule = DISTANCE * frequency / (2 * math.pi)
    print(
        f"The arm resonates at {frequency:.2f} rad/s: h/v is one period at v = {rule:.3f} m/s, two at {rule / 2:.3f} m/s"
    )
    band = (0.9 * frequency, 1.1 * frequency)
    lines = [frequency * (0.05 + 0.01 * line) for line in range(200)]
    best = choose(client, rule, band)
    chosen = [1.0, best, best / 2]
    spectra = client.spectrum(
        ARM,
        input=INPUT,
        output="velocity",
        quantity="transform",
        frequencies=lines,
        band=band,
        variants=[{LIMIT: limit} for limit in (*LIMITS, *chosen)],
    )
    moves = client.simulate(
        ARM,
        input=INPUT,
        outputs=["position"],
        duration=1.5,
        metrics=["residual_vibration", "settling_time"],
        variants=[{LIMIT: limit} for limit in chosen],
    )
    energies = energy(spectra)
    rows = []
    for limit, left, move in zip(chosen, energies[len(LIMITS) :], moves["variants"], strict=True):
        position = move["metrics"]["position"]
        rows.append((
            f"{limit:.3f} m/s",
            f"{left:.3g} m²/s",
            show(position["residual_vibration"], 1e3, "mm"),
            show(position["settling_time"], 1, "s"),
        ))  # fmt: skip
    table(("limit", "energy at the resonance", "residual vibration", "settling time"), rows)
    return draw(rule, energies, spectra, moves)


def resonance(client: servotune.Client) -> float:
    """Return the damped frequency (rad/s) of the arm's least damped mode under control."""
    reply = client.frequency_response(ARM, from_="reference", to="position")
    poles = [pole for pole in reply["variants"][0]["poles"] if pole["imag"] > 0]
    return min(poles, key=lambda pole: -pole["real"] / abs(complex(pole["real"], pole["imag"])))["imag"]


def choose(client: servotune.Client, rule: float, band: tuple[float, float]) -> float:
    """Let the service find the limit, at most a fifth beside the rule's, that leaves the least energy at the resonance."""
    parameter = "signals.move.reference.max_velocity"
    goal = {"metric": "band_energy", "experiment": "move", "output": "velocity", "band": band, "sense": "minimize"}
    job = client.optimize(
        ARM,
        variables=[{"parameter": parameter, "lower": 0.8 * rule, "upper": 1.2 * rule}],
        experiments=[{"name": "move", "input": {"port": "reference", "signal": {**MOVE, "max_velocity": 0.9 * rule}}}],
        goals=[goal],
        method={"kind": "gradient", "starts": 1, "max_evaluations": 8},
    )
    result = job.wait(progress=False)
    best = result["best"][parameter]
    print(f"Best limit {best:.3f} m/s; {result['status']}, certificate {result['certificate']['valid']}\n")
    return best


def draw(rule: float, energies: Sequence[float], spectra: Spectrum, moves: Simulation) -> Figure:
    """Return the energy over the limit, the spectra and the movements."""
    figure, (over, lines, motion) = panels(1, 3, size=(12, 4))
    over.semilogy(LIMITS, energies[: len(LIMITS)], color="0.3")
    for periods in (1, 2, 3):
        note: Any = {"label": "h/v is 1, 2, 3 periods"} if periods == 1 else {}
        over.axvline(rule / periods, color="0.5", linewidth=0.8, linestyle="--", **note)
    for spectrum, move in zip(spectra["variants"][len(LIMITS) :], moves["variants"], strict=True):
        name = f"{move['parameters'][LIMIT]:.2f} m/s"
        lines.semilogy(spectrum["frequency"], spectrum["value"], label=name)
        motion.plot(move["time"], scaled(move["outputs"]["position"], 1e3), label=name)
    label(over, title="Energy at the resonance", x="velocity limit, m/s", y="energy of the velocity, m²/s")
    label(lines, title="Spectrum of the velocity", x="frequency, rad/s", y="|V|, m", legend=False)
    label(motion, title="End-effector", x="time, s", y="position, mm", xlim=(0, 1.5))
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the script and return its exit code."""
    return run(study, arguments)


if __name__ == "__main__":
    sys.exit(main())
