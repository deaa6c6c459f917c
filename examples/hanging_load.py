"""A hydraulic cylinder that lifts and lowers a load: one lag does not explain both directions, a valve that differs by direction does.

The recording is data/hydraulic_bench/HangingLoad.csv: a staircase up, then down. Start a service with `make serve`, then

    .venv/bin/python examples/hanging_load.py --key KEY

where KEY is the key that the service printed when it started for the first time. The figure is written to hanging-load.png.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import servotune
from examples.presentation import label, panels, run, scaled, table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DATA = Path(__file__).parent / "data" / "hydraulic_bench" / "HangingLoad.csv"
RATE = 50
"""Samples per second."""
LAYOUT = {
    "delimiter": ",",
    "decimal": ".",
    "header_lines": 0,
    "sample_rate": RATE,
    "columns": [{"index": 1, "name": "reference", "unit": ""}, {"index": 2, "name": "position", "unit": ""}],
}
UP, DOWN = (0, 178), (178.02, 321)
"""The staircase turns in between, s."""

CHANNELS: Mapping[str, Any] = {
    # straight lines, as the values were computed that these are compared with
    "inputs": {"reference": {"channel": "reference", "between_samples": "linear"}},
    "outputs": {"position": "position"},
}

LAG = {
    "name": "Cylinder under its controller, one lag",
    "parameters": {"tau": {"value": 0.5, "unit": "s", "lower": 0.01, "upper": 10}},
    "blocks": {
        "reference": {"kind": "input"},
        "lag": {"kind": "transfer_function", "numerator": [1], "denominator": ["=tau", 1]},
    },
    "connections": [{"from": "reference", "to": "lag"}],
    "outputs": {"position": "lag"},
}

BY_DIRECTION = {
    "name": "Cylinder under its controller, a valve that differs by direction",
    "parameters": {
        "tau_up": {"value": 0.5, "unit": "s", "lower": 0.05, "upper": 5},
        "tau_down": {"value": 0.5, "unit": "s", "lower": 0.05, "upper": 5},
        "band_down": {"value": 0.02, "lower": 0.001, "upper": 0.5, "doc": "error below which nothing is lowered"},
    },
    "blocks": {
        "reference": {"kind": "input"},
        "error": {"kind": "sum", "signs": "+-"},
        "valve": {
            "kind": "lookup_table",
            "points": ["=-10-band_down", "=-band_down", 0.01, 10.01],
            "values": ["=-10/tau_down", 0, 0, "=10/tau_up"],
            "extrapolation": "linear",
        },
        "cylinder": {"kind": "integrator"},
    },
    "connections": [
        {"from": "reference", "to": "error.in1"},
        {"from": "cylinder", "to": "error.in2"},
        {"from": "error", "to": "valve"},
        {"from": "valve", "to": "cylinder"},
    ],
    "outputs": {"position": "cylinder"},
}


def study(client: servotune.Client) -> Figure:
    """Identify both models and draw what they leave."""
    dataset = client.datasets.upload({"name": DATA.name, "format": "csv", "import": LAYOUT}, DATA)["id"]

    def lag(window: Sequence[float], other: Sequence[float] | None = None) -> Any:
        return client.identify(
            LAG,
            dataset=dataset,
            **CHANNELS,
            parameters=["tau"],
            offsets="estimate",
            estimation=window,
            validation=other,
        ).wait()

    both, up, down = lag((0, 321)), lag(UP, DOWN), lag(DOWN, UP)
    own = client.identify(
        BY_DIRECTION, dataset=dataset, **CHANNELS, parameters=["tau_up", "tau_down", "band_down"],
        initial_states="estimate", estimation=(0, 321),
    ).wait()  # fmt: skip
    rows = [
        ("one lag, up and down", found(both, "tau"), fit(both, "estimation"), "-"),
        ("one lag, up alone", found(up, "tau"), fit(up, "estimation"), fit(up, "validation")),
        ("one lag, down alone", found(down, "tau"), fit(down, "estimation"), fit(down, "validation")),
        ("by direction", f"{found(own, 'tau_up')}, {found(own, 'tau_down')}", fit(own, "estimation"), "-"),
    ]
    table(("model", "time constant", "FIT where estimated", "FIT in the other direction"), rows)
    return draw(client, dataset, both, {"Lifting": up, "Lowering": down})


def found(result: Any, name: str) -> str:
    """Return an estimate with its interval."""
    estimate = result["parameters"][name]
    return f"{estimate['value']:.3f} s ({estimate['lower95']:.2f} to {estimate['upper95']:.2f})"


def fit(result: Any, part: str) -> str:
    """Return the FIT of the position."""
    return f"{result['fit'][part]['position']['fit_percent']:.2f} %"


def draw(client: servotune.Client, dataset: str, both: Any, alone: Mapping[str, Any]) -> Figure:
    """Return measured and simulated steps: up and down, with the lag of both and that of the direction."""

    def curves(result: Any) -> Any:
        values = {path: estimate["value"] for path, estimate in result["parameters"].items()}
        reply = client.validate(LAG, dataset=dataset, **CHANNELS, parameters=values, offsets=result["offsets"])
        return reply["outputs"]["position"]["curves"]

    common = curves(both)
    figure, axes = panels(1, 2, size=(11, 4.2))
    for axis, (title, result), (begin, end) in zip(axes, alone.items(), ((120, 150), (200, 230)), strict=True):
        part = slice(begin * RATE, end * RATE)
        for name, curve in (("one lag", common), ("lag of this direction", curves(result))):
            axis.plot(scaled(curve["time"], 1)[part], scaled(curve["simulated"], 1)[part], label=name)
        time, measured = scaled(common["time"], 1)[part], scaled(common["measured"], 1)[part]
        axis.plot(time, measured, color="0.45", linestyle=":", label="measured")
        label(axis, title=title, x="time, s", y="position")
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the script and return its exit code."""
    return run(study, arguments)


if __name__ == "__main__":
    sys.exit(main())
