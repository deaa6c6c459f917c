"""`servotune optimize` and `identify`: a request in a file becomes a job."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from servotune.client import Client
from servotune.commands.connecting import asking, shown_as
from servotune.commands.jobs import start


def _from_a_file(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the file of its request, and how long it waits."""
    for add in (
        click.argument("request", type=click.Path(exists=True, dir_okay=False, path_type=Path)),
        click.option(
            "--wait/--no-wait", "waits", default=True, help="Whether to wait for the result; else print the job's id."
        ),
        click.option("--timeout", type=float, help="Longest time to wait, s; the job goes on running."),
        shown_as,
    ):
        command = add(command)
    return command


@click.command
@_from_a_file
@asking
def optimize(client: Client, *, request: Path, waits: bool, timeout: float | None, as_json: bool) -> int:
    """Search for the best parameters: REQUEST is a file with the body of POST /v1/optimizations."""
    return start(client, "optimization", request, waits=waits, timeout=timeout, as_json=as_json)


@click.command
@_from_a_file
@asking
def identify(client: Client, *, request: Path, waits: bool, timeout: float | None, as_json: bool) -> int:
    """Fit parameters to recordings: REQUEST is a file with the body of POST /v1/identifications."""
    return start(client, "identification", request, waits=waits, timeout=timeout, as_json=as_json)
