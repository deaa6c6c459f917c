"""What commands are given as files: documents, requests, and where something is to be written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from servotune.targets import target_of


class Target(click.ParamType[Path]):
    """A file to write, judged before anything is asked of the service."""

    name = "file"

    def convert(self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return the path, or refuse it in words."""
        try:
            return target_of(value, "the file")
        except ValueError as error:
            self.fail(str(error), param, ctx)


def read_json(file: Path) -> dict[str, Any]:
    """Return the JSON object in a file.

    Raises
    ------
    click.UsageError
        It is none.
    """
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise click.UsageError(f"{file} must be JSON, got {error}") from error
    if not isinstance(found, dict):
        raise click.UsageError(f"{file} must be a JSON object, got {type(found).__name__}")
    return found


def system_of(given: str) -> str | dict[str, Any]:
    """Return a system as it is sent: a document where a file of this name is there, else an id."""
    return read_json(Path(given)) if Path(given).is_file() else given
