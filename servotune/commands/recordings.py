"""`servotune upload`: a file becomes a recording."""

from __future__ import annotations

from pathlib import Path

import click

from servotune.client import Client
from servotune.commands.connecting import asking, print_json, print_table, shown_as
from servotune.commands.files import read_json
from servotune.progress import ProgressBar


@click.command
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--name", help="Of the recording; that of the file unless given.")
@click.option("--format", "format_", metavar="FORMAT", help="csv, tdms, mdf, mat ...; told from the file unless given.")
@click.option(
    "--import", "description", type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="A file with an import description, where the layout of a table must be said.",
)  # fmt: skip
@click.option("--sample-rate", type=float, help="Samples per second, where the file does not tell.")
@click.option("--allow-truncated", is_flag=True, help="Read a file that is cut off up to its end.")
@asking
@shown_as
def upload(
    client: Client, *, file: Path, name: str | None, format_: str | None, description: Path | None,
    sample_rate: float | None, allow_truncated: bool, as_json: bool,
) -> None:  # fmt: skip
    """Send a recording in a file; what has arrived is not sent again."""
    read = {} if description is None else read_json(description)
    read |= {} if sample_rate is None else {"sample_rate": sample_rate}
    read |= {"allow_truncated": True} if allow_truncated else {}
    document = (
        {"name": name or file.name} | ({"format": format_} if format_ else {}) | ({"import": read} if read else {})
    )
    with ProgressBar(f"sending {file.name}") as told:
        found = client.datasets.upload(document, file, progress=told)
    if as_json:
        print_json(found)
        return
    click.echo(f"{found.id}  {found.name}, {found.sample_count} samples at {found.sample_rate} per second", err=False)
    rows = [(one["name"], one.get("unit"), one.get("quantity")) for one in found.channels or ()]
    print_table(("channel", "unit", "quantity"), rows, nothing="It has no channels.")
