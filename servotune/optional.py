"""Libraries that a script may or may not have: what needs one says how to get it."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def needed(module: str, what: str) -> Any:
    """Return an optional library.

    Raises
    ------
    ModuleNotFoundError
        It is not installed.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        package = module.partition(".")[0]
        raise ModuleNotFoundError(f"{what} needs {package}: pip install {package}", name=package) from error
