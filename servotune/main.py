"""The `servotune` command: finds its subcommands among the installed distributions, so that a lab PC needs no web framework.

A subcommand is an entry point of the group `servotune.commands`: a command of click, or a function that takes its arguments (without
its own name) and returns an exit code, the first line of whose docstring is its line in the help.

Exit codes: 0 done, 1 refused or failed, 2 asked for in a wrong way, 3 a package is missing, 4 the service does not answer,
130 interrupted.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from importlib.metadata import EntryPoint, PackageNotFoundError, entry_points, requires
from typing import Any

import click
import httpx

from servotune.errors import ServiceUnreachableError, ServotuneError

GROUP = "servotune.commands"

_REQUIREMENT = re.compile(r"""^([A-Za-z0-9._-]+).*;.*\bextra\s*==\s*['"]([^'"]+)['"]""")
_AS_GIVEN = {"ignore_unknown_options": True, "allow_extra_args": True, "help_option_names": []}


class _Commands(click.Group):
    """The installed commands; each is loaded when it is asked for."""

    @cached_property
    def _points(self) -> Mapping[str, EntryPoint]:
        return {point.name: point for point in entry_points(group=GROUP)}

    def list_commands(self, ctx: click.Context) -> list[str]:
        del ctx
        return sorted(self._points)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        del ctx
        if cmd_name not in self._points:
            return None
        try:
            found = self._points[cmd_name].load()
        except ModuleNotFoundError as error:
            return _broken(cmd_name, _missing(error))
        return found if isinstance(found, click.Command) else _plain(cmd_name, found)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that is asked for, or tell the known ones."""
        if args and args[0] not in self._points:
            known = ", ".join(sorted(self._points)) or "none is installed"
            raise click.UsageError(f"there is no command {args[0]!r}; the commands are: {known}", ctx)
        return super().resolve_command(ctx, args)


def _plain(name: str, function: Any) -> click.Command:
    """Return a function that reads its arguments itself as a command."""

    @click.pass_context
    def run(context: click.Context) -> int:
        return int(function(context.args))

    summary = (inspect.getdoc(function) or "").partition("\n")[0]
    return click.Command(name, callback=run, short_help=summary, context_settings=_AS_GIVEN, add_help_option=False)


def _broken(name: str, why: str) -> click.Command:
    """Return a command that says what is missing."""

    @click.pass_context
    def run(context: click.Context) -> int:
        del context
        click.echo(f"servotune {name}: {why}", err=True)
        return 3

    return click.Command(name, callback=run, short_help=why, context_settings=_AS_GIVEN, add_help_option=False)


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(None, "-V", "--version", package_name="servotune", message="%(prog)s %(version)s")
def servotune() -> None:
    """Simulate, identify and optimise servo drives through a Servotune service, and run one."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand and return its exit code."""
    given = None if arguments is None else list(arguments)
    try:
        done = servotune.main(given, prog_name="servotune", standalone_mode=False)
    except click.Abort:
        return 130
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except ServotuneError as error:
        click.echo(f"servotune: {error}", err=True)
        return 4 if isinstance(error, ServiceUnreachableError) else 1
    except (OSError, ValueError, httpx.HTTPError) as error:
        click.echo(f"servotune: {error}", err=True)
        return 1
    return done if isinstance(done, int) else 0


def _missing(error: ModuleNotFoundError) -> str:
    """Say which optional part of the installation brings the module that is missing."""
    module = (error.name or "").partition(".")[0]
    extra = _extra_with(module)
    cure = (
        f"pip install 'servotune[{extra}]'" if extra else f"pip install {module}" if module else "reinstall servotune"
    )
    return f"needs the Python package {module!r}, which is not installed: {cure}"


def _extra_with(module: str) -> str | None:
    try:
        requirements = requires("servotune") or []
    except PackageNotFoundError:
        return None
    for requirement in requirements:
        match = _REQUIREMENT.match(requirement)
        if match and _normal(match[1]) == _normal(module):
            return match[2]
    return None


def _normal(name: str) -> str:
    """Return a distribution's name as PEP 503 compares it."""
    return re.sub(r"[-_.]+", "-", name).lower()
