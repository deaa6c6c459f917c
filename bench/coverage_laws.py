"""What a candidate of a position loop with each nonlinear or sampled element costs, found by discovery: the second table of `make bench-coverage`.

An element with one input stands behind the controller, one that is driven by a velocity acts on the axis with its force; those with more ports
need a plant of their own and are named. Overshoot and ∫ t |e| dt within 1 s, three gains varied; without a delay, and with one of 1 ms behind the
controller. Beside it scipy's LSODA, which is told the equations of the limited loop as plain Python.
"""

from __future__ import annotations

import time
from itertools import pairwise
from statistics import median

import numpy as np
from scipy.integrate import solve_ivp

from bench.coverage import FEW, MANY, SLOW, Real, timed
from engine import elements, signals
from engine.analysis.measuring import MetricRequest
from engine.batch.screening import Screening
from engine.diagram.diagram import Block, Connection, Diagram, System, compile_system
from engine.elements._nonlinear import NonlinearElement
from engine.model.errors import EngineError

DURATION = 1.0
DELAY = 1e-3
STEP = {"reference": signals.make("step", {})}
ASKED = [
    MetricRequest(metric=metric, signals=STEP, output="position", duration=DURATION) for metric in ("overshoot", "itae")
]
GIVEN = {"friction": {"coulomb": 0.4, "viscous": 0.1}, "saturation": {"lower": -2.0, "upper": 2.0}}
"""Where the example of an element is out of proportion to the loop."""
FILTER, MASS, DAMPING = 300.0, 0.02, 0.1


def laws() -> dict[str, type[NonlinearElement]]:
    """Return the elements of the table by their kinds: those with one output and one input."""
    found = {}
    for kind, element in elements.catalogue().items():
        if issubclass(element, NonlinearElement):
            values = {param.name: param.default for param in element.parameters} | dict(element.example)
            ports = element.ports(values)
            if len(ports.inputs) == len(ports.outputs) == 1:
                found[kind] = element
    return found


def loop(kind: str, delay: float) -> Diagram:
    """Return the loop with an element of this kind, and a delay (s) if there is one."""
    element = elements.catalogue()[kind]
    values = dict(GIVEN.get(kind, element.example))
    (port,) = element.ports({param.name: param.default for param in element.parameters} | values).inputs
    blocks = {
        "reference": Block(kind="input"), "error": Block(kind="sum", values={"signs": "+-"}),
        "pid": Block(kind="pid", values={"kp": 8.0, "ki": 2.0, "kd": 0.4, "filter_frequency": FILTER}),
        "law": Block(kind=kind, values=values), "force": Block(kind="sum", values={"signs": "+-"}),
        "mass": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": [MASS, DAMPING]}),
        "axis": Block(kind="integrator", values={}),
    }  # fmt: skip
    wires = [("reference", "error.in1"), ("axis", "error.in2"), ("error", "pid"), ("force", "mass"), ("mass", "axis")]
    way = ["pid"] if port == "velocity" else ["pid", "law"]
    wires += [("mass", "law"), ("law", "force.in2")] if port == "velocity" else []
    if delay:
        blocks["line"] = Block(kind="delay", values={"time": delay})
        way.append("line")
    wires += [*pairwise(way), (way[-1], "force.in1")]
    return compile_system(
        System(
            name="axis", parameters={}, blocks=blocks, outputs={"position": "axis"},
            connections=tuple(Connection(source=source, target=target) for source, target in wires),
        )
    )  # fmt: skip


def cost(kind: str, delay: float) -> str:
    """Return CPU microseconds a candidate, ! where some of them go to the exact path."""
    system = loop(kind, delay)
    try:
        screening = Screening(system, ASKED, threads=1)
        screening(_candidates(FEW))
        seconds, unknown = timed(system, screening, ASKED, _candidates(FEW))
        if seconds < SLOW:
            seconds, unknown = timed(system, screening, ASKED, _candidates(MANY))
    except EngineError as error:
        return error.message
    return f"{1e6 * seconds:,.0f}{'!' if unknown else ''}"


def _candidates(count: int) -> dict[str, Real]:
    random = np.random.default_rng(1)
    bounds = {"pid.kp": (6.0, 12.0), "pid.ki": (1.0, 3.0), "pid.kd": (0.3, 0.6)}
    return {name: random.uniform(*pair, count) for name, pair in bounds.items()}


def _rates(_: float, x: Real, kp: float, ki: float, kd: float) -> list[float]:
    """Return what drives integral, filter, velocity and position of the limited loop."""
    error = 1.0 - x[3]
    control = kp * error + ki * x[0] + kd * FILTER * (error - x[1])
    force = min(max(control, -2.0), 2.0)
    return [error, FILTER * (error - x[1]), (force - DAMPING * x[2]) / MASS, x[2]]


def lsoda() -> float:
    """Return the CPU seconds that LSODA takes for a candidate of the limited loop, at a relative tolerance of 1e-6."""
    points, times = _candidates(FEW), []
    for gains in zip(*points.values(), strict=True):
        begin = time.process_time()
        solve_ivp(
            _rates, (0.0, DURATION), [0.0] * 4, method="LSODA", rtol=1e-6, atol=1e-9, dense_output=True, args=gains
        )
        times.append(time.process_time() - begin)
    return median(times)


def main() -> None:
    """Measure, and print the table."""
    from rich.console import Console  # noqa: PLC0415 - only where a table is printed
    from rich.table import Table  # noqa: PLC0415

    found = laws()
    table = Table(title="CPU microseconds a candidate, overshoot and itae within 1 s; ! exact path")
    for name in ("element", "no delay", f"{1e3 * DELAY:g} ms of delay"):
        table.add_column(name, no_wrap=True, justify="left" if name == "element" else "right")
    for kind in found:
        table.add_row(kind, cost(kind, 0.0), cost(kind, DELAY))
    console = Console()
    console.print(table)
    others = [k for k, e in elements.catalogue().items() if issubclass(e, NonlinearElement) and k not in found]
    console.print(f"LSODA on the limited loop: {1e6 * lsoda():,.0f} us; with ports of their own: {', '.join(others)}")
