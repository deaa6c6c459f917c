"""Terminals and timing engines: who owns them, what their names are, and which task follows which."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from rig_simulator.devices import Device, Task
from rig_simulator.families import DEFAULT_CHASSIS, Family
from rig_simulator.faults import DriverError

_ANY = re.compile(r"(a[io]|d[io])/(sampleclock(timebase)?|starttrigger|referencetrigger|syncpulse)|syncpulse|pfi\d+")
"""Terminals of a device of no known family."""
_BUSY, _NO_TERMINAL, _NO_ROUTE = -50103, -89120, -89125
_PROPERTY, _SEVERAL, _NOT_RESERVED = -200452, -200558, -200983
_ENGINE = {"AO": "ao", "DI": "di", "DO": "do"}


def owner(devices: Mapping[str, Device], device: Device) -> Family | None:
    """Return the row of whoever owns the timing engines of a device: its chassis, or itself."""
    within = device.timed_by != device.name
    if within or (device.family is not None and device.family.in_chassis):
        chassis = devices.get(device.timed_by) if within else None
        return chassis.family if chassis is not None and chassis.family is not None else DEFAULT_CHASSIS
    return device.family


def names(device: Device) -> list[str]:
    """Return the terminals that are named by a device: of a module in a chassis its pins alone."""
    row = device.family
    own = row.terminals if row is not None else frozenset()
    return [f"/{device.name}/{name}" for name in sorted(own)]


def exists(devices: Mapping[str, Device], terminal: str) -> bool:
    """Say whether there is a terminal, however it is written."""
    if terminal.lower() == "onboardclock":
        return True
    first, _, rest = terminal.strip("/").lower().partition("/")
    for device in devices.values():
        if first == device.timed_by.lower():
            row = owner(devices, device)
            if bool(_ANY.fullmatch(rest)) if row is None else rest in {name.lower() for name in row.terminals}:
                return True
        own = device.family.terminals if device.family is not None else ()
        if first == device.name.lower() and rest in {name.lower() for name in own}:
            return True
    return False


def check(devices: Mapping[str, Device], task: Task) -> None:
    """Refuse channels of devices that nothing connects, and a clock, a timebase, a sync pulse or a trigger of no or such a device."""
    for entry in task.channels:
        if not connected(devices, task.device, entry.device):
            raise DriverError(_SEVERAL, f"Device: {entry.device}\nTask Name: {task.name}")
    for terminal in filter(None, (task.clock, task.timebase, task.sync_pulse, task.trigger)):
        if not exists(devices, terminal):
            raise DriverError(_NO_TERMINAL, f"Source Terminal: {terminal}\nTask Name: {task.name}")
        source = terminal.strip("/").partition("/")[0]
        if source.lower() != "onboardclock" and not connected(devices, source, task.device):
            raise DriverError(
                _NO_ROUTE, f"Source Device: {source}\nDestination Device: {task.device}\nTask Name: {task.name}"
            )


def connected(devices: Mapping[str, Device], first: str, second: str) -> bool:
    """Say whether clocks can go from one device to another: within a chassis, and over the trigger lines of PCI and PXI."""
    units = {devices[name].timed_by if name in devices else name for name in (first, second)}
    rows = [owner(devices, devices[name]) for name in (first, second) if name in devices]
    if len({unit.lower() for unit in units}) == 1 or None in rows:
        return True
    return any(all(f"{bus}0" in row.terminals for row in rows if row is not None) for bus in ("RTSI", "PXI_Trig"))


def terminal(devices: Mapping[str, Device], task: Task, what: str) -> str:
    """Return the name of a task's internal terminal: SampleClock, SampleClockTimebase, StartTrigger, SyncPulse.

    Raises
    ------
    DriverError
        Where the device has none, or names it only when a timing engine is reserved.
    """
    device = devices[task.device]
    row = owner(devices, device)
    engine = _ENGINE.get(task.kind, "")
    if task.kind == "AI":
        if row is not None and row.named_when_reserved and not task.engine:
            raise DriverError(_NOT_RESERVED, f"Task Name: {task.name}")
        engine = task.engine or "ai"
    name = f"{engine}/{what}"
    if row is not None and name not in row.terminals:
        name = what
        if what not in row.terminals:
            raise DriverError(_PROPERTY, f"Property: {what}\nTask Name: {task.name}")
    return f"/{device.timed_by}/{name}"


def reserve(devices: Mapping[str, Device], tasks: Mapping[str, Task], task: Task) -> None:
    """Give a task of analog inputs the first timing engine that is free."""
    row = owner(devices, devices[task.device])
    if task.kind != "AI" or task.engine or row is None:
        return
    place = devices[task.device].timed_by
    taken = {
        other.engine
        for other in tasks.values()
        if other is not task and other.kind == "AI" and devices[other.device].timed_by == place
    }
    free = [engine for engine in row.engines if engine not in taken]
    if not free:
        raise DriverError(_BUSY, f"Task Name: {task.name}")
    task.engine = free[0]


def leader(devices: Mapping[str, Device], tasks: Mapping[str, Task], task: Task) -> Task | None:
    """Return the task of inputs whose sample clock a task follows, by itself or by timebase, sync pulse and start."""
    for other in _inputs(tasks):
        if _same(devices, task.clock, other, "SampleClock"):
            return other
        shared = _same(devices, task.timebase, other, "SampleClockTimebase")
        if shared and _same(devices, task.sync_pulse, other, "SyncPulse") and started_by(devices, task, other):
            return other
    return None


def started_by(devices: Mapping[str, Device], task: Task, other: Task) -> bool:
    """Say whether a task begins when another one does."""
    return _same(devices, task.trigger, other, "StartTrigger")


def drifts(devices: Mapping[str, Device], task: Task, other: Task) -> bool:
    """Say whether two tasks with clocks of their own run apart: delta-sigma converters, or two devices, do."""
    first, second = devices[task.device], devices[other.device]
    row = first.family
    return first.timed_by != second.timed_by or (row is not None and row.output_clock == "timebase")


def _inputs(tasks: Mapping[str, Task]) -> Iterator[Task]:
    return (task for task in tasks.values() if task.kind == "AI")


def _same(devices: Mapping[str, Device], given: str, task: Task, what: str) -> bool:
    if not given:
        return False
    try:
        return given.strip("/").lower() == terminal(devices, task, what).strip("/").lower()
    except DriverError:
        return False
