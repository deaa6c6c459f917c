"""What NI-DAQmx and its device server complain about becomes a word for programs and a sentence that says what to do."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from nidaqmx.errors import DaqError, DaqNotFoundError, DaqNotSupportedError, RpcError

from agent.errors import AttemptError

_READ_LATE = ("overrun", "the PC could not read in time: lower the sample rate, or close other programs")
_WRITTEN_LATE = (
    "underrun",
    "the PC could not write the drive in time: lower the sample rate, or close other programs",
)
_GONE = ("device_gone", "the device is not there any more: check cable and power, then plug it in again")
_OFF_LINE = ("device_gone", "the device cannot be reached over the network: check cable, power and its address")
_ROUTE = (
    "no_route",
    (
        "the hardware cannot lead clock or trigger to the output: put both modules into one chassis. "
        "Where `clock` and `trigger` are set in [daq], name terminals that the device has, or leave them out"
    ),
)

#: NI-DAQmx error -> our word, and what to do about it.
DRIVER_ERRORS = {
    -50103: ("device_busy", "another program uses the device: close it, or restart the device server"),
    -50352: ("out_of_memory", "the PC has no memory for the driver's buffers: close other programs, or measure less"),
    -50405: _GONE,
    -50808: _GONE,
    -88705: _GONE,
    -88709: ("aborted", "the driver has stopped the run: reset the device, then try again"),
    -89120: _ROUTE,
    -89125: _ROUTE,
    -89130: _GONE,
    -89136: _ROUTE,
    -89137: ("device_busy", "another program uses the lines that clock or trigger need: close it"),
    -200010: _READ_LATE,
    -200016: _WRITTEN_LATE,
    -200018: _WRITTEN_LATE,
    -200019: _READ_LATE,
    -200045: _GONE,
    -200077: (
        "unsupported_setting",
        "the hardware cannot do that: take one of its values (sample rate, `range`, `wiring`, `excitation`, `bridge`)",
    ),
    -200170: ("unknown_channel", "the device has no such channel: check `channel` in the agent's settings"),
    -200175: _GONE,
    -200194: ("device_gone", "the device lost its power for a moment: check its supply"),
    -200195: ("overload", "an output delivers more power than it can: check what is connected to it"),
    -200197: ("unsupported_setting", "the device does not know this property: check `kind` of the channel"),
    -200220: ("unknown_device", "there is no such device: check its name in the agent's settings, and its power"),
    -200222: _READ_LATE,
    -200246: ("clock_lost", "the device has lost the clock that it follows: check its reference and the cables"),
    -200279: _READ_LATE,
    -200284: ("timeout", "no samples came in time: check the clock and the trigger of the device"),
    -200290: _WRITTEN_LATE,
    -200303: ("unsupported_setting", "the channel has no clock of its own: measure an analog input of the device, too"),
    -200324: _GONE,
    -200361: _READ_LATE,
    -200431: ("unsupported_setting", "the channel cannot measure that: check `kind` and `channel` in the settings"),
    -200432: ("unsupported_setting", "the channel cannot give that: check `kind` and `channel` of the output"),
    -200452: ("unsupported_setting", "the device does not have this property: check `kind` of the channel"),
    -200474: ("timeout", "the device did not finish in time: check clock and trigger"),
    -200490: ("drive_limit", "the drive leaves the range of the output: check `amplitude` in the agent's settings"),
    -200560: ("timeout", "the output did not come to its end in time: check its clock and trigger"),
    -200561: ("drive_limit", "the drive leaves the range of the output: check `amplitude` in the agent's settings"),
    -200621: _WRITTEN_LATE,
    -200709: (
        "no_teds",
        "no sensor answers with a data sheet: check the cable; the agent takes sensitivities from its settings",
    ),
    -200741: (
        "no_teds",
        "the device cannot read the data sheet of a sensor; the agent takes sensitivities from its settings",
    ),
    -200742: (
        "no_teds",
        "the data sheet in the sensor is damaged: see to the sensor; the agent takes sensitivities from its settings",
    ),
    -200826: (
        "no_teds",
        "the data sheet in the sensor cannot be read: check the cable; the agent takes sensitivities from its settings",
    ),
    -200762: (
        "no_route",
        "the output follows the inputs' timebase and finds no sync pulse: put both modules into one chassis",
    ),
    -200983: (
        "unsupported_setting",
        "the driver names the clock of the inputs too late: set `clock` and `trigger` in [daq]",
    ),
    -201003: _GONE,
    -201105: ("device_busy", "another program uses the device with other settings: close it"),
    -201250: _OFF_LINE,
    -201252: _OFF_LINE,
    -201253: _OFF_LINE,
    -201273: ("device_busy", "another PC uses the device: let it go there"),
    -201390: _OFF_LINE,
    -201420: ("device_busy", "another PC has reserved the device: let it go there"),
}

WITHOUT_SHEET = frozenset({-200709, -200741})
"""No sensor with a data sheet is connected, and a device that reads none: most are so."""
_TELLING = ("Property:", "Requested Value:", "Possible Values:", "You Can Select:", "Maximum Value:", "Minimum Value:")
"""Lines of a driver's message that say which value is wrong, and which are right."""
_UNREACHABLE = (
    "server_unreachable",
    "the device server does not answer: see whether it runs, and whether the network reaches it",
)

