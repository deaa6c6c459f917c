"""What can go wrong on a rig, each with a word for programs and a sentence for people that says what to do."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


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
    what, remedy : str
        The two parts of it, where they are known apart; else ``remedy`` is empty.
    """

    def __init__(self, code: str, what: str, *, remedy: str = "") -> None:
        self.code, self.what, self.remedy = code, what, remedy
        self.detail = f"{what} - {remedy}" if remedy else what
        super().__init__(self.detail)


@contextmanager
def about(what: str) -> Iterator[None]:
    """Let the refusal of a setting begin with what it is about."""
    try:
        yield
    except AttemptError as error:
        if error.code != "unsupported_setting":
            raise
        raise AttemptError(error.code, f"{what}: {error.what}", remedy=error.remedy) from error
