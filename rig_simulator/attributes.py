"""Properties of the driver by their numbers, for both front doors: what a client of nidaqmx reads and sets."""

from __future__ import annotations

from collections.abc import Callable

from rig_simulator import checks, routing
from rig_simulator.bench import Bench
from rig_simulator.devices import FINITE, Channel, Device, Task
from rig_simulator.faults import DriverError
from rig_simulator.sensors import Teds

Value = float | int | str | bool | bytes | list[float] | list[int]

_VERSION = {0x1272: 24, 0x1923: 5, 0x2F22: 0}

_DEVICE: dict[int, Callable[[Device], Value]] = {
    0x0631: lambda d: d.model,
    0x0632: lambda d: d.serial,
    0x22CA: lambda _: True,  # a simulated device, as a driver's own simulated ones say it
    0x231E: lambda d: ", ".join(f"{d.name}/ai{i}" for i in range(d.inputs)),
    0x231F: lambda d: ", ".join(f"{d.name}/ao{i}" for i in range(d.outputs)),
    0x2324: lambda d: ", ".join(f"{d.name}/ctr{i}" for i in range(_counters(d))),
    0x2320: lambda d: ", ".join(f"{d.name}/port0/line{i}" for i in range(_lines(d, "digital input"))),
    0x2322: lambda d: ", ".join(f"{d.name}/port0/line{i}" for i in range(_lines(d, "digital output"))),
    0x298C: lambda d: d.family.input_rate if d.family else d.max_rate,
    0x298D: lambda d: d.family.input_rate if d.family else d.max_rate,
    0x2984: lambda d: bool(d.family and d.family.analog_trigger),
    0x298F: lambda d: not (d.family and d.family.multiplexed),
    0x2990: lambda d: _ranges(d, "voltage"),
    0x2991: lambda d: _ranges(d, "current"),
    0x2994: lambda d: sum({"AC": 1, "DC": 2}[name] for name in d.family.couplings) if d.family else 3,
    0x2996: lambda d: d.family.output_clock != "none" if d.family else bool(d.outputs),
    0x299B: lambda d: _span(d, "output voltage"),
    0x299C: lambda d: _span(d, "output current"),
    0x29B7: lambda d: d.timed_by if d.timed_by != d.name else "",
    0x2A40: lambda d: ", ".join(routing.names(d)),
    0x2FD0: lambda d: _ranges(d, "bridge"),
}


def _counters(device: Device) -> int:
    row = device.family
    return row.counters if row and row.kinds & {"encoder", "edges"} else 0


def _lines(device: Device, kind: str) -> int:
    row = device.family
    return row.lines if row and kind in row.kinds else 0


def _ranges(device: Device, kind: str) -> list[float]:
    """Return pairs of lowest and highest values of a kind of input, as the driver lists them."""
    row = device.family
    if row is None:
        assert device.converter is not None  # every device has one
        return [-device.converter.range, device.converter.range] if kind == "voltage" else []
    if kind not in row.kinds or (kind == "current" and "voltage" in row.kinds):
        return []
    return [limit for most in row.ranges for limit in (-most, most)]


def _span(device: Device, kind: str) -> list[float]:
    row = device.family
    if row is None:
        return [-10.0, 10.0] if kind == "output voltage" and device.outputs else []
    return [float(limit) for limit in row.output_range] if kind in row.kinds else []


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
    ("Timing", 0x2F1C): lambda b, t: b.terminal(t, "SampleClockTimebase"),
    ("Timing", 0x2F85): lambda b, t: b.terminal(t, "SyncPulse"),
    ("Timing", 0x1308): lambda _, t: t.timebase,
    ("Timing", 0x223D): lambda _, t: t.sync_pulse,
    ("Buffer", 0x186C): lambda b, t: b.buffer_of(t),
    ("Trig", 0x2F1E): lambda b, t: b.terminal(t, "StartTrigger"),
    ("Trig", 0x1407): lambda _, t: t.trigger,
}
_CHANNEL: dict[int, Callable[[Channel], Value]] = {
    0x187F: lambda c: {"AI": 10100, "AO": 10102, "DI": 10151, "DO": 10153, "CI": 10131}[c.kind],
    0x0695: lambda c: c.usage,
    0x18F5: lambda c: c.physical,
    0x17DD: lambda c: c.upper,
    0x17DE: lambda c: c.lower,
}
REGENERATION, _COUPLING = 0x1453, 0x0064
_TIMEBASE, _SYNC_PULSE = 0x1308, 0x223D
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
    if family == "PhysicalChan":
        return _of_sheet(data_sheet(bench, owner), attribute)
    found: Value | None = None
    if family == "SystemInfo":
        found = _system(bench, attribute)
    elif family == "Device":
        found = _DEVICE[attribute](bench.device(owner)) if attribute in _DEVICE else None
    else:
        found = _of_task(bench, bench.task(owner), family, attribute, channel)
    if found is None:
        raise DriverError(-200452, f"Property: {family} attribute {attribute:#06x}")
    return found


def _system(bench: Bench, attribute: int) -> Value | None:
    if attribute == 0x193B:
        return ", ".join(name for name, device in bench.devices.items() if device.present)
    return _VERSION.get(attribute)


def _of_task(bench: Bench, task: Task, family: str, attribute: int, channel: str) -> Value | None:
    kept = task.attributes.get((family, channel, attribute))
    if kept is not None:
        return kept
    if family == "Chan":
        entry = next((entry for entry in task.channels if entry.name == channel), None)
        return _CHANNEL[attribute](entry) if entry is not None and attribute in _CHANNEL else None
    return _TASK[family, attribute](bench, task) if (family, attribute) in _TASK else None


def data_sheet(bench: Bench, physical: str) -> Teds:
    """Return the data sheet in the sensor at an input.

    Raises
    ------
    DriverError
        For a device that reads none, and for a sensor without one.
    """
    device = bench.device(physical.partition("/")[0])
    if device.family is None or not device.family.teds:
        raise DriverError(-200741, f"Physical Channel Name: {physical}")
    sheet = bench.sensors[physical].teds if physical in bench.sensors else None
    if sheet is None:
        raise DriverError(-200709, f"Physical Channel Name: {physical}")
    return sheet


def _of_sheet(sheet: Teds, attribute: int) -> Value:
    known: dict[int, Value] = {
        0x21DA: sheet.manufacturer,
        0x21DB: sheet.model,
        0x21DC: sheet.serial,
        0x21DD: sheet.version,
        0x21DE: sheet.letter,
        0x21DF: sheet.bits(),
        0x228F: [sheet.template],
    }
    if attribute not in known:
        raise DriverError(-200452, f"Property: PhysicalChan attribute {attribute:#06x}")
    return known[attribute]


def put(bench: Bench, family: str, owner: str, attribute: int, value: float | str, *, channel: str = "") -> None:
    """Set a property of a task."""
    task = bench.task(owner)
    if family == "Buffer" and attribute == 0x186C:
        task.buffer = int(value)
    elif family == "Timing" and attribute == 0x1344:
        task.asked = float(value)
        task.rate = bench.rate_of(task)
    elif family == "Timing" and attribute == _TIMEBASE:
        task.timebase = str(value)
    elif family == "Timing" and attribute == _SYNC_PULSE:
        task.sync_pulse = str(value)
    elif family == "Write" and attribute == REGENERATION:
        task.regenerates = int(value) == _ALLOWED
    else:
        if family == "Chan" and attribute == _COUPLING:
            for entry in task.channels:
                if channel in {"", entry.name}:
                    checks.coupling(bench.device(entry.device), int(value))
        task.attributes[family, channel, attribute] = value
