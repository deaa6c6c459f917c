"""Every row of the table of device families, by what its devices refuse: a kind, a wiring, a range, a rate, a clock, a terminal.

The cases are found in the table: a new row is held to it without a line here.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rig_simulator.attributes import get, put
from rig_simulator.bench import Bench
from rig_simulator.channels import CALLS
from rig_simulator.devices import CONTINUOUS, FINITE, Device, Task
from rig_simulator.families import FAMILIES, Family
from rig_simulator.faults import DriverError

ROWS = list(FAMILIES.values())
WITH_INPUTS = [row for row in ROWS if row.inputs]
WITH_OUTPUTS = [row for row in ROWS if row.outputs]
BY_TIMEBASE = [row for row in ROWS if row.timebase and row.outputs and ("SyncPulse" in row.terminals or row.in_chassis)]
PLACES = {"AI": "ai0", "AO": "ao0", "CI": "ctr0", "DI": "port0/line0", "DO": "port0/line0"}
NUMBERS = {"RSE": 10083, "NRSE": 10078, "DIFF": 10106, "PSEUDO": 12529}
COMMIT = 3

every_row = pytest.mark.parametrize("row", ROWS, ids=lambda row: row.model)
with_inputs = pytest.mark.parametrize("row", WITH_INPUTS, ids=lambda row: row.model)
with_outputs = pytest.mark.parametrize("row", WITH_OUTPUTS, ids=lambda row: row.model)


def bench_of(row: Family) -> tuple[Bench, str]:
    """Return a bench with one device of a row, in a chassis where it needs one, and the device's name."""
    name = "cDAQ1Mod1" if row.in_chassis else "Dev1"
    return Bench([Device(name=name, model=row.model, serial=1)], speed=0.0), name


def arguments(call_name: str, physical: str, row: Family, **change: Any) -> dict[str, Any]:
    """Return what a careful client asks for: within the range, with what the row has."""
    call = CALLS[call_name]
    most = max(row.ranges, default=0.0) if call.subsystem == "AI" else max(row.output_range)
    low = -most if call.subsystem == "AI" else min(row.output_range)
    usual: dict[str, Any] = dict.fromkeys(call.names, 0) | {
        call.names[0]: physical,
        call.names[1]: "",
        "terminal_config": -1,
        "min_val": low,
        "max_val": most,
        "sensitivity": 1000.0,
        "sensitivity_units": 12509,
        "units": 10186 if call_name == "CreateAIAccelChan" else 0,
        "current_excit_source": 10200 if row.iepe else 0,
        "current_excit_val": max(row.iepe, default=0.0),
        "bridge_config": 10182,
        "decoding_type": 10092,
        "pulses_per_rev": 1000,
        "dist_per_pulse": 1e-6,
    }
    return {name: (usual | change)[name] for name in call.names}


def made(bench: Bench, name: str, row: Family, call_name: str, **change: Any) -> Task:
    task = bench.create("")
    physical = f"{name}/{PLACES[CALLS[call_name].subsystem]}"
    bench.create_channels(task, CALLS[call_name], arguments(call_name, physical, row, **change))
    return task


def analog(row: Family) -> str:
    """Return a call that makes an analog input of a kind that a row has."""
    return next(name for name, call in CALLS.items() if call.subsystem == "AI" and call.what in row.kinds)


def output(row: Family) -> str:
    return next(name for name, call in CALLS.items() if call.subsystem == "AO" and call.what in row.kinds)


def code(work: Any) -> int:
    with pytest.raises(DriverError) as refused:
        work()
    return refused.value.code


@every_row
def test_a_row_names_its_sources(row: Family) -> None:
    assert row.sources
    for source in row.sources:
        assert source.startswith(("NI ", "NI-DAQmx ", "X Series ", "M Series ")), source
    assert bool(row.inputs) == (row.input_clock != "none") or not row.inputs
    assert row.in_chassis == (not row.engines)


@every_row
@pytest.mark.parametrize("call_name", CALLS)
def test_a_kind_that_a_family_lacks_is_refused(row: Family, call_name: str) -> None:
    bench, name = bench_of(row)
    call = CALLS[call_name]
    counts = {"AI": row.inputs, "AO": row.outputs, "CI": row.counters, "DI": row.lines, "DO": row.lines}
    if call.what in row.kinds:
        assert made(bench, name, row, call_name).channels[0].what == call.what
        return
    expected = {"AI": -200431, "AO": -200432}.get(call.subsystem, -200170) if counts[call.subsystem] else -200170
    assert code(lambda: made(bench, name, row, call_name)) == expected


