"""The resistance of a DC motor's armature, 0.33, 0.5 and 0.8 ohm: what it does to speed, current and stiffness under load.

A voltage starts the motor, then a torque loads it. With the torque constant k_t and the back-EMF constant k_e, the resistance R_a
sets the mechanical time constant R_a J / (k_t k_e), the largest current of the start, below U / R_a, and the speed that a load
costs, R_a M / (k_t k_e). Start a service with `make serve`, then

    .venv/bin/python examples/dc_motor_resistance.py --key KEY

where KEY is the key that the service printed when it started for the first time. The figure is written to dc-motor-resistance.png.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

import servotune
from examples.presentation import label, panels, run, show, table
from servotune.replies import Simulation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TORQUE_CONSTANT, BACK_EMF_CONSTANT = 0.2, 0.2
INERTIA, INDUCTANCE, FRICTION = 2e-3, 1e-3, 1e-3
MOTOR = {
    "name": "DC motor",
    "blocks": {
        "voltage": {"kind": "input"},
        "load": {"kind": "input", "role": "disturbance"},
        "motor": {
            "kind": "dc_motor",
            "resistance": {"value": 0.5, "unit": "ohm"},
            "inductance": {"value": INDUCTANCE, "unit": "H"},
            "torque_constant": {"value": TORQUE_CONSTANT, "unit": "N*m/A"},
            "back_emf_constant": {"value": BACK_EMF_CONSTANT, "unit": "V*s/rad"},
            "inertia": {"value": INERTIA, "unit": "kg*m**2"},
            "viscous_friction": {"value": FRICTION, "unit": "N*m*s/rad"},
        },
    },
    "connections": [{"from": "voltage", "to": "motor.voltage"}, {"from": "load", "to": "motor.load_torque"}],
    "outputs": {"speed": "motor.speed", "current": "motor.current"},
}
RESISTANCES = (0.33, 0.5, 0.8)
VARIANTS = [{"motor.resistance": resistance} for resistance in RESISTANCES]
START = {"port": "voltage", "signal": {"kind": "step", "amplitude": {"value": 24, "unit": "V"}}}
LOAD = {"port": "load", "signal": {"kind": "step", "amplitude": {"value": 2, "unit": "N*m"}, "start": 0.3}}


def study(client: servotune.Client) -> Figure:
    """Compare the resistances: a table of the start and of the load, and the curves of both in one run."""
    start = client.simulate(MOTOR, input=START, metrics=["rise_time", "response_time", "peak"], variants=VARIANTS)
    path = client.frequency_response(MOTOR, from_="voltage", to="speed", variants=VARIANTS)
    push = client.simulate(MOTOR, input=LOAD, metrics=["peak"], variants=VARIANTS)
    rows = []
    for resistance, begun, response, loaded in zip(
        RESISTANCES, start["variants"], path["variants"], push["variants"], strict=True
    ):
        speed, current = begun["metrics"]["speed"], begun["metrics"]["current"]
        slowest = max(pole["real"] for pole in response["poles"] if pole["real"] < 0)
        rows.append((
            f"{resistance:g} ohm",
            f"{-1e3 / slowest:.3g} ms",
            f"{1e3 * resistance * INERTIA / (TORQUE_CONSTANT * BACK_EMF_CONSTANT):.3g} ms",
            show(speed["rise_time"], 1e3, "ms"),
            show(speed["response_time"], 1e3, "ms"),
            show(current["peak"], 1, "A"),
            show(loaded["metrics"]["speed"]["peak"], 1, "rad/s"),
        ))  # fmt: skip
    head = ("R_a", "slowest time constant", "R_a J/(k_t k_e)", "rise time", "response time", "largest current")
    table((*head, "lost to 2 N·m"), rows)
    return draw(client.simulate(MOTOR, input=[START, LOAD], duration=0.6, variants=VARIANTS))


def draw(reply: Simulation) -> Figure:
    """Return speed and current over time, the resistances overlaid."""
    figure, (speed, current) = panels(2, 1, size=(8, 6.5))
    for resistance, variant in zip(RESISTANCES, reply["variants"], strict=True):
        speed.plot(variant["time"], variant["outputs"]["speed"], label=f"$R_a$ = {resistance:g} Ω")
        current.plot(variant["time"], variant["outputs"]["current"], label=f"$R_a$ = {resistance:g} Ω")
    title = "DC motor started with 24 V, loaded with 2 N·m after 0.3 s"
    label(speed, title=title, x="time, s", y="speed, rad/s", xlim=(0, 0.6))
    label(current, title="", x="time, s", y="armature current, A", xlim=(0, 0.6))
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the script and return its exit code."""
    return run(study, arguments)


if __name__ == "__main__":
    sys.exit(main())
