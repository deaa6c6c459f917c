"""Properties of the driver by their numbers, for both front doors: what a client of nidaqmx reads and sets."""

from __future__ import annotations

from collections.abc import Callable

from rig_simulator.bench import Bench
from rig_simulator.devices import FINITE, Channel, Device, Task
from rig_simulator.faults import DriverError

Value = float | int | str | bool | list[float]

_VERSION = {0x1272: 24, 0x1923: 5, 0x2F22: 0}
_INPUT, _OUTPUT = 10100, 10102

_DEVICE: dict[int, Callable[[Device], Value]] = {
    0x0631: lambda d: d.model,
    0x0632: lambda d: d.serial,
    0x22CA: lambda _: True,  # a simulated device, as a driver's own simulated ones say it
    0x231E: lambda d: ", ".join(f"{d.name}/ai{i}" for i in range(d.inputs)),
    0x231F: lambda d: ", ".join(f"{d.name}/ao{i}" for i in range(d.outputs)),
    0x298C: lambda d: d.max_rate,
    0x298D: lambda d: d.max_rate,
    0x2990: lambda d: [-d.converter.range, d.converter.range],
}
_TASK: dict[tuple[str, int], Callable[[Bench, Task], Value]] = {
    ("Task", 0x1276): lambda _, t: t.name,
    ("Task", 0x1273): lambda _, t: ", ".join(c.name for c in t.channels),
    ("Task", 0x2181): lambda _, t: len(t.channels),
    ("Task", 0x230E): lambda _, t: ", ".join(dict.fromkeys(c.device for c in t.channels)),
    ("Task", 0x1274): lambda b, t: b.done(t),
    ("Read", 0x1823): lambda _, t: ", ".join(c.name for c in t.channels),
    ("Read", 0x1223): lambda b, t: b.available(t),
    ("Read", 0x193A): lambda b, t: b.acquired(t),
    ("Read", 0x1221): lambda _, t: t.read,
    ("Read", 0x217B): lambda _, t: len(t.channels),
    ("Read", 0x31E8): lambda b, t: t.samples if t.mode == FINITE else b.available(t),
    ("Read", 0x190A): lambda _, __: -1,
    ("Read", 0x1A36): lambda _, __: False,
    ("Read", 0x2174): lambda _, __: False,
    ("Write", 0x217E): lambda _, t: len(t.channels),
    ("Write", 0x192B): lambda b, t: b.acquired(t),
    ("Write", 0x1453): lambda _, t: 10097 if t.regenerates else 10158,
    ("Timing", 0x1344): lambda _, t: t.rate,
    ("Timing", 0x1300): lambda _, t: t.mode or FINITE,
    ("Timing", 0x1310): lambda _, t: t.samples,
    ("Timing", 0x2F1B): lambda b, t: b.terminal(t, "SampleClock"),
    ("Timing", 0x1852): lambda _, t: t.clock,
    ("Buffer", 0x186C): lambda b, t: b.buffer_of(t),
    ("Trig", 0x2F1E): lambda b, t: b.terminal(t, "StartTrigger"),
    ("Trig", 0x1407): lambda _, t: t.trigger,
}
_CHANNEL: dict[int, Callable[[Channel], Value]] = {
    0x187F: lambda c: _INPUT if c.kind == "AI" else _OUTPUT,
    0x0695: lambda c: c.usage,
    0x18F5: lambda c: c.physical,
    0x17DD: lambda c: c.upper,
    0x17DE: lambda c: c.lower,
}
REGENERATION = 0x1453
_ALLOWED = 10097


def get(bench: Bench, family: str, owner: str, attribute: int, *, channel: str = "") -> Value:
    """Return a property.

    Parameters
    ----------
    family : str
        "SystemInfo", "Device", "Task", "Chan", "Read", "Write", "Timing", "Buffer", "Trig".
    owner : str
        Name of the device or the task.

    Raises
    ------
    DriverError
        For a property that this simulation does not have.
    """
    if family == "SystemInfo":
        if attribute == 0x193B:
            return ", ".join(name for name, device in bench.devices.items() if device.present)
        if attribute in _VERSION:
            return _VERSION[attribute]
    elif family == "Device":
        if attribute in _DEVICE:
            return _DEVICE[attribute](bench.device(owner))
    else:
        task = bench.task(owner)
        kept = task.attributes.get((family, channel, attribute))
        if kept is not None:
            return kept
        if family == "Chan" and attribute in _CHANNEL:
            names = {entry.name: entry for entry in task.channels}
            if channel in names:
                return _CHANNEL[attribute](names[channel])
        elif (family, attribute) in _TASK:
            return _TASK[family, attribute](bench, task)
    raise DriverError(-200452, f"Property: {family} attribute {attribute:#06x}")


def put(bench: Bench, family: str, owner: str, attribute: int, value: float | str, *, channel: str = "") -> None:
    """Set a property of a task."""
    task = bench.task(owner)
    if family == "Buffer" and attribute == 0x186C:
        task.buffer = int(value)
    elif family == "Timing" and attribute == 0x1344:
        task.rate = bench.device(task.device).coerce(float(value))
    elif family == "Write" and attribute == REGENERATION:
        task.regenerates = int(value) == _ALLOWED
    else:
        task.attributes[family, channel, attribute] = value