@with_inputs
@pytest.mark.parametrize("wiring", NUMBERS)
def test_a_wiring_that_a_family_lacks_is_refused(row: Family, wiring: str) -> None:
    wired = [name for name in CALLS if "terminal_config" in CALLS[name].names and CALLS[name].what in row.kinds]
    bench, name = bench_of(row)
    for call_name in wired:
        if wiring in row.wirings:
            made(bench, name, row, call_name, terminal_config=NUMBERS[wiring])
        else:
            refused = code(lambda made_by=call_name: made(bench, name, row, made_by, terminal_config=NUMBERS[wiring]))
            assert refused == -200077


@with_inputs
def test_a_range_beyond_that_of_a_family_is_refused(row: Family) -> None:
    bench, name = bench_of(row)
    call_name = analog(row)
    beyond = 1.01 * max(row.ranges)
    assert code(lambda: made(bench, name, row, call_name, max_val=beyond)) == -200077
    assert code(lambda: made(bench, name, row, call_name, min_val=-beyond)) == -200077


@with_outputs
def test_an_output_beyond_its_span_is_refused(row: Family) -> None:
    bench, name = bench_of(row)
    low, high = row.output_range
    over = 0.01 * (high - low)
    assert code(lambda: made(bench, name, row, output(row), max_val=high + over)) == -200077
    assert code(lambda: made(bench, name, row, output(row), min_val=low - over)) == -200077


@with_inputs
def test_one_channel_more_than_a_family_has_does_not_exist(row: Family) -> None:
    bench, name = bench_of(row)
    call_name = analog(row)
    given = arguments(call_name, f"{name}/ai{row.inputs}", row)
    assert code(lambda: bench.create_channels(bench.create(""), CALLS[call_name], given)) == -200170


@with_inputs
def test_a_rate_beyond_that_of_a_family_is_refused(row: Family) -> None:
    bench, name = bench_of(row)
    task = made(bench, name, row, analog(row))
    bench.set_clock(task, rate=row.input_rate, source="", mode=FINITE, samples=10)
    assert task.rate == pytest.approx(row.input_rate)
    too_fast = lambda: bench.set_clock(task, rate=1.01 * row.input_rate, source="", mode=FINITE, samples=10)  # noqa: E731
    assert code(too_fast) == -200077
    if row.multiplexed:  # one converter for all channels
        given = arguments(analog(row), f"{name}/ai1", row)
        bench.create_channels(task, CALLS[analog(row)], given)
        both = lambda: bench.set_clock(task, rate=0.6 * row.input_rate, source="", mode=FINITE, samples=10)  # noqa: E731
        assert code(both) == -200077


@with_inputs
def test_coupling_and_supply_are_those_of_the_family(row: Family) -> None:
    bench, name = bench_of(row)
    task = made(bench, name, row, analog(row))
    couple = lambda number: lambda: put(bench, "Chan", task.name, 0x0064, number, channel=task.channels[0].name)  # noqa: E731
    for word, number in (("AC", 10045), ("DC", 10050)):
        if word in row.couplings:
            couple(number)()
        else:
            assert code(couple(number)) == (-200077 if row.couplings else -200452)
    if "acceleration" in row.kinds:
        wrong = lambda: made(bench, name, row, "CreateAIAccelChan", current_excit_val=0.0077)  # noqa: E731
        assert code(wrong) == -200077
    if "bridge" in row.kinds:
        wrong = lambda: made(bench, name, row, "CreateAIBridgeChan", bridge_config=10228)  # noqa: E731
        assert code(wrong) == -200077


@pytest.mark.parametrize(
    ("row", "call_name"),
    [
        pytest.param(row, name, id=f"{row.model}-{name}")
        for row in ROWS
        for name, call in CALLS.items()
        if call.subsystem != "AI" and call.what in row.kinds
    ],
)
def test_a_clock_that_a_family_lacks_is_refused(row: Family, call_name: str) -> None:
    call = CALLS[call_name]
    bench, name = bench_of(row)
    task = made(bench, name, row, call_name)
    counter = "sample" if "encoder" in row.kinds else "none"
    clock = {"AO": row.output_clock, "CI": counter}.get(call.subsystem, row.line_clock)
    timed = lambda source: lambda: bench.set_clock(task, rate=1000.0, source=source, mode=CONTINUOUS, samples=100)  # noqa: E731
    if clock == "none":
        assert code(timed("")) == -200077
        return
    if call.subsystem == "AO":
        rate = row.output_rate if clock == "timebase" else 1000.0
        bench.set_clock(task, rate=rate, source="", mode=CONTINUOUS, samples=100)
    else:
        assert code(timed("")) == -200303
    shared = f"/{bench.devices[name].timed_by}/ai/SampleClock"
    if clock == "timebase":
        assert code(timed(shared)) == -200077
    else:
        timed(shared)()


