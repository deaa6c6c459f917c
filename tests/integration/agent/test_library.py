"""The route of a PC with a driver of its own: the unmodified nidaqmx package through ctypes into a generated library."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
COMPILER = shutil.which("cc")

# The library must be on LD_LIBRARY_PATH before Python starts, so the run is a process of its own.
PROGRAM = """
import json
import numpy as np
from agent.drivers.nidaqmx import driver as driver_module
from agent.errors import AttemptError
from agent.drivers.nidaqmx.driver import Nidaqmx
from agent.drivers.nidaqmx.settings import NidaqmxSettings
from agent.safety import Drive
from agent.settings import DeviceSettings, InputSettings, OutputSettings
from rig_simulator.driver_library import Library
from rig_simulator.sensors import Sensor, Teds
from tests.integration.agent.lab import make_bench

bench = make_bench()
library = Library(bench)
hardware = Nidaqmx(NidaqmxSettings(chunk=0.1), rig="bench-1")
found = {"devices": hardware.check([DeviceSettings(name="cDAQ1Mod1", serial="1A2B3C4")])}
output = OutputSettings(name="valve", channel="cDAQ1Mod2/ao0", amplitude=4.0)
inputs = [InputSettings(name="a", channel="cDAQ1Mod1/ai0", range=5.0),
          InputSettings(name="b", channel="cDAQ1Mod1/ai1", range=5.0),
          InputSettings(name="c", channel="cDAQ1Mod1/ai2", kind="acceleration", range=5.0),
          InputSettings(name="d", channel="cDAQ1Mod1/ai3", kind="force", range=5.0),
          InputSettings(name="e", channel="cDAQ1Mod3/ai0", kind="velocity", range=5.0),
          InputSettings(name="f", channel="cDAQ1Mod4/ai0", kind="bridge", range=0.025)]

def run(seconds, rate=1000.0):
    with hardware.run(inputs, rate, seconds=seconds) as running:
        length = round(seconds * running.rate)
        drive = Drive(signal=lambda t: np.sin(20 * t), output=output, rate=running.rate, wait=0, length=length, repeats=1)
        running.prepare(length, drive)
        running.start()
        blocks = []
        while (block := running.read()).shape[1]:
            blocks.append(block)
    hardware.rest(output)
    values = np.concatenate(blocks, axis=1)
    difference = np.abs(values[0] - drive.block(0, length)).max()
    return {"rate": running.rate, "shape": values.shape, "difference": difference, "noise": values[2:].std(axis=1).tolist(),
            "finite": running._finite, "level": bench.levels["cDAQ1Mod2/ao0"]}

bench.sensors["cDAQ1Mod1/ai2"] = Sensor(teds=Teds(manufacturer=25, model=352, letter="C", version=33, serial=4711))
found["sheets"] = [sheet and sheet.words for sheet in map(hardware.data_sheet, inputs[2:4])]
del bench.sensors["cDAQ1Mod1/ai2"]
found["finite"] = run(1.0)
driver_module._WHOLE = 10_000  # samples, beyond which a run is streamed both ways
found["continuous"] = run(6.0, rate=5120.0)

def failing(work):
    try:
        work()
    except AttemptError as error:
        return [error.code, error.detail]

def unplugged():
    bench.unplug("cDAQ1Mod1", after=500)
    run(1.0)

found["rate"] = failing(lambda: run(1.0, rate=2e5))
inputs.append(InputSettings(name="g", channel="cDAQ1Mod1/ai9"))
found["channel"] = failing(lambda: run(1.0))
inputs.pop()
found["unplugged"] = failing(unplugged)
found["tasks"] = list(bench.tasks)
print(json.dumps(found))
"""


@pytest.mark.skipif(COMPILER is None or sys.platform != "linux", reason="needs a C compiler, and ELF libraries")
def test_the_driver_route_measures_and_complains_as_the_server_route_does(tmp_path) -> None:
    from rig_simulator.driver_library import build

    build(tmp_path, compiler=COMPILER)
    environment = os.environ | {"LD_LIBRARY_PATH": str(tmp_path), "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM],
        cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert [(d["name"], d["model"], d["serial"]) for d in found["devices"]] == [
        ("cDAQ1Mod1", "NI 9234", "01A2B3C4"),
        ("cDAQ1Mod2", "NI 9260", "00000002"),
        ("cDAQ1Mod3", "NI 9234", "00000003"),
        ("cDAQ1Mod4", "NI 9237", "00000004"),
    ]
    assert found["sheets"] == ["manufacturer 25, model 352, version C33, serial 4711, 0.01 V/(m/s²)", None]
    for kind, rate, seconds in (("finite", 51200 / 31, 1.0), ("continuous", 5120.0, 6.0)):
        run = found[kind]
        assert run["finite"] == (kind == "finite")
        assert run["rate"] == pytest.approx(rate)
        assert run["shape"] == [6, round(seconds * rate)]
        assert run["difference"] < 2e-6  # one clock, one start: sample for sample
        # Volts, whatever the sensor: the noise of an unconnected input is 20 uV on each of them.
        assert run["noise"] == pytest.approx([20e-6] * 4, rel=0.1)
        assert run["level"] == 0.0
    assert found["rate"][0] == "unsupported_setting"
    assert found["channel"][0] == "unknown_channel"
    assert found["unplugged"][0] == "device_gone"
    assert "check cable and power" in found["unplugged"][1]
    assert found["tasks"] == []
