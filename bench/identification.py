"""How long it takes to identify: a linear loop exactly, a stiff nonlinear damper from several recordings at once.

Run as `python -m bench.identification`, or with all others by `make bench`.
The recordings are those of examples/data; where SERVOTUNE_RECORDINGS names the folder with all fifteen sines of the damper, they are taken.
"""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from api.formats.text.txt import TextLayout, read
from bench.table import Job, Row
from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from optimizers.identification import Identified, identify
from optimizers.problem import Variable
from optimizers.recorded.recording import Identification, RecordedExperiment, Recording

DATA = Path(__file__).parents[1] / "examples" / "data"
ACTIVE = (6.747, 59.925)
"""The part of the chirp in which something moves, s."""


def jobs(*, most: int) -> list[Job]:
    """Return the rows of all identifications; ``most`` simulations are made for each start."""
    loop, damper = _loop(most), _damper(most)
    tests = len(damper.experiments)
    return [
        Job(title="servo-hydraulic loop, 53,179 samples, 4 parameters", clock="wall", rows=[_row(loop)]),
        Job(title=f"magneto-rheological damper, {tests} sines, 12 parameters", clock="wall", rows=[_row(damper)]),
    ]


def _row(problem: Identification) -> Row:
    begin, used = time.perf_counter(), time.process_time()
    found = identify(problem, rng=np.random.default_rng(0))
    spent, busy = 1e3 * (time.perf_counter() - begin), 1e3 * (time.process_time() - used)
    remark = f"{found.evaluations} simulations, {_fit(found)}; {busy:.0f} ms of CPU"
    return Row(who="this engine", milliseconds=spent, remark=remark)


def _fit(found: Identified) -> str:
    return ", ".join(f"FIT {fit.fit_percent:.2f} %" for fit in found.estimation.values() if fit.fit_percent is not None)


def _wired(blocks: dict[str, Block], wires: str, outputs: dict[str, str], parameters: dict[str, float]) -> Diagram:
    pairs = (wire.split(" -> ") for wire in wires.split(", "))
    return compile_system(
        System(
            name="bench",
            parameters={name: Parameter(value=value) for name, value in parameters.items()},
            blocks=blocks,
            connections=tuple(Connection(source=source, target=target) for source, target in pairs),
            outputs=outputs,
        )
    )


def _loop(most: int) -> Identification:
    """Return position loop, valve and cylinder: gain, lag, delay and the sensor's offset are unknown."""
    folder = DATA / "servo_hydraulic_actuator"
    described: dict[str, Any] = json.loads((folder / "import.json").read_text(encoding="utf-8"))
    columns = described["columns"]
    layout = TextLayout(
        columns=tuple(column["index"] for column in columns), delimiter=described["delimiter"],
        decimal=described["decimal"], header_lines=described["header_lines"],
    )  # fmt: skip
    with (folder / "0A.txt").open("rb") as file:
        rows = np.concatenate(list(read(iter(lambda: file.read(1 << 16), b""), layout)))
    signals = {column["name"]: 1e-3 * column["scale"] * rows[:, k] for k, column in enumerate(columns)}
    drive = {
        "area": 1.26e-3,
        "volume": 2.5e-4,
        "bulk_modulus": 1e9,
        "leakage": 2.3e-11,
        "mass": 10.0,
        "viscous_friction": 1e3,
    }
    diagram = _wired(
        {
            "reference": Block(kind="input"),
            "error": Block(kind="sum", values={"signs": "+-"}),
            "controller": Block(kind="p", values={"kp": 200.0}),
            "transport": Block(kind="delay", values={"time": 0.002}),
            "valve": Block(kind="proportional_valve", values={"flow_gain": 1e-4, "time_constant": 0.002}),
            "cylinder": Block(kind="linear_hydraulic_motor", values=drive),
        },
        "reference -> error.in1, error -> controller, controller -> transport, transport -> valve, valve -> cylinder.flow, "
        "cylinder.position -> error.in2",
        {"position": "cylinder.position"}, {},
    )  # fmt: skip
    recording = Recording(
        inputs={"reference": signals["command"]}, outputs={"position": signals["position"]}, sample_time=1e-3
    )
    bounds = {"valve.flow_gain": (2e-5, 1e-3), "valve.time_constant": (1e-4, 0.02), "transport.time": (0.0, 0.02)}
    return Identification(
        diagram=diagram,
        experiments=(RecordedExperiment(recording=recording, estimation=ACTIVE),),
        parameters=tuple(Variable(parameter=k, lower=low, upper=high) for k, (low, high) in bounds.items()),
        offsets=True,
        max_evaluations=most,
    )


def _damper(most: int) -> Identification:
    """Return the modified Bouc-Wen model at the published start of its fit, each sine with the current that it was recorded at."""
    start = {
        "k0": 0.0, "k1": 0.0, "x0": 0.0, "a2": -17.1e3, "a1": 23.82e3, "a0": 5.73e3, "g": 0.68e6, "gr": -2.91,
        "c01": 12.34e3, "c00": 0.67e3, "c11": 86.19e3, "c10": 10.4e3,
    }  # fmt: skip
    values = {
        "alpha": ["=a0", "=a1", "=a2"], "c0": ["=c00", "=c01"], "c1": ["=c10", "=c11"], "k0": ["=k0"], "k1": "=k1",
        "x0": "=x0", "gamma": "=g", "gamma_rate": "=gr", "A": 300.0, "n": 2.0,
    }  # fmt: skip
    diagram = _wired(
        {"x": Block(kind="input"), "v": Block(kind="input"), "d": Block(kind="mr_damper_spencer", values=values),
         "coil": Block(kind="passive_on", values={"current": "=current"})},
        "x -> d.displacement, v -> d.velocity, coil -> d.current", {"force": "d"}, {**start, "current": 0.0},
    )  # fmt: skip
    positive = {"k0", "k1", "a0", "g", "c00", "c10"}
    return Identification(
        diagram=diagram,
        experiments=tuple(_sine(path) for path in _sines()),
        parameters=tuple(Variable(parameter=name, lower=0.0 if name in positive else None) for name in start),
        max_evaluations=most,
    )


def _sines() -> list[Path]:
    folder = os.environ.get("SERVOTUNE_RECORDINGS", "")
    elsewhere = sorted(Path(folder, "mr_damper_mts", "sinusoidal_preprocessed").glob("*mm*A.txt")) if folder else []
    return elsewhere or sorted((DATA / "mr_damper").glob("*mm*A.txt"))


def _sine(path: Path) -> RecordedExperiment:
    data = np.loadtxt(path)
    current = float(path.stem.partition("Hz")[2][:-1].replace("x", "."))
    recording = Recording(
        inputs={"x": 1e-3 * data[:, 1], "v": 1e-3 * data[:, 2]}, outputs={"force": data[:, 3]},
        sample_time=round(float(data[1, 0] - data[0, 0]), 6),
    )  # fmt: skip
    return RecordedExperiment(recording=recording, name=path.stem.lower(), values={"current": current}, split=1.0)


def main() -> None:
    """Print the times."""
    from rich.console import Console  # noqa: PLC0415 - only where a table is printed

    from bench.table import render  # noqa: PLC0415 - as above

    Console(width=150).print(render(jobs(most=60), title="identification"))


if __name__ == "__main__":
    main()
