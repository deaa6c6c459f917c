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


#: NI-DAQmx error -> our word, and what to do about it.
DRIVER_ERRORS = {
    -50103: ("device_busy", "another program uses the device: close it, or restart the device server"),
    -50405: ("device_gone", "the connection to the device has broken: check cable and power, then plug it in again"),
    -88705: ("device_gone", "the device is not there: check cable and power"),
    -88709: ("device_gone", "the device cannot be reached: check cable and power"),
    -200077: ("unsupported_setting", "the hardware cannot do that: change the sample rate or the range"),
    -200170: ("unknown_channel", "the device has no such channel: check `channel` in the agent's settings"),
    -200220: ("unknown_device", "there is no such device: check its name in the agent's settings, and its power"),
    -200279: ("overrun", "the PC could not read in time: lower the sample rate, or close other programs"),
    -200284: ("timeout", "no samples came in time: check the clock and the trigger of the device"),
    -200290: ("underrun", "the PC could not write the drive in time: lower the sample rate, or close other programs"),
    -200324: ("device_gone", "the device was removed while it worked: check cable and power"),
    -200547: ("drive_limit", "the drive leaves the range of the output"),
    -200621: ("underrun", "the PC could not write the drive in time: lower the sample rate, or close other programs"),
    -201003: ("device_gone", "the device cannot be accessed: check cable and power, then plug it in again"),
}


def of_driver(code: int, text: str) -> AttemptError:
    """Return the error that a number of the driver stands for."""
    word, advice = DRIVER_ERRORS.get(code, (f"daqmx_{abs(code)}", "look the number up in the manual of NI-DAQmx"))
    first = next((line.strip() for line in text.splitlines() if line.strip()), "the driver gave no reason")
    return AttemptError(word, f"NI-DAQmx {code}: {first} - {advice}")
