"""The `servotune` command: finds its subcommands among the installed distributions, so that a lab PC needs no web framework.

A subcommand is an entry point of the group `servotune.commands`: a command of click, or a function that takes its arguments (without
its own name) and returns an exit code, the first line of whose docstring is its line in the help.

Exit codes: 0 done, 1 refused or failed, 2 asked for in a wrong way, 3 a package is missing, 4 the service does not answer,
130 interrupted.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from importlib.metadata import EntryPoint, PackageNotFoundError, entry_points, requires
from typing import Any, NamedTuple

import click

from servotune.errors import ServiceUnreachableError, ServotuneError

GROUP = "servotune.commands"

ELSEWHERE = {
    "servotune-server": (
        "serve",
        "worker",
        "openapi",
        "backup",
        "restore",
        "check",
        "migrate",
        "move",
        "move-blobs",
        "rig-simulator",
    ),
    "servotune-agent": ("agent",),
}
"""Distributions beside this one, and the commands that they bring."""

_REQUIREMENT = re.compile(r"""^([A-Za-z0-9._-]+)(?:.*;.*\bextra\s*==\s*['"]([^'"]+)['"])?""")
_IMPORTED_AS = {"grpc": "nidaqmx"}
"""Modules that come with a distribution of another name, as an extra of it."""
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
            for distribution, commands in ELSEWHERE.items():
                if args[0] in commands:
                    raise click.UsageError(f"{args[0]!r} comes with another package: pip install {distribution}", ctx)
            known = ", ".join(sorted(self._points)) or "none is installed"
            raise click.UsageError(f"there is no command {args[0]!r}; the commands are: {known}", ctx)
        return super().resolve_command(ctx, args)


def _plain(name: str, function: Any) -> click.Command:
    """Return a function that reads its arguments itself as a command."""

    @click.pass_context
    def run(context: click.Context) -> int:
        try:
            return int(function(context.args))
        except ModuleNotFoundError as error:  # of an extra: what needs it is imported when it is wanted
            click.echo(f"servotune {name}: {_missing(error)}", err=True)
            return 3

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
    except (OSError, ValueError) as error:
        click.echo(f"servotune: {error}", err=True)
        return 1
    except Exception as error:
        import httpx  # noqa: PLC0415 - the help and many commands need none

        if not isinstance(error, httpx.HTTPError):
            raise
        click.echo(f"servotune: {error}", err=True)
        return 1
    return done if isinstance(done, int) else 0


def _missing(error: ModuleNotFoundError) -> str:
    """Say which part of the installation brings the module that is missing."""
    module = (error.name or "").partition(".")[0]
    return f"needs the Python package {module!r}, which is not installed: {_cure(module)}"


def _cure(module: str) -> str:
    wanted = _normal(_IMPORTED_AS.get(module, module))
    for need in _needs():
        if need.name == wanted and need.extra:
            return f"pip install '{need.distribution}[{need.extra}]'"
        if need.name == wanted:
            return f"pip install --force-reinstall {need.distribution}"
    return f"pip install {module}" if module else "reinstall servotune"


class _Need(NamedTuple):
    """What one of our distributions declares, under an extra or always."""

    distribution: str
    name: str
    extra: str | None


def _needs() -> Iterator[_Need]:
    for distribution in ("servotune", *ELSEWHERE):
        try:
            declared = requires(distribution) or []
        except PackageNotFoundError:
            continue
        for text in declared:
            if match := _REQUIREMENT.match(text):
                yield _Need(distribution, _normal(match[1]), match[2])


def _normal(name: str) -> str:
    """Return a distribution's name as PEP 503 compares it."""
    return re.sub(r"[-_.]+", "-", name).lower()