@pytest.mark.parametrize("row", [row for row in ROWS if row.outputs or row.engines], ids=lambda row: row.model)
@pytest.mark.parametrize("owner", ["module", "device", "stranger"])
def test_a_terminal_that_a_device_lacks_is_no_source(row: Family, owner: str) -> None:
    """Terminals of a chassis are the chassis'; those of a board its own; nobody has what is in no row."""
    if row.outputs and row.output_clock != "none":
        bench, name = bench_of(row)
        task = made(bench, name, row, output(row))
    else:  # chassis, and devices whose outputs have no clock: an output of a module beside them
        name = "cDAQ1" if row.model.startswith("cDAQ") else "Dev1"
        bench = Bench(
            [Device(name=name, model=row.model, serial=1), Device(name="cDAQ1Mod1", model="NI 9263", serial=2)]
        )
        task = made(bench, "cDAQ1Mod1", FAMILIES["NI 9263"], "CreateAOVoltageChan")
    rate = bench.devices[task.device].family.output_rate
    bench.set_clock(task, rate=rate, source="", mode=FINITE, samples=4)
    bench.write(task, np.zeros((1, 4)), auto_start=False)
    place = bench.devices[name].timed_by if owner == "device" else "Dev7" if owner == "stranger" else name
    known = {"start": "ai/StartTrigger", "pin": "PFI0", "nonsense": "ai/Start"}
    chassis = FAMILIES["cDAQ-9178"] if row.in_chassis else row
    for terminal in known.values():
        task.trigger = f"/{place}/{terminal}"
        there = owner != "stranger" and terminal in (row if owner == "module" and row.in_chassis else chassis).terminals
        if there and bench.devices[task.device].timed_by == place:
            bench.control(task, COMMIT)
        else:  # nothing leads from a USB device to a chassis
            assert code(lambda: bench.control(task, COMMIT)) == (-89125 if there else -89120)


@pytest.mark.parametrize("row", BY_TIMEBASE, ids=lambda row: row.model)
def test_a_delta_sigma_output_needs_the_sync_pulse_with_the_timebase(row: Family) -> None:
    name = "cDAQ1Mod1" if row.in_chassis else "Dev1"
    devices = [Device(name=name, model=row.model, serial=1)]
    if not row.inputs:
        devices.append(Device(name="cDAQ1Mod2", model="NI 9234", serial=2))
    bench = Bench(devices, speed=0.0)
    listening = FAMILIES[devices[-1].model]
    inputs = made(bench, devices[-1].name, listening, analog(listening))
    bench.set_clock(inputs, rate=listening.input_rate, source="", mode=FINITE, samples=100)
    bench.control(inputs, COMMIT)
    task = made(bench, name, row, output(row))
    bench.set_clock(task, rate=row.output_rate, source="", mode=FINITE, samples=100)
    put(bench, "Timing", task.name, 0x1308, bench.terminal(inputs, "SampleClockTimebase"))
    assert code(lambda: bench.control(task, COMMIT)) == -200762
    put(bench, "Timing", task.name, 0x223D, bench.terminal(inputs, "SyncPulse"))
    task.trigger = bench.terminal(inputs, "StartTrigger")
    bench.control(task, COMMIT)


@pytest.mark.parametrize("row", [row for row in ROWS if row.model.startswith("cDAQ")], ids=lambda row: row.model)
def test_a_chassis_runs_as_many_tasks_of_inputs_as_it_has_timing_engines(row: Family) -> None:
    modules = [Device(name=f"cDAQ1Mod{i}", model="NI 9215", serial=i) for i in range(1, 5)]
    bench = Bench([Device(name="cDAQ1", model=row.model, serial=9), *modules])
    tasks = [made(bench, module.name, FAMILIES["NI 9215"], "CreateAIVoltageChan") for module in modules]
    for task in tasks:
        bench.set_clock(task, rate=1000.0, source="", mode=FINITE, samples=10)
        if row.named_when_reserved:
            assert code(lambda made_task=task: get(bench, "Timing", made_task.name, 0x2F1B)) == -200983
    for task in tasks[: len(row.engines)]:
        bench.control(task, COMMIT)
    assert {task.engine for task in tasks} - {""} == set(row.engines)
    assert code(lambda: bench.control(tasks[len(row.engines)], COMMIT)) == -50103


def test_what_a_description_gives_is_within_the_family() -> None:
    with pytest.raises(ValueError, match="inputs of Mod1 must be at most 4, as NI 9234 has, got 8"):
        Device(name="Mod1", model="NI 9234", serial=1, inputs=8)
    with pytest.raises(ValueError, match="divider of Mod1 must be 31, as NI 9260 has, got 0"):
        Device(name="Mod1", model="NI 9260", serial=1, divider=0)
