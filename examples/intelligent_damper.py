"""An intelligent damper between base and end-effector of a robot: four laws compared, then law and controller chosen together.

The chain is sensors, conditioning, law, current amplifier, coil; the document is systems/intelligent_damper.json, its damper the one of
mr_damper.py. A servo axis moves the base; what the end-effector does is shown over time, as a spectrum, and as dynamic
compliance while an exciter shakes the base. Start a service with `make serve`, then

    .venv/bin/python examples/intelligent_damper.py --key KEY

where KEY is the key that the service printed when it started for the first time. The figure is written to intelligent-damper.png.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import servotune
from examples.presentation import label, panels, run, scaled, show, table
from servotune.replies import Optimization, Simulation, Spectrum, SpectrumVariant

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROBOT = json.loads((Path(__file__).parent / "systems" / "intelligent_damper.json").read_text(encoding="utf-8"))
SENSED = ("velocity", "relative_velocity", "force")
"""What conditioning gives to every law: of the end-effector, of the stroke, of the damper."""


def law(kind: str, *heard: str, **values: float) -> dict[str, Any]:
    """Return a law as it stands in the robot's document, which hears some of what is sensed."""
    return {
        "kind": "subsystem",
        "system": {
            "name": kind,
            "blocks": {**{name: {"kind": "input"} for name in SENSED}, "switch": {"kind": kind, **values}},
            "connections": [{"from": name, "to": f"switch.{name}"} for name in heard],
            "outputs": {"current": "switch"},
        },
    }


LAWS = {
    "passive off": law("passive_off", current=0),
    "passive on": law("passive_on", current=1),
    "skyhook": law("skyhook", "velocity", "relative_velocity", off=0, on=1),
    "clipped optimal": ROBOT["blocks"]["law"],
}

DISTANCE = 0.1
MOVE = {
    "port": "reference",
    "signal": {"kind": "trapezoid", "distance": DISTANCE, "max_velocity": 0.3, "max_acceleration": 4},
}
MOVING, SAMPLES = 2.0, 2000
NEAR = 0.5e-3
"""The end-effector has arrived when it stays this near to where it is to be, m."""

LINE, FORCE = 2.5, 1200
"""Distance of the exciter's lines, rad/s, and the force of each, N."""
LINES = range(2, 37)
PERIOD = 2 * math.pi / LINE

LIMIT = 5.3
"""Largest acceleration that the end-effector may have, m/s²."""
VARIABLES = (
    ("controller.kp", 2e6, 2e7),
    ("controller.kd", 5e4, 1e6),
    ("law.wanted.gain", 1e3, 1e5),
    ("law.switch.on", 0.1, 1),
)
EVALUATIONS = 16


def study(client: servotune.Client) -> Figure:
    """Compare the laws, let the service choose the last one's numbers, and return the figure."""
    moves, shaken, spectra = {}, {}, {}
    for name, chosen in LAWS.items():
        robot = ROBOT | {"blocks": ROBOT["blocks"] | {"law": chosen}}
        moves[name] = client.simulate(
            robot, input=MOVE, duration=MOVING, samples=SAMPLES + 1, metrics=["itae", "max_acceleration"]
        )
        spectra[name] = spectrum(client, robot)
        shaken[name] = compliance(client, robot)
    report(moves, shaken)
    return draw(moves, spectra, shaken, choose(client))


def spectrum(client: servotune.Client, robot: Mapping[str, Any]) -> Spectrum:
    """Return the Fourier spectrum of the end-effector's acceleration while it moves."""
    return client.spectrum(robot, input=MOVE, output="acceleration", window="none", duration=MOVING, samples=SAMPLES)


def compliance(client: servotune.Client, robot: Mapping[str, Any]) -> dict[float, float]:
    """Return displacement of the end-effector per force on the base (m/N) on every line (rad/s) of the exciter.

    All lines are excited at once, for the damper is not linear; the period after the first half of one is looked at.
    """
    signal = {"kind": "multisine", "amplitude": FORCE, "fundamental": LINE, "harmonics": list(LINES)}
    reply = client.spectrum(
        robot,
        input={"port": "exciter", "signal": signal},
        output="position",
        window="none",
        duration=1.5 * PERIOD,
        samples=1536,
        part=(0.5 * PERIOD, 1.5 * PERIOD),
    )
    amplitude = scaled(whole(reply)["value"], 1 / FORCE)
    return {line * LINE: amplitude[line] for line in LINES}


def whole(reply: Spectrum) -> SpectrumVariant:
    """Return the spectrum, if the service had the time to follow the response to its end."""
    variant = reply["variants"][0]
    if variant["verdict"] != "ok":
        raise servotune.ServotuneError(f"There is no spectrum, {variant['verdict']}: {variant.get('advice')}")
    return variant


def arrival(reply: Simulation) -> float:
    """Return when the end-effector has arrived, s."""
    variant = reply["variants"][0]
    curve = scaled(variant["outputs"]["position"], 1)
    away = [t for t, x in zip(variant["time"], curve, strict=True) if t is not None and abs(x - DISTANCE) > NEAR]
    return away[-1]


