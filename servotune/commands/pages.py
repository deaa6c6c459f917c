"""`servotune open`: the page of a thing in the browser."""

from __future__ import annotations

import click

from servotune.client import Client
from servotune.commands.connecting import asking

PLACES = {"sys": "systems", "job": "jobs", "ds": "datasets", "sch": "schedules", "acq": "acquisitions"}
"""What an id begins with -> where its page is."""


@click.command("open")
@click.argument("id", required=False)
@click.option("--print", "only_print", is_flag=True, help="Print the address, and open nothing.")
@asking
def open_(client: Client, *, id: str | None, only_print: bool) -> int:  # noqa: A002 - the name that is shown in the help
    """Open the page of a system, job, recording, schedule or measurement; without an id, the first page."""
    where = client.url
    if id is not None:
        place = PLACES.get(id.partition("_")[0])
        if place is None:
            raise click.UsageError(f"ID must begin with {', '.join(f'{one}_' for one in PLACES)}, got {id!r}")
        where = f"{where}/{place}/{id.partition('@')[0]}"
    click.echo(where)
    return 0 if only_print else click.launch(where)
