"""8 channels at 51.2 kS/s from a simulated rig that stands still now and then: no sample is lost, with any driver.

A recording of 30 minutes is `make proof`'s (tests/integration/agent/test_memory.py); here it is two minutes, and some
seconds in `make test`.
"""

from __future__ import annotations

import signal
import time

import numpy as np
import pytest

from agent.safety import Drive
from agent.settings import InputSettings
from tests.integration.drivers.rigs import VALVE, Rig
from tests.integration.drivers.test_conformance import STEP_OF_CONVERTER
from tests.integration.faults.conftest import FULL

SECONDS = 120.0 if FULL else 8.0
RATE = 51_200.0
LONGEST_DRIVE = 8 * 65_536
"""Samples, of the simulated controller."""


@pytest.mark.parametrize("variant", ["nidaqmx", "opcua-arrays", "opcua-subscription", "file-npy"])
def test_a_rig_that_stands_still_loses_no_sample(tmp_path, variant) -> None:
    rig = Rig(tmp_path / "rig", variant, speed=1.0)
    driver = rig.driver(chunk=0.25)
    inputs = [InputSettings(name=f"a{i}", channel=f"cDAQ1Mod1/ai{i}") for i in range(8)]
    samples = int(SECONDS * RATE)
    with driver.run(inputs, RATE, seconds=SECONDS) as running:
        assert running.rate == RATE
        drive = None
        if samples <= LONGEST_DRIVE:
            drive = Drive(signal=lambda t: np.sin(7 * t), output=VALVE, rate=RATE, wait=0, length=samples, repeats=1)
        running.prepare(samples, drive)
        running.start()
        got, first = 0, []
        freezes = {int(share * samples) for share in (0.3, 0.6)}
        while (block := running.read()).shape[1]:
            assert block.shape[0] == 8
            first.append(block[0].copy())
            got += block.shape[1]
            if any(got - block.shape[1] < at <= got for at in freezes):
                rig.process.send_signal(signal.SIGSTOP)
                time.sleep(0.5)
                rig.process.send_signal(signal.SIGCONT)
        assert got == samples
        if drive is not None:
            assert np.abs(np.concatenate(first) - drive.block(0, samples)).max() < STEP_OF_CONVERTER
    driver.close()
    rig.end()
