"""The `servotune` command: finds its subcommands among the installed distributions, so that a lab PC needs no web framework.

A subcommand is an entry point of the group `servotune.commands`: a function that takes its arguments (without its own name) and
returns an exit code; the first line of its docstring is its line in the help.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import EntryPoint, PackageNotFoundError, entry_points, requires, version
from typing import cast

GROUP = "servotune.commands"

Command = Callable[[Sequence[str]], int]

_REQUIREMENT = re.compile(r"""^([A-Za-z0-9._-]+).*;.*\bextra\s*==\s*['"]([^'"]+)['"]""")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand and return its exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    commands = {point.name: point for point in entry_points(group=GROUP)}
    if not given or given[0] in ("-h", "--help", "help"):
        _say(_help(commands))
        return 0
    if given[0] in ("-V", "--version"):
        _say(f"servotune {_version()}")
        return 0
    name, *rest = given
    if name not in commands:
        known = ", ".join(sorted(commands)) or "none is installed"
        _complain(f"servotune: there is no command {name!r}; the commands are: {known}")
        return 2
    try:
        command = _load(commands[name])
        return command(rest)
    except ModuleNotFoundError as error:
        _complain(f"servotune {name}: {_missing(error)}")
        return 3
    except KeyboardInterrupt:
        return 130


def _load(point: EntryPoint) -> Command:
    return cast("Command", point.load())


def _help(commands: Mapping[str, EntryPoint]) -> str:
    lines = ["usage: servotune <command> [options]", "", "commands:"]
    lines += [f"  {name:<12} {_summary(point)}" for name, point in sorted(commands.items())]
    lines += ["", "options:", "  --version    print the version", "", "`servotune <command> --help` tells its options."]
    return "\n".join(lines)


def _summary(point: EntryPoint) -> str:
    try:
        documentation = inspect.getdoc(_load(point)) or ""
    except ModuleNotFoundError as error:
        return _missing(error)
    return documentation.partition("\n")[0]


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


def _version() -> str:
    try:
        return version("servotune")
    except PackageNotFoundError:
        return "not installed"


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")


def _complain(text: str) -> None:
    sys.stderr.write(f"{text}\n")
