"""`servotune simulate`: the answer to a command as a table of metrics, and its curves as a file."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import click

from servotune.client import Client
from servotune.commands.connecting import asking, ids, print_json, print_table, shown_as
from servotune.commands.files import Target, system_of
from servotune.replies import Simulation

Pair = tuple[str, Any]


class Setting(click.ParamType[Pair]):
    """A name and its value: `kp=50`, `time_constant=20 ms`."""

    name = "NAME=VALUE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Pair:
        """Return name and value: a number, or a number with its unit as the service reads it."""
        name, equals, text = str(value).partition("=")
        if not (name.strip() and equals and text.strip()):
            self.fail(f"must be NAME=VALUE, such as kp=50 or kp='20 rad/s', got {value!r}", param, ctx)
        return name.strip(), quantity(text.strip())


def quantity(text: str) -> Any:
    """Return a number, a quantity of a number and its unit, or the text itself."""
    number, _, unit = text.partition(" ")
    try:
        value = float(number)
    except ValueError:
        return text
    return {"value": value, "unit": unit.strip()} if unit.strip() else value


@click.command
@click.argument("system", shell_complete=ids("systems"))
@click.option("--input", "port", metavar="NAME", help="The input that is commanded; the only one unless given.")
@click.option(
    "--signal", default="step", show_default=True, help="step, ramp, s_curve, sine ...: the catalogue lists all."
)
@click.option(
    "--with", "options", type=Setting(), multiple=True, help="A parameter of the signal, amplitude=0.01 say; repeat it."
)
@click.option(
    "--set", "values", type=Setting(), multiple=True, help="A parameter of the system for this run; repeat it."
)
@click.option("--output", "outputs", multiple=True, metavar="NAME", help="Outputs; all unless given. Repeat it.")
@click.option(
    "--metric", "metrics", multiple=True, metavar="NAME", help="Metrics; all that apply unless given. Repeat it."
)
@click.option("--duration", type=float, help="Length of the curves, s; chosen by the service unless given.")
@click.option("--samples", type=click.IntRange(min=2), help="Points of each curve.")
@click.option("--csv", "table", type=Target(), help="Write the curves into this file.")
@asking
@shown_as
def simulate(
    client: Client, *, system: str, port: str | None, signal: str, options: tuple[Pair, ...], values: tuple[Pair, ...],
    outputs: tuple[str, ...], metrics: tuple[str, ...], duration: float | None, samples: int | None, table: Path | None,
    as_json: bool,
) -> None:  # fmt: skip
    """Answer a command: SYSTEM is an id, or a file with a document."""
    asked = system_of(system)
    found = client.simulate(
        asked,
        input={"port": port or _only_input(client, asked), "signal": {"kind": signal} | dict(options)},
        outputs=list(outputs) or None,
        metrics=list(metrics) or None,
        duration=duration,
        samples=samples,
        variants=[dict(values)] if values else None,
    )
    if table is not None:
        _write(found, table)
    if as_json:
        print_json(found)
        return
    rows = [
        (output, name, "" if one.value is None else f"{one.value:.6g}", one.unit, one.verdict, one.get("advice"))
        for output, own in found.only().metrics.items()
        for name, one in own.items()
    ]
    print_table(("output", "metric", "value", "unit", "verdict", "advice"), rows, nothing="No metric applies.")


def _only_input(client: Client, system: str | dict[str, Any]) -> str:
    """Return the name of the only input of a system."""
    document = system if isinstance(system, dict) else client.systems.get(system).document
    blocks = document.get("blocks") or {}
    found = [name for name, block in blocks.items() if isinstance(block, dict) and block.get("kind") == "input"]
    if len(found) != 1:
        raise click.UsageError(f"--input must name one of {', '.join(found) or 'the inputs, the system has none'}")
    return str(found[0])


def _write(found: Simulation, path: Path) -> None:
    """Write the curves of the only variant, one column for each output."""
    variant = found.only()
    units = [variant.unit_of(name) for name in variant.outputs]
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        heads = (
            f"{name} [{unit}]" if unit not in {"", "1"} else name
            for name, unit in zip(variant.outputs, units, strict=True)
        )
        rows.writerow(["time [s]", *heads])
        rows.writerows(zip(variant.time, *variant.outputs.values(), strict=True))
    click.echo(f"{path}: {len(variant.time)} points", err=True)
