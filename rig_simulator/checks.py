"""What a device refuses because its family does not have it, with the number that NI-DAQmx answers.

A device whose model is in no row of the table takes everything.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NoReturn

from rig_simulator.channels import BRIDGES, INTERNAL, WIRINGS
from rig_simulator.devices import Device, Task
from rig_simulator.families import Family
from rig_simulator.families._base import IEPE
from rig_simulator.faults import DriverError

_NO_SUCH_CHANNEL, _WRONG_INPUT, _WRONG_OUTPUT = -200170, -200431, -200432
_VALUE, _PROPERTY = -200077, -200452
_NO_CLOCK, _NO_SYNC_PULSE = -200303, -200762
_DIRECT = {"AC": 10045, "DC": 10050}


def exists(device: Device, subsystem: str, number: str) -> None:
    """Make sure that there is a physical channel: ai0, ao1, ctr0, port0/line3."""
    row = device.family
    counts = {
        "AI": ("ai", device.inputs),
        "AO": ("ao", device.outputs),
        "CI": ("ctr", row.counters if row else 4),
        "DI": ("port0/line", row.lines if row else 8),
        "DO": ("port0/line", row.lines if row else 8),
    }
    stem, count = counts[subsystem]
    place = number.removeprefix(stem)
    if not (number.startswith(stem) and place.isdigit() and int(place) < count):
        raise DriverError(_NO_SUCH_CHANNEL, f"Physical Channel Name: {number}\nDevice: {device.name}")


def channel(
    device: Device, number: str, *, subsystem: str, what: str, given: Mapping[str, Any], limits: tuple[float, float]
) -> None:
    """Make sure that a channel can be what it is asked to be; ``limits`` in V, A or V/V."""
    row = device.family
    if row is None:
        return
    if what not in row.kinds:
        wrong = {"AI": _WRONG_INPUT, "AO": _WRONG_OUTPUT}.get(subsystem, _NO_SUCH_CHANNEL)
        raise DriverError(wrong, f"Physical Channel Name: {device.name}/{number}\nDevice: {device.name}")
    low, high = limits
    if subsystem == "AI":
        _wiring(row, number, given)
        _excitation(row, what, given)
        most = max(row.ranges)
        if what != "thermocouple" and max(abs(low), abs(high)) > most * (1 + 1e-9):
            _refuse("AI.Max" if abs(high) >= abs(low) else "AI.Min", max(low, high, key=abs), f"{-most:g} to {most:g}")
    if subsystem == "AO":
        least, most = row.output_range
        for name, value in (("AO.Min", low), ("AO.Max", high)):
            if not least - 1e-9 <= value <= most + 1e-9:
                _refuse(name, value, f"{least:g} to {most:g}")


def _wiring(row: Family, number: str, given: Mapping[str, Any]) -> None:
    wiring = WIRINGS.get(given.get("terminal_config", -1), "?")
    half = {8: 4, 16: 8, 32: 8}.get(row.inputs, row.inputs) if len(row.wirings) > 1 else row.inputs
    paired = bool(half) and (int(number.removeprefix("ai")) // half) % 2 == 1
    if wiring and (wiring not in row.wirings or (wiring == "DIFF" and paired)):
        _refuse("AI.TermCfg", wiring, ", ".join(sorted(row.wirings)))


def _excitation(row: Family, what: str, given: Mapping[str, Any]) -> None:
    if what in IEPE and given.get("current_excit_source") == INTERNAL:
        value = given["current_excit_val"]
        if not row.iepe:
            _refuse("AI.Excit.Src", "Internal", "External, None")
        if not any(abs(value - known) < 1e-9 for known in row.iepe):
            _refuse("AI.Excit.Val", value, ", ".join(f"{known:g}" for known in row.iepe))
    if what == "bridge" and "bridge_config" in given:
        bridge = BRIDGES.get(given["bridge_config"], "?")
        if bridge not in row.bridges:
            _refuse("AI.Bridge.Cfg", bridge, ", ".join(sorted(row.bridges)))


def coupling(device: Device, value: int) -> None:
    """Make sure that an input can be coupled so."""
    row = device.family
    if row is None:
        return
    if not row.couplings:
        raise DriverError(_PROPERTY, "Property: AI.Coupling")
    if value not in {_DIRECT[name] for name in row.couplings}:
        _refuse("AI.Coupling", value, ", ".join(sorted(row.couplings)))


def clock(device: Device, task: Task, source: str) -> None:
    """Make sure that a task can be timed by a sample clock, and by that one."""
    row = device.family
    if row is None:
        return
    kind = {"AI": row.input_clock, "AO": row.output_clock, "CI": "sample"}.get(task.kind, row.line_clock)
    if task.kind == "CI" and "encoder" not in row.kinds:
        kind = "none"  # counts edges on demand only
    own = not source or source.lower() == "onboardclock"
    if kind == "none":
        _refuse("SampTimingType", "Sample Clock", "On Demand")
    if kind == "timebase" and not own:
        _refuse("SampClk.Src", source, "OnboardClock")
    if task.kind in {"CI", "DI", "DO"} and own:
        raise DriverError(_NO_CLOCK, f"Task Name: {task.name}")


def rate(device: Device, task: Task) -> float:
    """Return the highest rate of a task's kind on a device, samples/s of each channel; 0 where the device tells none."""
    row = device.family
    if row is None:
        return 0.0
    if task.kind == "AI":
        share = sum(entry.device == device.name for entry in task.channels) if row.multiplexed else 1
        return min(row.input_rate, device.max_rate) / share
    return row.output_rate if task.kind == "AO" else 0.0


def timebase(device: Device, task: Task) -> None:
    """Make sure that who follows another one's timebase is told when to begin dividing it."""
    row = device.family
    if row is None or not (task.timebase or task.sync_pulse):
        return
    if task.timebase and "timebase" not in {row.input_clock, row.output_clock}:
        return
    if task.sync_pulse and "timebase" not in {row.input_clock, row.output_clock}:
        raise DriverError(_PROPERTY, "Property: SyncPulse.Src")
    if task.timebase and not task.sync_pulse:
        raise DriverError(_NO_SYNC_PULSE, f"Task Name: {task.name}")


def _refuse(name: str, value: object, possible: str) -> NoReturn:
    raise DriverError(_VALUE, f"Property: {name}\nRequested Value: {value}\nPossible Values: {possible}")
