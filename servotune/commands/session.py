"""`servotune login` and `logout`."""

from __future__ import annotations

import sys

import click

from servotune import profiles
from servotune.client import HERE, connect
from servotune.errors import ForbiddenError
from servotune.profiles import DEFAULT, Profile


@click.command
@click.option("--url", metavar="ADDRESS", envvar="SERVOTUNE_URL", help="The service; asked for unless given.")
@click.option(
    "--profile", default=DEFAULT, show_default=True, envvar="SERVOTUNE_PROFILE", help="The name to keep it under."
)
@click.option("--key-stdin", is_flag=True, help="Read the key from the standard input, as scripts do.")
def login(*, url: str | None, profile: str, key_stdin: bool) -> None:
    """Keep the address of a service and a key, for commands and scripts of this user.

    The key is tried first. `servotune serve` prints the first one when it starts for the first time.
    """
    address = url or click.prompt("Address of the service", default=HERE)
    key = sys.stdin.readline().strip() if key_stdin else click.prompt("API key", hide_input=True)
    with connect(address, key=key) as client:
        client.ready()
        try:
            next(client.systems.list(), None)
        except ForbiddenError:
            click.echo("This key is known, and may not read.", err=True)
    kept = profiles.save(profile, Profile(url=address, key=key))
    click.echo(f"Logged in to {address} as {profile!r}; the key is in {kept}.")


@click.command
@click.option("--profile", default=DEFAULT, show_default=True, envvar="SERVOTUNE_PROFILE", help="Which one.")
def logout(profile: str) -> int:
    """Forget the address and the key that `login` has kept."""
    if profiles.remove(profile):
        click.echo(f"Forgot {profile!r}. The key itself stays valid until it is revoked.")
        return 0
    known = ", ".join(profiles.names()) or "none"
    click.echo(f"servotune logout: there is no profile {profile!r}; there is {known}", err=True)
    return 1
