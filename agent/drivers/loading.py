"""Drivers by the name of their entry point: another package brings its own, and nothing here changes."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import TYPE_CHECKING

from agent.errors import SettingsError

if TYPE_CHECKING:
    from agent.drivers.interface import Driver

GROUP = "servotune.drivers"


def names() -> list[str]:
    """Return the names of all drivers that are installed, whether their libraries are or not."""
    return sorted({entry.name for entry in entry_points(group=GROUP)})


def load(name: str) -> type[Driver]:
    """Return the driver of a name.

    Raises
    ------
    SettingsError
        For a name that no driver has, and for a driver whose library is not installed.
    """
    found = list(entry_points(group=GROUP, name=name))
    if not found:
        raise SettingsError(f"daq.driver must be one of {', '.join(names())}, got {name!r}")
    try:
        driver: type[Driver] = found[0].load()
    except ImportError as error:
        raise SettingsError(
            f"daq.driver: {name} needs a library that is not installed ({error}): pip install 'servotune-agent[{name}]'"
        ) from error
    return driver
