"""A servo-hydraulic axis with six loops inside each other: how much each loop tolerates, and what each correction does.

Position over velocity over acceleration over pressure over spool over current; the document is systems/many_loops.json.
Start a service with `make serve`, then

    .venv/bin/python examples/many_loops.py --key KEY

where KEY is the key that the service printed when it started for the first time. The figure is written to many-loops.png.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import servotune
from examples.presentation import label, panels, run, scaled, show
from servotune.replies import FrequencyResponse, FrequencyVariant, Simulation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AXIS = json.loads((Path(__file__).parent / "systems" / "many_loops.json").read_text(encoding="utf-8"))

ACCELERATION = "velocity_loop.acceleration_loop"
PRESSURE = f"{ACCELERATION}.pressure_loop"
LOOPS = {
    "position": "error",
    "velocity": "velocity_loop.error",
    "acceleration": f"{ACCELERATION}.error",
    "pressure": f"{PRESSURE}.error",
    "spool": f"{PRESSURE}.spool_loop.error",
    "current": f"{PRESSURE}.spool_loop.current_loop.error",
}
"""Where each loop is opened to look at it; all others stay closed."""

CORRECTIONS = (
    ("notch", "acceleration", f"{ACCELERATION}.notch.depth", 1.0),
    ("piston flow fed forward", "acceleration", f"{PRESSURE}.compensation_share", 0.0),
    ("lead", "velocity", "velocity_loop.lead.pole_frequency", 120.0),
    ("RC network", "pressure", f"{PRESSURE}.network.c1", 1e-12),
)
"""Each correction, the loop that it serves, and the parameter value that takes it out."""

FEED_FORWARD: Sequence[Mapping[str, float]] = (
    {"velocity_feed_forward": 0, "acceleration_feed_forward": 0},
    {"velocity_feed_forward": 1, "acceleration_feed_forward": 0},
    {},
)
"""None, velocity alone, and both as the document has them."""

STEP = {"port": "reference", "signal": {"kind": "step", "amplitude": {"value": 10, "unit": "mm"}}}
RAMP = {"port": "reference", "signal": {"kind": "ramp", "slope": {"value": 0.1, "unit": "m/s"}}}
PUSH = {"port": "load", "signal": {"kind": "step", "amplitude": {"value": 1, "unit": "kN"}}}


def study(client: servotune.Client) -> Figure:
    """Look at every loop and correction, then at movements and a push; return the figure."""
    loops = look_at_loops(client)
    corrections = compare_corrections(client)
    moves, errors = move(client)
    push(client)
    return draw(loops, corrections["notch"], moves, errors)


def look_at_loops(client: servotune.Client) -> dict[str, FrequencyVariant]:
    """Open one loop after the other and print what it tolerates."""
    print("loop           crossover  phase margin  gain margin  sensitivity peak")
    seen = {}
    for name, endpoint in LOOPS.items():
        seen[name] = client.frequency_response(AXIS, open_at=endpoint)["variants"][0]
        print(f"{name:<13} {tolerance(seen[name])}")
    return seen


def compare_corrections(client: servotune.Client) -> dict[str, FrequencyResponse]:
    """Ask for each loop with and without its correction in one request, and print both."""
    print("\ncorrection")
    replies = {}
    for name, loop, parameter, out in CORRECTIONS:
        replies[name] = client.frequency_response(AXIS, open_at=LOOPS[loop], variants=[{}, {parameter: out}])
        for word, variant in zip(("with", "without"), replies[name]["variants"], strict=True):
            print(f"{word:>7} {name:<24} in the {loop:<13} {tolerance(variant)}")
    return replies


def move(client: servotune.Client) -> tuple[Simulation, Simulation]:
    """Print how a step and a movement at constant velocity are followed with more and more fed forward."""
    moves = client.simulate(AXIS, input=STEP, outputs=["position"], duration=0.5, variants=FEED_FORWARD)
    errors = client.simulate(
        AXIS, input=RAMP, outputs=["following_error"], duration=2.0, metrics=["peak"], variants=FEED_FORWARD
    )
    print("\nfed forward                 rise time  overshoot  error at 0.1 m/s: largest, after 2 s")
    names = ("nothing", "velocity", "velocity and acceleration")
    for name, step, ramp in zip(names, moves["variants"], errors["variants"], strict=True):
        position, error = step["metrics"]["position"], ramp["outputs"]["following_error"][-1]
        rise, overshoot = show(position["rise_time"], 1e3, "ms"), show(position["overshoot"], 100, "%")
        largest = show(ramp["metrics"]["following_error"]["peak"], 1e3, "mm")
        last = "none" if error is None else f"{1e3 * error:.3f} mm"
        print(f"{name:<26} {rise:>10} {overshoot:>10}  {largest:>24}, {last}")
    return moves, errors


def push(client: servotune.Client) -> None:
    """Print how far a force moves the axis."""
    reply = client.simulate(AXIS, input=PUSH, outputs=["position"], metrics=["peak", "steady_state_error"])
    position = reply["variants"][0]["metrics"]["position"]
    peak, rest = (show(position[name], 1e3, "mm") for name in ("peak", "steady_state_error"))
    print(f"\nA force of 1 kN moves the axis by {peak}; {rest} of it stays.")


def tolerance(variant: FrequencyVariant) -> str:
    """Return the margins of an opened loop as a row, or the verdict where the closed loop is not stable."""
    metrics, margins = variant["metrics"], variant.get("margins")
    if variant["verdict"] != "ok" or not margins:
        return variant["verdict"]
    crossover = max(crossing["frequency"] for crossing in margins["phase"])
    phase = show(metrics["phase_margin"], 180 / math.pi, "°")
    gain, peak = show(metrics["gain_margin"], 1, ""), show(metrics["sensitivity_peak"], 1, "")
    return f"{crossover:>5.0f} rad/s {phase:>13} {gain:>12} {peak:>17}"


def draw(loops: dict[str, FrequencyVariant], notch: FrequencyResponse, moves: Simulation, errors: Simulation) -> Figure:
    """Return the figure: all loops, the notch, and what feeding forward does."""
    figure, (top, beside, below, last) = panels(2, 2, size=(11, 7.5))
    for name, variant in loops.items():
        top.loglog(variant["frequency"], variant["magnitude"], label=name)
    for name, variant in zip(("with notch", "without: unstable"), notch["variants"], strict=True):
        beside.loglog(variant["frequency"], variant["magnitude"], label=name)
    for panel, title, span in (
        (top, "Six loops, each opened alone", (1, 3e4)),
        (beside, "Acceleration loop", (10, 3e3)),
    ):
        panel.axhline(1.0, color="0.5", linewidth=0.8)
        label(panel, title=title, x="frequency, rad/s", y="loop gain", xlim=span, ylim=(1e-2, 1e3))
    for name, step, ramp in zip(
        ("nothing", "velocity", "velocity and acceleration"), moves["variants"], errors["variants"], strict=True
    ):
        below.plot(step["time"], scaled(step["outputs"]["position"], 1e3), label=name)
        last.plot(ramp["time"], scaled(ramp["outputs"]["following_error"], 1e3), label=name)
    label(below, title="Step of 10 mm, fed forward", x="time, s", y="position, mm")
    label(last, title="Following error at 0.1 m/s", x="time, s", y="error, mm", xlim=(0, 0.5))
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the script and return its exit code."""
    return run(study, arguments)


if __name__ == "__main__":
    sys.exit(main())
