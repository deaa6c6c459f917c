"""What the agent needs of hardware: channels with their ranges, one clock for inputs and output, samples in order, rest at the end.

A driver is a subclass of `Driver`, named in the entry points of `servotune.drivers`. It raises `AttemptError` alone: a word for
programs, and a sentence that says what to do. The suite in tests/integration/drivers holds what is promised here.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from agent.data_sheets import DataSheet
from agent.drivers.synchronisation import Synchronisation, listed
from agent.errors import AttemptError
from agent.safety import Drive
from agent.settings import DaqSettings, DeviceSettings, InputSettings, OutputSettings

Samples = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """A channel that the hardware has; ``ranges`` are the largest magnitudes that it can be set to, none where it does not tell."""

    name: str
    direction: Literal["input", "output"]
    ranges: tuple[float, ...] = ()


class Running(ABC):
    """Inputs that are ready, and what they deliver once they are started."""

    rate: float
    """samples/s, as the hardware has it."""

    @abstractmethod
    def prepare(self, samples: int, drive: Drive | None) -> None:
        """Set the length of the run, and arm its drive, whose first sample is played with the first one of the inputs."""

    @abstractmethod
    def start(self) -> None:
        """Let inputs and drive begin; they have when it returns: the first sample is dated by it."""

    @abstractmethod
    def read(self) -> Samples:
        """Wait for the next samples and return them, shape (channels, n); n is 0 when the run is over, and never before.

        Raises
        ------
        AttemptError
            When a sample is missing, or none comes within the deadline.
        """

    @abstractmethod
    def halt(self) -> float | None:
        """Stop the drive, and return where its output stands then; None when nothing is driven. Nothing is raised."""


class Driver(ABC):
    """The hardware of a rig; made without a connection, which the first call makes.

    Parameters
    ----------
    settings : DaqSettings
        Of the class that ``settings`` names.
    rig : str
        Name of the rig.
    """

    settings: ClassVar[type[DaqSettings]]
    """The table ``[daq]`` of this driver."""
    kinds: ClassVar[tuple[str, ...]] = ("voltage",)
    """What an input's ``kind`` may be."""
    following: ClassVar[tuple[str, ...]] = ()
    """Kinds that have no clock of their own: they are measured beside another input only."""

    @abstractmethod
    def __init__(self, settings: Any, *, rig: str) -> None: ...

    @property
    @abstractmethod
    def description(self) -> str:
        """How the hardware is reached."""

    @abstractmethod
    def devices(self) -> list[dict[str, Any]]:
        """Return what is there: ``name``, ``model``, ``serial`` and whether it is ``simulated``.

        Raises
        ------
        AttemptError
            When the hardware cannot be reached.
        """

    @abstractmethod
    def channels(self) -> list[Channel]:
        """Return the channels that can be measured and driven.

        Raises
        ------
        AttemptError
            When the hardware cannot be reached.
        """

    @abstractmethod
    def rest(self, output: OutputSettings, *, level: float | None = None) -> None:
        """Bring an output to its safe value, softly where it is known where it stands.

        Raises
        ------
        AttemptError
            When the hardware does not answer: the output may stand anywhere.
        """

    @abstractmethod
    def run(self, inputs: Sequence[InputSettings], rate: float, *, seconds: float) -> AbstractContextManager[Running]:
        """Prepare the inputs; the rate that the hardware really has is then known.

        Parameters
        ----------
        rate : float
            samples/s that are asked for.
        seconds : float
            Length of the run, roughly.

        Raises
        ------
        AttemptError
            `unknown_channel`, `unsupported_setting`, with the name, the rule and the value.
        """

    def trial(self, inputs: Sequence[InputSettings], output: OutputSettings | None = None, *, rate: float) -> float:
        """Set some channels up as a run would and take them down again: nothing is started, and no output changes.

        Parameters
        ----------
        inputs : sequence of InputSettings
            At least one.
        rate : float
            samples/s that are asked for.

        Returns
        -------
        float
            samples/s that there would be.

        Raises
        ------
        AttemptError
            What a run would be refused with.
        """
        self.admit(inputs, output)
        with self.run(inputs, rate, seconds=1.0) as running:
            return running.rate

    def synchronisation(self, inputs: Sequence[InputSettings], output: OutputSettings | None = None) -> Synchronisation:
        """Say which channels share a sample clock: here all of them that of one controller, which also plays the output.

        Raises
        ------
        AttemptError
            When the hardware cannot be reached.
        """
        names = [entry.name for entry in inputs] + ([output.name] if output is not None else [])
        return Synchronisation(clock=listed([device["name"] for device in self.devices()]), channels=tuple(names))

    def data_sheet(self, entry: InputSettings) -> DataSheet | None:
        """Return what the sensor of an input says of itself; None where it has no data sheet that this hardware reads.

        Raises
        ------
        AttemptError
            For a data sheet that is there and cannot be read.
        """
        del entry
        return None

    def clean(self) -> None:  # noqa: B027 - most have nothing to clear
        """Clear what an earlier agent of this rig has left on the hardware."""

    def close(self) -> None:  # noqa: B027 - most have nothing to let go of
        """Let go of the hardware."""

    def check(self, expected: Sequence[DeviceSettings]) -> list[dict[str, Any]]:
        """Return the devices that are there, having made sure that they are the right ones.

        Raises
        ------
        AttemptError
            `unknown_device`, `wrong_device`.
        """
        found = self.devices()
        there = {device["name"]: device for device in found}
        for device in expected:
            got = there.get(device.name)
            if got is None:
                known = ", ".join(there) or "none"
                raise AttemptError(
                    "unknown_device", f"device {device.name} must be there ({known}): check cable and power"
                )
            for what in ("model", "serial"):
                wanted = getattr(device, what)
                if wanted and wanted.upper().lstrip("0") != got[what].upper().lstrip("0"):
                    raise AttemptError(
                        "wrong_device",
                        f"{what} of {device.name} must be {wanted}, got {got[what]}: the calibration is another one's",
                    )
        return found

    def admit(self, inputs: Sequence[InputSettings], output: OutputSettings | None = None) -> None:
        """Make sure that the hardware has some channels, and that they can be set to their ranges.

        Raises
        ------
        AttemptError
            `unknown_channel`, `unsupported_setting`, with the name, the rule and the value.
        """
        found = self.channels()
        asked = [(entry.name, "input", entry.channel, entry.range, entry.kind) for entry in inputs]
        if output is not None:
            asked.append((output.name, "output", output.channel, output.amplitude, "voltage"))
        for name, direction, channel, limit, kind in asked:
            there = {entry.name: entry.ranges for entry in found if entry.direction == direction}
            if channel not in there:
                raise _unknown(f"{direction} {name}", channel, [entry.name for entry in found], list(there))
            widest = max(there[channel], default=limit)
            if kind == "voltage" and limit > widest * (1 + 1e-9):
                what = "range" if direction == "input" else "amplitude"
                raise AttemptError(
                    "unsupported_setting", f"{direction} {name}: {what} must be at most {widest:g}, got {limit:g}"
                )


def _unknown(place: str, channel: str, all_: Sequence[str], known: Sequence[str]) -> AttemptError:
    """Return the error for a channel that there is not: the device is missing, or it has others."""
    device, slash, _ = channel.lstrip("/").partition("/")
    devices = {name.partition("/")[0] for name in all_ if "/" in name}
    if slash and device not in devices:
        there = ", ".join(sorted(devices)) or "none"
        return AttemptError(
            "unknown_device",
            f"{place}: device {device} of its channel {channel} must be there, the hardware has {there}",
            remedy="plug it in and switch it on, or correct `channel` in this entry",
        )
    others = [name for name in known if not slash or name.startswith(f"{device}/")]
    return AttemptError(
        "unknown_channel", f"{place}: channel must be one of {', '.join(others) or 'none'}, got {channel}"
    )
