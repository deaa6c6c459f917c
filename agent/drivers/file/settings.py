"""The table [daq] of a folder that another program writes."""

from __future__ import annotations

from dataclasses import dataclass

from agent.errors import SettingsError
from agent.settings import DaqSettings

FORMATS = ("npy", "csv")


@dataclass(frozen=True, slots=True, kw_only=True)
class FileSettings(DaqSettings):
    """Where the folder is, and which of the ``FORMATS`` the program is to write."""

    folder: str = ""
    format: str = "npy"

    def check(self) -> None:
        """Make sure that the values make sense."""
        DaqSettings.check(self)  # a dataclass with slots is made anew: super() would mean the first one
        if not self.folder:
            raise SettingsError("daq.folder must be given: the folder that the other program writes")
        if self.format not in FORMATS:
            raise SettingsError(f"daq.format must be one of {', '.join(FORMATS)}, got {self.format!r}")
