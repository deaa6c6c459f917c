"""The linear pneumatic motor in the middle and over the ranges of its parameters: responses, frequency response, influence.

A step of air flow moves the motor: movement, velocity and acceleration in time, flow to velocity as Bode and Nyquist diagrams, for
the middle of the printed ranges and for their fastest and slowest corners. Then: which parameter moves which property, and how much, by
coefficients of finite changes, C = ((y_i - y_f)/y_i) / ((p_i - p_f)/p_i), with the exact elasticities beside them.
Start a service with `make serve`, then

    .venv/bin/python examples/pneumatic_motor.py --key KEY

where KEY is the key that the service printed when it started for the first time. The figure is written to pneumatic-motor.png.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import servotune
from examples.presentation import label, panels, run, scaled, show, table
from servotune.replies import FrequencyResponse, Simulation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RANGES = {
    "area": (50, 80, "cm**2"),
    "volume": (500, 1000, "cm**3"),
    "pressure": (4, 6, "daN/cm**2"),
    "leakage": (0.2, 0.7, "cm**5/(daN*s)"),
    "mass": (0.1, 0.6, "daN*s**2/cm"),
    "viscous_friction": (0.8, 1.8, "daN*s/cm"),
}
"""As printed: lowest, highest, unit."""

MIDDLE = {"area": 65, "volume": 750, "pressure": 5, "leakage": 0.4, "mass": 0.3, "viscous_friction": 1.2}
CHANGES = {"area": 0.15, "volume": 0.40, "mass": 1.0}
"""Relative changes of the published table of influence coefficients."""

FLOW = {"kind": "step", "amplitude": {"value": 60, "unit": "cm**3/s"}}
INPUT = {"port": "flow", "signal": FLOW}
PROPERTIES = {
    "response_time": "velocity",
    "max_acceleration": "acceleration",
    "max_velocity": "velocity",
    "critical_frequency": "velocity",
}
"""Each property and the output that it is read from."""


def quantity(name: str, value: float) -> dict[str, Any]:
    """Return a value of a motor's parameter with its unit."""
    return {"value": value, "unit": RANGES[name][2]}


MOTOR = {
    "name": "Linear pneumatic motor",
    "blocks": {
        "flow": {"kind": "input"},
        "motor": {
            "kind": "linear_pneumatic_motor",
            "adiabatic_index": 1.4,
            **{name: quantity(name, value) for name, value in MIDDLE.items()},
        },
    },
    "connections": [{"from": "flow", "to": "motor.flow"}],
    "outputs": {name: f"motor.{name}" for name in ("position", "velocity", "acceleration")},
}
FAST = {"area": 80, "volume": 500, "pressure": 6, "mass": 0.1}
SLOW = {"area": 50, "volume": 1000, "pressure": 4, "mass": 0.6}
CASES = {
    name: {f"motor.{parameter}": quantity(parameter, value) for parameter, value in values.items()}
    for name, values in (("fastest corner", FAST), ("middle of the ranges", {}), ("slowest corner", SLOW))
}
"""What the curves show: the highest and the lowest natural frequency within the ranges, and the middle."""


def study(client: servotune.Client) -> Figure:
    """Print what the ranges do and which parameter moves which property; return the curves."""
    ranges(client)
    influence(client)
    variants = list(CASES.values())
    moves = client.simulate(MOTOR, input=INPUT, duration=3, samples=600, metrics=[], variants=variants)
    frequencies = [10 ** (place / 200) for place in range(-100, 501)]
    responses = client.frequency_response(
        MOTOR, from_="flow", to="velocity", frequencies=frequencies, metrics=[], variants=variants
    )
    return draw(moves, responses)