#: Name of a gRPC status -> our word, and what to do about it; all others mean that nobody answers.
SERVER_ERRORS = {
    "UNIMPLEMENTED": ("server_too_old", "the device server does not know this call: install a newer one"),
    "RESOURCE_EXHAUSTED": ("server_overloaded", "the device server has no room for this: lower `chunk` in [daq]"),
    "UNAUTHENTICATED": (
        "server_refuses",
        "the device server lets nobody in without a certificate: allow this PC there",
    ),
    "PERMISSION_DENIED": ("server_refuses", "the device server does not let this PC in: allow it there"),
    "NOT_FOUND": (
        "server_restarted",
        "the device server has forgotten the run: it was restarted or reset while it measured",
    ),
    "FAILED_PRECONDITION": (
        "server_restarted",
        "the device server has forgotten the run: it was restarted or reset while it measured",
    ),
}


def of_server(status: str, text: str) -> AttemptError:
    """Return the error that the name of a gRPC status stands for."""
    word, advice = SERVER_ERRORS.get(status, _UNREACHABLE)
    return AttemptError(word, f"{advice} ({status}: {text})")


def of_driver(code: int, text: str) -> AttemptError:
    """Return the error that a number of the driver stands for."""
    word, advice = DRIVER_ERRORS.get(code, (f"daqmx_{abs(code)}", "look the number up in the manual of NI-DAQmx"))
    lines = [line.strip() for line in text.splitlines() if line.strip()] or ["the driver gave no reason"]
    told = "; ".join([lines[0], *(line for line in lines[1:] if line.startswith(_TELLING))])
    return AttemptError(word, f"NI-DAQmx {code}: {told}", remedy=advice)


@contextmanager
def translated(about: str = "") -> Iterator[None]:
    """Turn what nidaqmx raises into a word and a sentence, which begins with what it is ``about``."""
    try:
        yield
    except (DaqNotFoundError, DaqNotSupportedError) as error:
        detail = "NI-DAQmx must be installed on this PC, or daq.server name an NI gRPC Device Server"
        raise AttemptError("no_driver", detail) from error
    except RpcError as error:
        raise of_server(getattr(error.rpc_code, "name", str(error.rpc_code)), error.description) from error
    except DaqError as error:
        found = of_driver(int(error.error_code), str(error))
        what = f"{about}: {found.what}" if about else found.what
        raise AttemptError(found.code, what, remedy=found.remedy) from error
