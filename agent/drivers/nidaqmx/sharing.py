"""One sample clock for all channels of a run: whose it is, who follows it, and what is said where devices cannot share one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from nidaqmx.errors import DaqError

from agent.drivers.nidaqmx.errors import of_driver
from agent.drivers.nidaqmx.inputs import FOLLOWERS
from agent.drivers.synchronisation import Synchronisation, listed
from agent.errors import AttemptError
from agent.settings import InputSettings, OutputSettings

_NOT_TOGETHER = frozenset({-200558, -200853, -200854, -201207, -201444, -89120, -89125, -89136, -89139})
"""MULTI_DEVS_IN_TASK, those of tasks with several devices, and routes that there are not."""


def unit_of(device: Any) -> str:
    """Return the chassis of a module, of any other device itself: whatever has one timing engine for all its channels."""
    try:
        chassis = str(device.compact_daq_chassis_device.name)
    except DaqError:  # no module of a chassis
        chassis = ""
    return chassis or str(device.name)


def led(inputs: Sequence[InputSettings]) -> list[InputSettings]:
    """Return the analog inputs, whose clock all others follow.

    Raises
    ------
    AttemptError
        `unsupported_setting`, where there are none.
    """
    analog = [entry for entry in inputs if entry.kind not in FOLLOWERS]
    if not analog:
        detail = "an analog input must be measured, too: encoders, counters and digital lines take their samples by its clock"
        raise AttemptError("unsupported_setting", detail)
    return analog


def synchronised(
    device_of: Callable[[str], Any], inputs: Sequence[InputSettings], output: OutputSettings | None
) -> Synchronisation:
    """Say whose clock a run has, which channels are led to it, and which are taken in turn."""
    analog = led(inputs)
    devices = {entry.channel.strip("/").partition("/")[0]: device_of(entry.channel) for entry in analog}
    used = Counter(entry.channel.strip("/").partition("/")[0] for entry in analog)
    in_turn = {
        name for name, device in devices.items() if used[name] > 1 and not device.ai_simultaneous_sampling_supported
    }
    following = [entry.name for entry in inputs if entry.kind in FOLLOWERS]
    driven = [output.name] if output is not None else []
    return Synchronisation(
        clock=listed(list(dict.fromkeys(unit_of(device) for device in devices.values()))),
        channels=(*(entry.name for entry in inputs), *driven),
        following=(*following, *driven),
        in_turn=tuple(entry.name for entry in analog if entry.channel.strip("/").partition("/")[0] in in_turn),
    )


@contextmanager
def one_clock(device_of: Callable[[str], Any], entries: Sequence[InputSettings | OutputSettings]) -> Iterator[None]:
    """Tell of devices that cannot share a sample clock by their names, and what to do."""
    try:
        yield
    except DaqError as error:
        if int(error.error_code) not in _NOT_TOGETHER:
            raise
        units: dict[str, list[str]] = {}
        for entry in entries:
            units.setdefault(unit_of(device_of(entry.channel)), []).append(entry.name)
        if len(units) < 2:
            raise
        told = listed([f"{unit} ({', '.join(names)})" for unit, names in units.items()])
        raise AttemptError(
            "no_common_clock",
            f"{told} must share a sample clock, which nothing leads from one to the other "
            f"({of_driver(int(error.error_code), str(error)).what})",
            remedy="measure their channels one after the other, or take modules of one chassis",
        ) from error