def report(moves: Mapping[str, Simulation], shaken: Mapping[str, Mapping[float, float]]) -> None:
    """Print what every law makes of the movement and of the exciter."""
    rows = []
    for name, reply in moves.items():
        variant = reply["variants"][0]
        current = scaled(variant["outputs"]["current"], 1)
        rows.append((
            name,
            f"{1e3 * arrival(reply):.0f} ms",
            show(variant["metrics"]["position"]["itae"], 1e6, "mm·s·ms"),
            show(variant["metrics"]["acceleration"]["max_acceleration"], 1, "m/s²"),
            f"{1e6 * max(shaken[name].values()):.3f} µm/N",
            f"{1e6 * math.sqrt(sum(x * x for x in shaken[name].values()) / len(LINES)):.3f} µm/N",
            f"{sum(current) / len(current):.2f} A",
        ))  # fmt: skip
    head = ("law", "arrival", "∫t|e|dt", "largest acceleration", "largest compliance", "rms", "mean current")
    table(head, rows)


def choose(client: servotune.Client) -> Optimization:
    """Let the service choose the clipped-optimal law and the axis controller together, under a limit of acceleration."""
    job = client.optimize(
        ROBOT,
        variables=[{"parameter": name, "lower": low, "upper": high, "scale": "log"} for name, low, high in VARIABLES],
        experiments=[{"name": "move", "input": MOVE, "duration": 1.0}],
        goals=[
            {"metric": "itae", "experiment": "move", "output": "position", "sense": "minimize"},
            {"metric": "max_acceleration", "experiment": "move", "output": "acceleration", "upper": LIMIT},
        ],
        method={"kind": "gradient", "starts": 1, "max_evaluations": EVALUATIONS},
    )
    result = job.wait(progress=False)
    found = ", ".join(f"{name} {result['best'][name]:.3g}" for name, *_ in VARIABLES)
    certificate = result["certificate"]
    print(f"\nChosen: {found}; {result['status']}, certificate {'valid' if certificate['valid'] else 'not valid'}")
    (error, acceleration) = result["goals"]
    rows = [
        ("before", show(error["before"], 1e6, "mm·s·ms"), show(acceleration["before"], 1, "m/s²")),
        ("after", show(error["after"], 1e6, "mm·s·ms"), show(acceleration["after"], 1, "m/s²")),
    ]
    table(("law and controller", "∫t|e|dt", f"largest acceleration (at most {LIMIT} m/s²)"), rows)
    return result


def draw(
    moves: Mapping[str, Simulation],
    spectra: Mapping[str, Spectrum],
    shaken: Mapping[str, Mapping[float, float]],
    result: Optimization,
) -> Figure:
    """Return movement, spectrum and compliance of all laws, and what the choice has changed."""
    figure, (movement, lines, compliant, position, acceleration, current) = panels(2, 3, size=(14, 7.5))
    for name, reply in moves.items():
        variant = reply["variants"][0]
        movement.plot(variant["time"], scaled(variant["outputs"]["position"], 1e3), label=name)
        found = whole(spectra[name])
        lines.plot(found["frequency"], found["value"], label=name)
        compliant.plot(list(shaken[name]), scaled(list(shaken[name].values()), 1e6), label=name)
    for name, curves in result["curves"].items():
        shown = curves["move"]
        position.plot(shown["time"], scaled(shown["outputs"]["position"], 1e3), label=name)
        acceleration.plot(shown["time"], shown["outputs"]["acceleration"], label=name)
        current.plot(shown["time"], shown["outputs"]["current"], label=name)
    for sign in (-1, 1):
        acceleration.axhline(sign * LIMIT, color="0.5", linewidth=0.8, linestyle="-")
    label(movement, title="End-effector", x="time, s", y="position, mm", xlim=(0.3, 1.3), ylim=(85, 112))
    label(
        lines,
        title="Spectrum of its acceleration",
        x="frequency, rad/s",
        y="amplitude, m/s²",
        legend=False,
        xlim=(0, 60),
        ylim=(0, 1.6),
    )
    label(
        compliant,
        title="Compliance, force on the base",
        x="frequency, rad/s",
        y="displacement per force, µm/N",
        legend=False,
        xlim=(0, 90),
        ylim=(0, 0.26),
    )
    label(
        position,
        title="Clipped optimal, before and after",
        x="time, s",
        y="position, mm",
        xlim=(0.3, 1),
        ylim=(85, 112),
    )
    label(
        acceleration,
        title=f"Its acceleration, limited to {LIMIT} m/s²",
        x="time, s",
        y="acceleration, m/s²",
        legend=False,
        xlim=(0, 1),
    )
    label(current, title="Current of the damper", x="time, s", y="current, A", legend=False, xlim=(0, 1))
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the script and return its exit code."""
    return run(study, arguments)


if __name__ == "__main__":
    sys.exit(main())
