"""What can go wrong on a rig, each with a word for programs and a sentence for people that says what to do."""

from __future__ import annotations


class SettingsError(ValueError):
    """The settings of the agent make no sense; the message names the place, the rule and the value."""


class AttemptError(Exception):
    """An attempt that cannot go on.

    Attributes
    ----------
    code : str
        A word: `overrun`, `device_gone`, `server_unreachable`, `drive_limit`, `disk_full`, `lease_lost` ...
    detail : str
        What happened, and what to do.
    """

    def __init__(self, code: str, detail: str) -> None:
        super().__init__(detail)
        self.code = code
        self.detail = detail
