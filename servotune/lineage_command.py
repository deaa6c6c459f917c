"""`servotune lineage`: exports a lineage into one file, and repeats it on another installation."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import httpx
from rich.console import Console
from rich.table import Table

from servotune.bundles import Bundle
from servotune.client import Client, connect
from servotune.errors import ServotuneError
from servotune.repeating import TOLERANCE, Repeated

_SHOWN = 5


def lineage(arguments: Sequence[str]) -> int:
    """Export a lineage into one file, or repeat it and compare its numbers."""
    parser = argparse.ArgumentParser(prog="servotune lineage", description=lineage.__doc__)
    actions = parser.add_subparsers(dest="action", required=True)
    export = actions.add_parser("export", help="write everything that a result needs into one file")
    export.add_argument("id", help="dataset, job, kept study, system, or revision sys_...@3")
    export.add_argument("--output", type=Path, required=True, help="the file to write")
    export.add_argument(
        "--direction", choices=("up", "both", "down"), default="up", help="both: also all that was made from it"
    )
    replay = actions.add_parser("replay", help="make it all again and compare every number")
    replay.add_argument("bundle", type=Path)
    replay.add_argument("--tolerance", type=float, default=TOLERANCE, help="largest relative difference (%(default)g)")
    replay.add_argument("--all", action="store_true", help="show every number, not only the farthest apart")
    for action in (export, replay):
        action.add_argument(
            "--url", default=os.environ.get("SERVOTUNE_URL", "http://127.0.0.1:8000"), help="the service (%(default)s)"
        )
        action.add_argument("--key", default=os.environ.get("SERVOTUNE_KEY"), help="its key; or SERVOTUNE_KEY")
    given = parser.parse_args(list(arguments))
    if given.action == "replay" and not given.tolerance >= 0.0:
        parser.error(f"argument --tolerance: must be >= 0, got {given.tolerance}")
    try:
        with connect(given.url, key=given.key) as client:
            if given.action == "export":
                return _export(client, given.id, given.output, given.direction)
            return _replay(client, given.bundle, given.tolerance, every=given.all)
    except (ServotuneError, OSError, httpx.HTTPError) as error:
        sys.stderr.write(f"servotune lineage: {error}\n")
        return 1


def _export(client: Client, identifier: str, output: Path, direction: str) -> int:
    client.lineage.export(identifier, output, direction=direction)  # type: ignore[arg-type]  # argparse has checked it
    with Bundle(output) as bundle:
        count = len(bundle.nodes)
    sys.stdout.write(f"{output}: {count} things, {output.stat().st_size} bytes\n")
    return 0


def _replay(client: Client, path: Path, tolerance: float, *, every: bool) -> int:
    with Bundle(path) as bundle:
        then = bundle.manifest.get("versions", {})
    console = Console(width=None if sys.stdout.isatty() else 160)
    done = client.lineage.repeat(path, told=_tell)
    table = Table(
        "thing", "quantity", "recorded", "repeated", "difference", title=f"{path.name}, recorded with {_text(then)}"
    )
    for found in done:
        _rows(table, found, None if every else _SHOWN)
    console.print(table)
    compared = sum(len(found.differences) for found in done)
    largest = max((found.largest for found in done), default=0.0)
    agrees = largest <= tolerance
    sys.stdout.write(
        f"{compared} numbers compared, largest difference {largest:.3g}: "
        f"{'the same' if agrees else 'NOT the same'} within {tolerance:g}\n"
    )
    return 0 if agrees else 1


def _tell(found: Repeated) -> None:
    sys.stderr.write(f"{found.kind} {found.id} -> {found.new_id or found.note}\n")


def _rows(table: Table, found: Repeated, most: int | None) -> None:
    thing = f"{found.kind} {found.id}"
    if not found.differences:
        table.add_row(thing, found.note or "made again", "", "", "")
        return
    for row in found.differences[:most]:
        table.add_row(thing, row.path, _number(row.recorded), _number(row.repeated), f"{row.difference:.2g}")
        thing = ""
    left = 0 if most is None else len(found.differences) - most
    if left > 0:
        table.add_row("", f"... and {left} more, closer", "", "", "")


def _number(value: object) -> str:
    return f"{value:.10g}" if isinstance(value, int | float) and math.isfinite(value) else str(value)


def _text(versions: object) -> str:
    return ", ".join(f"{name} {number}" for name, number in versions.items()) if isinstance(versions, dict) else ""
