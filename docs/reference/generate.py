"""Write the page of the command line from the commands' own help, and the files that make the agent a service from its templates.

`make catalogue` runs it, a test compares what is there with it.
"""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import click

from agent.installing import Installed, Platform, content
from servotune.main import main, servotune

HERE = Path(__file__).parent
WIDTH = 100
NOTE = "<!-- Written by `make catalogue` from the commands' help: edit the code, not this page. -->\n"
HEAD = """# Command line

What each command says of itself with `--help`. [Commands](../commands.md) shows them at work, with the exit codes.
"""


def helps(
    command: click.Command, words: tuple[str, ...], parent: click.Context | None = None
) -> Iterator[tuple[str, str]]:
    """Return name and help of a command and of all below it."""
    context = click.Context(
        command,
        info_name=words[-1],
        parent=parent,
        terminal_width=WIDTH,
        max_content_width=WIDTH,
        **command.context_settings,
    )
    yield " ".join(words), command.get_help(context) if command.add_help_option or parent is None else asked(words[1:])
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            below = command.get_command(context, name)
            if below is not None and not below.hidden:
                yield from helps(below, (*words, name), context)


def asked(words: tuple[str, ...]) -> str:
    """Return what a command that reads its arguments itself prints as its help."""
    printed = io.StringIO()
    wide = mock.patch.dict(os.environ, {"COLUMNS": str(WIDTH)})
    with wide, contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
        main([*words, "--help"])
    return printed.getvalue()


def page() -> str:
    """Return the page."""
    parts = [NOTE, HEAD]
    for name, text in helps(servotune, ("servotune",)):
        parts += [f"{'#' * min(4, 1 + len(name.split()))} {name}\n", "```text", text.strip(), "```\n"]
    return "\n".join(parts)


def services() -> dict[str, str]:
    """Return what `servotune agent install` writes where everything is in its usual place: file below docs/deploy -> content."""
    linux = Installed(
        python="/opt/servotune/bin/python",
        settings="/etc/servotune/agent.toml",
        folder="/etc/servotune",
        spool="/var/lib/servotune-agent",
        stop=90,
    )
    windows = Installed(
        python=r"C:\servotune\Scripts\python.exe",
        settings=r"C:\ProgramData\Servotune\agent.toml",
        folder=r"C:\ProgramData\Servotune",
        spool=r"C:\ProgramData\Servotune\spool",
        stop=90,
    )
    given: list[tuple[str, Installed, Platform]] = [
        ("servotune-agent.service", linux, "linux"),
        ("servotune-agent.xml", windows, "windows"),
    ]
    return {name: content(installed, platform=platform) for name, installed, platform in given}


if __name__ == "__main__":
    (HERE / "cli.md").write_text(page())
    for name, text in services().items():
        (HERE.parent / "deploy" / name).write_text(text)
