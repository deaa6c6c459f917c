"""A magneto-rheological damper at several currents: its loops of force, and how well its model follows what was measured.

The model is the modified Bouc-Wen one with the twelve parameters that were published with the recordings of
data/mr_damper. Start a service with `make serve`, then

    .venv/bin/python examples/mr_damper.py --key KEY

where KEY is the key that the service printed when it started for the first time. The figure is written to mr-damper.png.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import servotune
from examples.presentation import label, panels, run, scaled, table
from servotune.replies import Simulation, Validation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DATA = Path(__file__).parent / "data" / "mr_damper"
RECORDINGS = {0.0: "25mm0x5Hz0A.txt", 0.5: "25mm0x5Hz0x5A.txt", 1.0: "25mm0x5Hz1A.txt"}
"""By the current in the coil, A."""

CURRENTS = (0.0, 0.25, 0.5, 0.75, 1.0)
AMPLITUDE, FREQUENCY = 0.025, math.pi
"""The damper's motion: 25 mm at 0.5 Hz, as it was recorded."""

PERIOD = 2 * math.pi / FREQUENCY
SAMPLES = 800
"""Of one period; two are simulated, the second one is shown."""

RATE = 200
"""Samples per second of the recordings."""

COMPARED = 10.0
"""So much of them is compared, s."""
SHOWN = 6 * RATE
"""The cycle that begins after this sample is shown."""

MEASURED: Mapping[str, Any] = {"color": "0.45", "linestyle": "", "marker": "o", "markersize": 2.5, "zorder": 3}

DAMPER = {
    "name": "Magneto-rheological damper",
    "blocks": {
        "displacement": {"kind": "input"},
        "velocity": {"kind": "input"},
        "current": {"kind": "passive_on", "current": 0},
        "damper": {
            "kind": "mr_damper_spencer",
            "alpha": [15221.0961, 41508.4056, -38152.0043],
            "c0": [924.911328, 7625.96402],
            "c1": [9867.12839, 78336.6934],
            "k0": [0.150133],
            "k1": 1238.7977,
            "x0": {"value": 2.30914e-3, "unit": "mm"},
            "gamma": 1894075.53,
            "gamma_rate": -3.65610854,
            "A": 300,
            "n": 2,
        },
    },
    "connections": [
        {"from": "displacement", "to": "damper.displacement"},
        {"from": "velocity", "to": "damper.velocity"},
        {"from": "current", "to": "damper.current"},
    ],
    "outputs": {"force": "damper"},
}
MOTION = [
    {"port": "displacement", "signal": {"kind": "sine", "amplitude": AMPLITUDE, "frequency": FREQUENCY}},
    {
        "port": "velocity",
        "signal": {
            "kind": "sine", "amplitude": AMPLITUDE * FREQUENCY, "frequency": FREQUENCY, "phase": math.pi / 2,
        },
    },
]  # fmt: skip


def study(client: servotune.Client) -> Figure:
    """Draw the loops at every current, and compare three of them with what was measured."""
    loops = client.simulate(
        DAMPER,
        input=MOTION,
        duration=2 * PERIOD,
        samples=2 * SAMPLES + 1,
        metrics=["peak"],
        variants=[{"current.current": current} for current in CURRENTS],
    )
    measured = {current: validate(client, current, name) for current, name in RECORDINGS.items()}
    report(loops, measured)
    return draw(loops, measured)


def validate(client: servotune.Client, current: float, name: str) -> Validation:
    """Send a recording to the service and compare the model with it; its parameters are as published, so none is moved."""
    layout = json.loads((DATA / "import.json").read_text(encoding="utf-8"))
    dataset = client.datasets.upload({"name": name, "format": "txt", "import": layout}, DATA / name)
    return client.validate(
        DAMPER,
        dataset=dataset["id"],
        inputs={"displacement": "displacement", "velocity": "velocity"},
        outputs={"force": "force"},
        parameters={"current.current": current},
        window=(0, COMPARED),
        diagnose="never",
    )


def motion(time: Sequence[float | None]) -> tuple[list[float], list[float]]:
    """Return displacement (m) and velocity (m/s) at these times."""
    angles = [FREQUENCY * t for t in scaled(time, 1)]
    return [AMPLITUDE * math.sin(a) for a in angles], [AMPLITUDE * FREQUENCY * math.cos(a) for a in angles]


def absorbed(displacement: Sequence[float], force: Sequence[float]) -> float:
    """Return the energy of one loop in J: the area that it encloses."""
    return sum((b - a) * (f + g) / 2 for (a, b), (f, g) in zip(pairwise(displacement), pairwise(force), strict=True))


def report(loops: Simulation, measured: Mapping[float, Validation]) -> None:
    """Print largest force and energy at every current, and the fit where there is a recording."""
    rows = []
    for current, variant in zip(CURRENTS, loops["variants"], strict=True):
        displacement, _ = motion(variant["time"])
        force = scaled(variant["outputs"]["force"], 1)
        energy = absorbed(displacement[SAMPLES:], force[SAMPLES:])
        fit: Any = measured[current]["outputs"]["force"] if current in measured else None
        rows.append((
            f"{current:.2f} A",
            f"{max(force[SAMPLES:]):.4g} N",
            f"{energy:.3g} J",
            f"{fit['fit_percent']:.2f} %" if fit else "-",
            f"{fit['nrmse_percent']:.2f} %" if fit else "-",
        ))  # fmt: skip
    table(("current", "largest force", "energy per cycle", "FIT", "NRMSE"), rows)


def draw(loops: Simulation, measured: Mapping[float, Validation]) -> Figure:
    """Return force over displacement and over velocity, and measured against simulated force over time."""
    figure, (over_displacement, over_velocity, over_time) = panels(1, 3, size=(13, 4.4))
    for current, variant in zip(CURRENTS, loops["variants"], strict=True):
        displacement, velocity = motion(variant["time"])
        force = scaled(variant["outputs"]["force"], 1)[SAMPLES:]
        over_displacement.plot(scaled(displacement[SAMPLES:], 1e3), force, label=f"{current:g} A")
        over_velocity.plot(scaled(velocity[SAMPLES:], 1e3), force, label=f"{current:g} A")
    for current, reply in measured.items():
        curves = reply["outputs"]["force"]["curves"]
        simulated, recorded = scaled(curves["simulated"], 1), scaled(curves["measured"], 1)
        first = next(k for k in range(SHOWN, len(recorded)) if recorded[k - 1] < 0 <= recorded[k])
        cycle = slice(first, first + round(PERIOD * RATE))
        time = [k / RATE for k in range(cycle.stop - first)]
        over_time.plot(time, simulated[cycle], label=f"{current:g} A, simulated")
        over_time.plot(time[::5], recorded[cycle][::5], **MEASURED)
    over_time.plot([], [], **MEASURED, label="measured")
    label(over_displacement, title="Force over displacement", x="displacement, mm", y="force, N", legend=False)
    label(over_velocity, title="Force over velocity", x="velocity, mm/s", y="force, N")
    label(over_time, title="One cycle, measured and simulated", x="time, s", y="force, N")
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the script and return its exit code."""
    return run(study, arguments)


if __name__ == "__main__":
    sys.exit(main())