def ranges(client: servotune.Client) -> None:
    """Print the properties at both ends of every range, the other parameters in the middle."""
    ends = [(name, value) for name, (low, high, _) in RANGES.items() for value in (low, high)]
    variants = [{}, *({f"motor.{name}": quantity(name, value)} for name, value in ends)]
    metrics = ["response_time", "overshoot", "max_velocity", "max_acceleration"]
    reply = client.simulate(MOTOR, input=INPUT, metrics=metrics, variants=variants)
    metrics = ["critical_frequency", "damping_ratio"]
    poles = client.frequency_response(MOTOR, from_="flow", to="velocity", metrics=metrics, variants=variants)
    names = ["middle of all ranges", *(f"{name} {value:g} {RANGES[name][2]}" for name, value in ends)]
    rows = []
    for name, move, response in zip(names, reply["variants"], poles["variants"], strict=True):
        velocity, acceleration = move["metrics"]["velocity"], move["metrics"]["acceleration"]
        rows.append((
            name,
            show(response["metrics"]["critical_frequency"], 1, "rad/s"),
            show(response["metrics"]["damping_ratio"], 1, ""),
            show(velocity["response_time"], 1, "s"),
            show(velocity["overshoot"], 100, "%"),
            show(velocity["max_velocity"], 100, "cm/s"),
            show(acceleration["max_acceleration"], 100, "cm/s²"),
        ))  # fmt: skip
    head = ("flow of 60 cm³/s", "critical frequency", "damping", "response time", "overshoot", "velocity")
    table((*head, "acceleration"), rows)


def influence(client: servotune.Client) -> None:
    """Print the table of influence: the coefficient of a finite change and, in brackets, the elasticity."""
    rows = []
    for name, change in CHANGES.items():
        path, cells = f"motor.{name}", []
        for metric, output in PROPERTIES.items():
            found = client.influence(
                MOTOR, input="flow", output=output, signal=FLOW, parameters=[path], metrics=[metric], change=change
            )
            finite, exact = found["coefficients"][metric][path], found["elasticities"][metric][path]
            cells.append(f"{number(finite['value'])} ({number(exact['value'])})")
        rows.append((f"{name} {100 * change:+.0f} %", *cells))
    print("\nInfluence: coefficient of the finite change (elasticity)")
    table(("", *PROPERTIES), rows)


def number(value: float | None) -> str:
    """Return a coefficient with its sign."""
    return "none" if value is None else f"{value:+.3f}"


def draw(moves: Simulation, responses: FrequencyResponse) -> Figure:
    """Return time responses above, Bode and Nyquist diagrams below."""
    figure, (position, velocity, acceleration, magnitude, phase, nyquist) = panels(2, 3, size=(12, 7))
    for name, move, response in zip(CASES, moves["variants"], responses["variants"], strict=True):
        time, frequency = move["time"], response["frequency"]
        for panel, output in ((position, "position"), (velocity, "velocity"), (acceleration, "acceleration")):
            panel.plot(time, scaled(move["outputs"][output], 100), label=name)
        magnitude.loglog(frequency, scaled(response["magnitude"], 1e-4), label=name)
        phase.semilogx(frequency, scaled(response["phase"], 180 / math.pi), label=name)
        nyquist.plot(scaled(response["real"], 1e-4), scaled(response["imag"], 1e-4), label=name)
    label(position, title="Movement, flow of 60 cm³/s", x="time, s", y="position, cm", xlim=(0, 3), ylim=(0, None))
    label(velocity, title="Velocity", x="time, s", y="velocity, cm/s", xlim=(0, 3), legend=False)
    label(acceleration, title="Acceleration", x="time, s", y="acceleration, cm/s²", xlim=(0, 3), legend=False)
    axis, gain = "frequency, rad/s", "cm/s per cm³/s"
    label(magnitude, title="Bode diagram, flow to velocity", x=axis, y=f"magnitude, {gain}", legend=False)
    label(phase, title="Its phase", x=axis, y="phase, °", yticks=range(-180, 1, 45), legend=False)
    label(nyquist, title="Nyquist diagram", x=f"real part, {gain}", y=f"imaginary part, {gain}", legend=False)
    nyquist.set_aspect("equal", adjustable="datalim")
    nyquist.locator_params(nbins=6)
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the script and return its exit code."""
    return run(study, arguments)


if __name__ == "__main__":
    sys.exit(main())
