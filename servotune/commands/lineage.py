"""`servotune lineage`: exports a lineage into one file, and repeats it on another installation."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import click

from servotune.bundles import Bundle
from servotune.client import Client
from servotune.commands.connecting import asking, print_table
from servotune.commands.files import Target
from servotune.repeating import TOLERANCE, Repeated

_SHOWN = 5


@click.group
def lineage() -> None:
    """Export a lineage into one file, or repeat it and compare its numbers."""


@lineage.command
@click.argument("id")
@click.option("--output", type=Target(), required=True, help="The file to write.")
@click.option(
    "--direction", type=click.Choice(["up", "both", "down"]), default="up", help="both: also all that was made from it."
)
@asking
def export(client: Client, *, id: str, output: Path, direction: Literal["up", "both", "down"]) -> None:  # noqa: A002 - shown in the help
    """Write everything that a result needs into one file.

    ID is that of a dataset, job, kept study, system, or revision sys_...@3.
    """
    client.lineage.export(id, output, direction=direction)
    with Bundle(output) as bundle:
        count = len(bundle.nodes)
    click.echo(f"{output}: {count} things, {output.stat().st_size} bytes")


@lineage.command
@click.argument("bundle", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "--tolerance",
    type=click.FloatRange(min=0.0),
    default=TOLERANCE,
    show_default=True,
    help="Largest relative difference.",
)
@click.option("--all", "every", is_flag=True, help="Show every number, not only the farthest apart.")
@asking
def replay(client: Client, *, bundle: Path, tolerance: float, every: bool) -> int:
    """Make it all again and compare every number."""
    with Bundle(bundle) as opened:
        then = opened.manifest.get("versions", {})
    done = client.lineage.repeat(bundle, told=_tell)
    click.echo(f"{bundle.name}, recorded with {_text(then)}")
    rows = [row for found in done for row in _rows(found, None if every else _SHOWN)]
    print_table(("thing", "quantity", "recorded", "repeated", "difference"), rows, nothing="It holds nothing.")
    compared = sum(len(found.differences) for found in done)
    largest = max((found.largest for found in done), default=0.0)
    agrees = largest <= tolerance
    click.echo(
        f"{compared} numbers compared, largest difference {largest:.3g}: "
        f"{'the same' if agrees else 'NOT the same'} within {tolerance:g}"
    )
    return 0 if agrees else 1


def _tell(found: Repeated) -> None:
    sys.stderr.write(f"{found.kind} {found.id} -> {found.new_id or found.note}\n")


def _rows(found: Repeated, most: int | None) -> Iterator[tuple[str, ...]]:
    thing = f"{found.kind} {found.id}"
    if not found.differences:
        yield thing, found.note or "made again", "", "", ""
        return
    for row in found.differences[:most]:
        yield thing, row.path, _number(row.recorded), _number(row.repeated), f"{row.difference:.2g}"
        thing = ""
    left = 0 if most is None else len(found.differences) - most
    if left > 0:
        yield "", f"... and {left} more, closer", "", "", ""


def _number(value: object) -> str:
    return f"{value:.10g}" if isinstance(value, int | float) and math.isfinite(value) else str(value)


def _text(versions: object) -> str:
    return ", ".join(f"{name} {number}" for name, number in versions.items()) if isinstance(versions, dict) else ""
