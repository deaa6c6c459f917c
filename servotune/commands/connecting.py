"""What every command takes that asks a service: which one, who asks, and in which form the answer is wanted."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import click

from servotune.client import Client, connect


def asking(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of a connection, and the client as its first argument."""

    @click.option(
        "--url", metavar="ADDRESS", help="The service; else SERVOTUNE_URL, the profile's, http://127.0.0.1:8000."
    )
    @click.option(
        "--key", help="API key; else SERVOTUNE_KEY, the profile's. Others on this computer can see what is typed here."
    )
    @click.option("--profile", help="Of `servotune login`; else SERVOTUNE_PROFILE, default.")
    @functools.wraps(command)
    def connected(*, url: str | None, key: str | None, profile: str | None, **options: Any) -> Any:
        with connect(url, key=key, profile=profile) as client:
            return command(client, **options)

    return connected


def shown_as(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the option `--json`, handed to it as ``as_json``."""
    option = click.option("--json", "as_json", is_flag=True, help="Print JSON, as the service answered.")
    return option(command)


def print_json(value: Any) -> None:
    """Print a reply as the service gave it."""
    import json  # noqa: PLC0415 - only where asked for

    click.echo(json.dumps(value, indent=2, ensure_ascii=False))


def print_table(columns: Sequence[str], rows: Sequence[Sequence[Any]], *, nothing: str) -> None:
    """Print rows under their headings; one sentence where there are none."""
    if not rows:
        click.echo(nothing)
        return
    texts = [["" if cell is None else str(cell) for cell in row] for row in rows]
    # never cut, also where the terminal is too narrow: a part of an id is of no use to anybody
    widths = [max(map(len, column)) for column in zip(columns, *texts, strict=True)]
    click.secho(_line(columns, widths), bold=True)
    for row in texts:
        click.echo(_line(row, widths))


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    return "  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)).rstrip()


def client_for_completion(context: click.Context) -> Client:
    """Return the client that the command being completed would use; it must answer at once."""
    given = context.params
    return connect(given.get("url"), key=given.get("key"), profile=given.get("profile"), timeout=2.0, attempts=1)


def ids(kind: str) -> Callable[[click.Context, click.Parameter, str], list[Any]]:
    """Return what completes the id of a system, dataset or job; nothing where the service does not answer."""

    def complete(context: click.Context, _: click.Parameter, begun: str) -> list[Any]:
        from itertools import islice  # noqa: PLC0415 - as above

        from click.shell_completion import CompletionItem  # noqa: PLC0415 - as above

        try:
            with client_for_completion(context) as client:
                found = list(islice(getattr(client, kind).list(), 50))
        except Exception:  # noqa: BLE001 - a shell must never show why it completes nothing
            return []
        told: dict[str, Callable[[Any], str]] = {
            "systems": lambda one: one.name or "",
            "datasets": lambda one: one.name or "",
            "jobs": lambda one: f"{one.kind}, {one.status}",
        }
        return [CompletionItem(one.id, help=told[kind](one)) for one in found if one.id.startswith(begun)]

    return complete
