"""What an output was told to play as a channel beside what was measured: on each driver, and of each kind of output."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agent.settings import Settings
from agent.settings_file import read
from rig_simulator.bench import Bench
from rig_simulator.devices import Device
from rig_simulator.grpc_server import Server
from rig_simulator.sensors import Sensor
from tests.integration.drivers.rigs import VARIANTS, Rig


@pytest.mark.parametrize("segment", [0.1, 0.03])
def test_what_an_output_was_told_to_play_is_a_channel_beside_what_was_measured(lab, segment) -> None:
    settings = lab.settings()
    with lab.agent(replace(settings, spool=replace(settings.spool, segment=segment))):
        done = lab.wait(lab.ask(channels=["valve", "loopback"], averages=2))
    assert (done["status"], done["attempts"][0]["error"]) == ("done", None)
    values = lab.samples(done["dataset"])
    assert np.abs(values[:, 1] - values[:, 0]).max() < 2e-6  # in every sample; the converter's step is 1.2e-6 V
    assert np.ptp(values[:, 1]) > 3.9
    channels = lab.client.get(f"/v1/datasets/{done['dataset']}").json()["channels"]
    assert [(entry["name"], entry["unit"]) for entry in channels] == [("loopback", "V"), ("valve", "V")]
    assert channels[1]["quantity"] == "commanded voltage"
    assert lab.get(done["id"])["document"]["channels"] == ["valve", "loopback"]


OUTPUT = """
[[outputs]]
name = "valve"
channel = "cDAQ1Mod2/{line}"
kind = "{kind}"
amplitude = {amplitude}
"""
INPUT = """
[spool]
reserve = 0.0
[[inputs]]
name = "loopback"
channel = "cDAQ1Mod1/ai0"
"""


def settings_of(lab, daq: dict[str, Any], text: str) -> Settings:
    path: Path = lab.folder / "own.toml"
    path.write_text(INPUT + text)
    place = {"service.url": lab.service.url, "rig.name": lab.rig, "spool.folder": str(lab.spool)}
    given = place | {f"daq.{name}": value for name, value in daq.items()}
    return read(path, {"SERVOTUNE_AGENT_KEY": lab.service.keys["acquire"]}, given)


def both(lab, settings: Settings, signal: dict[str, Any]) -> tuple[dict[str, Any], np.ndarray]:
    """Measure, and return the channels as they are described with all of their samples."""
    with lab.agent(settings):
        drive = {"output": "valve", "signal": signal}
        done = lab.wait(lab.ask(channels=["loopback", "valve"], drive=drive, averages=2, duration=0.4))
    assert (done["status"], done["attempts"][0]["error"]) == ("done", None), done
    channels = lab.client.get(f"/v1/datasets/{done['dataset']}").json()["channels"]
    return channels[1], lab.samples(done["dataset"])


@pytest.mark.parametrize("variant", [name for name in VARIANTS if name != "nidaqmx"])
def test_every_driver_plays_in_the_sample_that_is_measured(lab, variant, tmp_path) -> None:
    rig = Rig(tmp_path / "rig", variant, speed=0.0)
    try:
        text = OUTPUT.format(line="ao0", kind="voltage", amplitude=4.0)
        channel, values = both(
            lab, settings_of(lab, rig.settings, text), {"kind": "sine", "amplitude": 2, "frequency": "5 Hz"}
        )
    finally:
        rig.end()
    assert (channel["name"], channel["quantity"], channel["unit"]) == ("valve", "commanded voltage", "V")
    assert np.abs(values[:, 1] - values[:, 0]).max() < 3e-6  # the step of a converter of 24 bits over 20 V
    assert np.ptp(values[:, 1]) > 3.9


@pytest.mark.parametrize(
    ("models", "text", "signal", "unit"),
    [
        (
            ("NI 9203", "NI 9265"),
            'kind = "current"\nrange = 0.02\n' + OUTPUT.format(line="ao0", kind="current", amplitude=0.02),
            {"kind": "step", "amplitude": 0.012, "start": 0.1},
            "A",
        ),
        (
            ("NI 9215", "NI 9401"),
            OUTPUT.format(line="port0/line3", kind="digital", amplitude=1.0),
            {"kind": "step", "start": 0.1},
            "",
        ),
    ],
)
def test_currents_and_lines_are_kept_as_they_are_played(lab, models, text, signal, unit) -> None:
    """A line is heard by no analog input here: its channel has the step, at its sample."""
    devices = [Device(name=f"cDAQ1Mod{i}", model=model, serial=i) for i, model in enumerate(models, 1)]
    bench = Bench(devices, sensors={"cDAQ1Mod1/ai0": Sensor(loopback="cDAQ1Mod2/ao0")}, speed=0.0)
    server = Server(bench)
    try:
        daq = {"server": f"127.0.0.1:{server.port}", "deadline": 30.0, "chunk": 0.1}
        channel, values = both(lab, settings_of(lab, daq, text), signal)
    finally:
        server.close()
    kind = {"A": "current", "": "state"}[unit]
    assert (channel["quantity"], channel.get("unit", "")) == (f"commanded {kind}", unit)
    told = values[:, 1]
    (rises,) = np.nonzero(np.diff(told) > 0)[:1]
    assert set(np.unique(told)) == {0.0, signal.get("amplitude", 1.0)}
    assert rises.size == 2  # one in each repetition
    if unit == "A":
        assert np.abs(told - values[:, 0]).max() < 0.02 / 2**15  # the step of the converter
