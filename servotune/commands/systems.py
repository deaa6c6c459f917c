"""`servotune systems`: the documents that the service keeps."""

from __future__ import annotations

from pathlib import Path

import click

from servotune.client import Client
from servotune.commands.connecting import asking, ids, print_json, print_table, shown_as
from servotune.commands.files import read_json


@click.group
def systems() -> None:
    """List, show, store and delete systems."""


@systems.command("list")
@asking
@shown_as
def list_(client: Client, *, as_json: bool) -> None:
    """List the stored systems."""
    found = list(client.systems.list())
    if as_json:
        print_json(found)
        return
    rows = [(one.id, one.name, one.revision, one.created_at) for one in found]
    print_table(("id", "name", "revision", "stored at"), rows, nothing="No system is stored yet.")


@systems.command
@click.argument("system", shell_complete=ids("systems"))
@click.option("--revision", type=click.IntRange(min=1), help="Which one; the present one unless given.")
@asking
def show(client: Client, *, system: str, revision: int | None) -> None:
    """Print the document of a stored system."""
    found = client.systems.get(system) if revision is None else client.systems.revision(system, revision)
    print_json(found.document)


@systems.command
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "--update", metavar="ID", shell_complete=ids("systems"), help="Store it as the next revision of this system."
)
@asking
def store(client: Client, *, file: Path, update: str | None) -> None:
    """Store the document in a file, and print its id."""
    document = read_json(file)
    stored = client.systems.create(document) if update is None else client.systems.update(update, document)
    click.echo(f"{stored.id}  {document.get('name', '')}, revision {stored.revision}")


@systems.command
@click.argument("system", shell_complete=ids("systems"))
@click.option("--force", is_flag=True, help="Also where schedules need it.")
@asking
def delete(client: Client, *, system: str, force: bool) -> None:
    """Delete a system; results keep the revision that they used."""
    client.systems.delete(system, force=force)
    click.echo(f"Deleted {system}.")
