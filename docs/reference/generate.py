"""Write the page of the command line from the commands' own help; `make catalogue` runs it, a test compares the page with it."""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import click

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


if __name__ == "__main__":
    (HERE / "cli.md").write_text(page())
