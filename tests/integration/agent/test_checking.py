"""`servotune agent check` against simulated rigs: what fits, what does not and what is to be done; no output moves."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from datetime import date
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from agent import checking
from agent.drivers.nidaqmx.driver import Nidaqmx
from agent.drivers.nidaqmx.settings import NidaqmxSettings
from agent.settings import Settings
from agent.settings_file import read
from agent.spool import held
from rig_simulator.opcua_server import Server as Controller
from rig_simulator.sensors import Sensor, Teds
from tests.integration.agent.lab import RIG, Lab, make_bench

TODAY = date(2026, 11, 26)
MISFITS = """
[[devices]]
name = "cDAQ1Mod3"
model = "NI 9239"
[[devices]]
name = "cDAQ1Mod9"
[[inputs]]
name = "too_wide"
channel = "cDAQ1Mod1/ai2"
range = 10.0
[[inputs]]
name = "single_ended"
channel = "cDAQ1Mod3/ai0"
range = 5.0
wiring = "rse"
[[inputs]]
name = "nowhere"
channel = "cDAQ1Mod1/ai7"
range = 5.0
[[inputs]]
name = "absent"
channel = "cDAQ1Mod9/ai0"
range = 5.0
[[inputs]]
name = "bridge_of_a_vibration_module"
channel = "cDAQ1Mod1/ai3"
kind = "bridge"
range = 0.025
[[inputs]]
name = "microphone"
channel = "cDAQ1Mod3/ai1"
kind = "acceleration"
unit = "m/s**2"
range = 5.0
excitation = 0.004
[[inputs]]
name = "load_cell"
channel = "cDAQ1Mod4/ai0"
kind = "bridge"
range = 0.025
calibration = {due = "2026-12-01"}
chain = [{model = "amplifier", gain = 10.0, calibration = {due = "2026-11-01"}}]
[[outputs]]
name = "too_much"
channel = "cDAQ1Mod2/ao1"
amplitude = 12.0
[[outputs]]
name = "no_such_output"
channel = "cDAQ1Mod2/ao5"
amplitude = 1.0
"""
TOLD = {
    "device cDAQ1Mod3": ("model of cDAQ1Mod3 must be NI 9239, got NI 9234", "put the right module in"),
    "device cDAQ1Mod9": ("device cDAQ1Mod9 must be there", "switch it on"),
    "input too_wide": ("range must be at most 5, got 10", "correct this entry"),
    "input single_ended": ("AI.TermCfg; Requested Value: RSE; Possible Values: PSEUDO", "`wiring`"),
    "input nowhere": ("channel must be one of cDAQ1Mod1/ai0", "correct `channel`"),
    "input absent": (
        "device cDAQ1Mod9 of its channel cDAQ1Mod9/ai0 must be there, the hardware has cDAQ1Mod1, cDAQ1Mod2",
        "plug it in",
    ),
    "input bridge_of_a_vibration_module": ("-200431", "check `kind`"),
    "input microphone": ("AI.Excit.Val; Requested Value: 0.004; Possible Values: 0, 0.002", "`excitation`"),
    "output too_much": (
        "output too_much: amplitude must be at most 4.24, got 12: cDAQ1Mod2 gives -4.24 ... 4.24 V",
        "correct `amplitude`",
    ),
    "output no_such_output": ("channel must be one of cDAQ1Mod2/ao0, cDAQ1Mod2/ao1, got cDAQ1Mod2/ao5", "`channel`"),
}
"""What does not fit -> what must be told of it, and what must be told to do."""


def settings(lab: Lab, more: str = "", *, key: str = "acquire", **arguments: Any) -> Settings:
    made = lab.settings(key=key, **arguments)  # writes the file
    path = lab.folder / "agent.toml"
    path.write_text(RIG.format(rig=lab.rig) + more)
    given = {"service.url": lab.service.url, "daq.server": made.daq.server, "spool.folder": str(lab.spool)}  # type: ignore[attr-defined] # the driver's
    return read(path, {"SERVOTUNE_AGENT_KEY": made.service.key}, given | arguments)


def of(findings: list[checking.Finding], result: str) -> dict[str, checking.Finding]:
    return {entry.what: entry for entry in findings if entry.result == result}


def test_a_rig_that_fits_is_told_so_and_nothing_moves(lab) -> None:
    lab.bench.levels["cDAQ1Mod2/ao0"] = 1.25
    found = checking.check(settings(lab), today=TODAY)
    fits = of(found, "ok")
    notes = of(found, "note")
    assert len(fits) + len(notes) == len(found)
    assert list(notes) == [f"device cDAQ1Mod{i}" for i in range(1, 5)]
    told = "NI 9234, serial 01A2B3C4: simulated, its inputs are made-up signals"
    assert notes["device cDAQ1Mod1"].told == told
    rate = f"{51200 / 31:g} samples/s"  # the slowest of a 9234
    assert fits["input position"].told == f"cDAQ1Mod1/ai1, at {rate}"
    assert fits["output valve"].told == f"cDAQ1Mod2/ao0, at {rate}"
    assert fits["all inputs"].told.endswith(rate)
    assert "may acquire" in fits["service"].told
    assert lab.bench.levels == {"cDAQ1Mod2/ao0": 1.25}
    assert lab.bench.tasks == {}
    assert all(rig["name"] != lab.rig for rig in lab.client.get("/v1/rigs").json()["items"])  # not taken


def test_everything_that_does_not_fit_is_named_with_its_remedy(lab) -> None:
    lab.bench.levels["cDAQ1Mod2/ao0"] = 1.25
    found = checking.check(settings(lab, MISFITS), today=TODAY)
    failed = of(found, "fails")
    assert set(failed) == set(TOLD)
    for what, (told, remedy) in TOLD.items():
        assert told in failed[what].told, what
        assert remedy in failed[what].remedy, what
    due = [entry.told for entry in found if entry.result == "note" and entry.what == "input load_cell"]
    was = "was" if date(2026, 11, 1) < TODAY else "is"
    assert due == ["its calibration is due on 2026-12-01", f"the calibration of amplifier {was} due on 2026-11-01"]
    assert {"input loopback", "input position", "input load_cell", "output valve", "all inputs"} <= set(of(found, "ok"))
    assert lab.bench.levels == {"cDAQ1Mod2/ao0": 1.25}
    assert lab.bench.tasks == {}
    shown = checking.table(found)
    assert shown.splitlines()[-1].endswith(f"6 to be known, {len(TOLD)} fail")
    assert all(any(line.startswith(f"FAILS {what}") for line in shown.splitlines()) for what in TOLD)


CURRENT = """
[[outputs]]
name = "winding"
channel = "cDAQ1Mod2/ao1"
amplitude = 1.0
kind = "current"
"""


def test_an_output_that_gives_no_current_is_named(lab) -> None:
    failed = of(checking.check(settings(lab, CURRENT), today=TODAY), "fails")
    assert set(failed) == {"output winding"}
    assert "must give a current, cDAQ1Mod2 does not" in failed["output winding"].told
    assert "correct this entry" in failed["output winding"].remedy


REFUSED = """
[[inputs]]
name = "temperature"
channel = "cDAQ1Mod1/ai2"
kind = "acceleration"
unit = "degC"
range = 5.0
[[inputs]]
name = "unheard"
channel = "cDAQ1Mod1/ai3"
unit = "furlongs_per_fortnight"
range = 5.0
"""


def test_units_that_the_service_refuses_are_found_and_it_learns_of_no_rig(lab) -> None:
    found = checking.check(settings(lab, REFUSED), today=TODAY)
    told = {entry.what: (entry.told, entry.remedy) for entry in found if entry.result == "fails"}
    assert set(told) == {"input temperature", "input unheard"}
    assert "unit of temperature must be one of acceleration (m/s**2) or V, got 'degC'" in told["input temperature"][0]
    assert "unit of unheard: unit must be" in told["input unheard"][0]
    assert all("K, not degC" in remedy for _, remedy in told.values())
    assert all(rig["name"] != lab.rig for rig in lab.client.get("/v1/rigs").json()["items"])


SENSORS = """
[[inputs]]
name = "right"
channel = "cDAQ1Mod3/ai0"
kind = "acceleration"
unit = "m/s**2"
sensitivity = 0.0102
range = 5.0
model = "352C33"
serial = "LW4711"
[[inputs]]
name = "swapped"
channel = "cDAQ1Mod3/ai1"
kind = "acceleration"
unit = "m/s**2"
sensitivity = 0.1
range = 5.0
serial = "4712"
[[inputs]]
name = "without"
channel = "cDAQ1Mod3/ai2"
kind = "acceleration"
unit = "m/s**2"
sensitivity = 0.1
range = 5.0
serial = "4713"
"""


def test_sensors_are_held_against_the_data_sheets_in_them(lab) -> None:
    sheets = {"cDAQ1Mod3/ai0": 4711, "cDAQ1Mod3/ai1": 815, "cDAQ1Mod1/ai1": 9}  # the last one is no IEPE input
    for channel, serial in sheets.items():
        teds = Teds(manufacturer=25, model=352, letter="C", version=33, serial=serial, sensitivity=0.0102)
        lab.bench.sensors[channel] = Sensor(teds=teds)
    found = checking.check(settings(lab, SENSORS), today=TODAY)
    told = [(entry.result, entry.what, entry.told) for entry in found if entry.what.startswith("sensor ")]
    assert told == [
        ("ok", "sensor right", "says manufacturer 25, model 352, version C33, serial 4711, 0.0102 V/(m/s²)"),
        ("fails", "sensor swapped", "the sensor has serial 815, its entry 4712"),
        ("fails", "sensor swapped", "the sensor says 0.0102 V for one m/s**2, its entry 0.1"),
    ]
    assert {entry.what for entry in found if entry.result == "fails"} == {"sensor swapped"}


def test_a_data_sheet_that_cannot_be_read_is_to_be_known(lab, monkeypatch) -> None:
    lab.bench.sensors["cDAQ1Mod3/ai0"] = Sensor(teds=Teds(manufacturer=25, model=352, serial=4711))
    monkeypatch.setattr(Teds, "bits", lambda _: b"1234")
    notes = of(checking.check(settings(lab, SENSORS), today=TODAY), "note")
    assert "must have at least 8 bytes, got 4" in notes["sensor right"].told
    assert notes["sensor right"].remedy == "see to the sensor and its cable"


def test_a_rate_that_no_module_has_is_told(lab) -> None:
    found = checking.check(settings(lab), rate=102_400, today=TODAY)
    failed = of(found, "fails")
    assert set(failed) == {"input loopback", "input position"}
    assert failed["input position"].told.startswith("sample rate 102400 of position: NI-DAQmx -200077")
    assert "Maximum Value: 51200" in failed["input position"].told
    assert "no input fits" in of(found, "note")["output valve"].told


def test_no_service_no_key_no_server_are_named(lab) -> None:
    dead = settings(lab, **{"service.url": "http://127.0.0.1:9", "daq.server": "127.0.0.1:9", "daq.deadline": 1.0})
    found = checking.check(dead, today=TODAY)
    failed = of(found, "fails")
    assert set(failed) == {"service", "hardware"}
    assert "no answer from http://127.0.0.1:9" in failed["service"].told
    assert "does not answer" in failed["hardware"].told
    reader = of(checking.check(settings(lab, key="read"), today=TODAY), "fails")
    assert set(reader) == {"service"}
    assert "scope acquire, got read" in reader["service"].told


def test_a_rig_without_inputs_measures_nothing(lab) -> None:
    failed = of(checking.check(replace(settings(lab), inputs=()), today=TODAY), "fails")
    assert {what: entry.told for what, entry in failed.items()} == {"inputs": "there is none: nothing can be measured"}


def test_while_an_agent_has_the_rig_no_channel_is_tried(lab) -> None:
    with held(lab.spool):
        found = checking.check(settings(lab), today=TODAY)
    assert "one agent's alone" in of(found, "fails")["spool"].told
    assert not any(entry.what.startswith("input") for entry in found)


@pytest.mark.parametrize(("more", "code"), [("", 0), (MISFITS, 1), ("[nonsense]\n", 2)])
def test_the_command_says_it_by_its_exit_code(lab, more, code) -> None:
    settings(lab)
    path: Path = lab.folder / "agent.toml"
    path.write_text(RIG.format(rig=lab.rig) + more)
    command = [sys.executable, "-m", "servotune", "agent", "check", "--settings", str(path), "--url", lab.service.url]
    command += ["--daq-server", f"127.0.0.1:{lab.server.port}", "--spool", str(lab.spool)]
    environment = {"SERVOTUNE_AGENT_KEY": lab.service.keys["acquire"]}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == code, done.stdout + done.stderr
    if code == 2:
        assert "section must be one of" in done.stderr
    else:
        assert done.stdout.splitlines()[-1].endswith(f"{len(TOLD) * code} fail")


def test_the_channels_of_a_controller_are_tried(lab) -> None:
    server = Controller(make_bench(), watchdog=60.0)
    path = lab.folder / "plc.toml"
    before, _, rest = RIG.format(rig=lab.rig).partition("[[devices]]")
    inputs = rest[rest.index("[[inputs]]") :] + '[[inputs]]\nname = "nowhere"\nchannel = "X7"\n'
    path.write_text(
        before.replace("[daq]", f'[daq]\ndriver = "opcua"\nserver = "opc.tcp://127.0.0.1:{server.port}"') + inputs
    )
    given = {"service.url": lab.service.url, "spool.folder": str(lab.spool)}
    try:
        found = checking.check(read(path, {"SERVOTUNE_AGENT_KEY": lab.service.keys["acquire"]}, given), today=TODAY)
    finally:
        server.close()
    assert set(of(found, "fails")) == {"input nowhere"}
    assert {"input loopback", "input position", "output valve", "all inputs"} <= set(of(found, "ok"))


def test_the_service_learns_what_does_not_fit_when_an_agent_starts(lab) -> None:
    inputs = MISFITS[MISFITS.index("[[inputs]]") : MISFITS.index("[[outputs]]")]  # it measures with the others
    with lab.agent(settings(lab, inputs)):
        lab.until(lambda: "output valve" in told_of(lab), what=lambda: told_of(lab))
        found = told_of(lab)
    wrong = {what for what, entry in found.items() if entry["result"] == "fails"}
    assert wrong == {what for what in TOLD if what.startswith("input")}
    for what in wrong:
        told, remedy = TOLD[what]
        assert told in found[what]["told"]
        assert remedy in found[what]["remedy"]
    assert found["input position"]["result"] == found["output valve"]["result"] == "ok"
    assert lab.level() == 0.0


def test_a_device_that_goes_is_told_until_it_is_back(lab) -> None:
    with lab.agent():
        lab.until(lambda: "output valve" in told_of(lab), what=lambda: told_of(lab))
        lab.bench.unplug("cDAQ1Mod1")
        lab.until(lambda: result_of(lab, "input position") == "fails", what=lambda: told_of(lab))
        gone = told_of(lab)["device cDAQ1Mod1"]
        assert (gone["result"], "must be there" in gone["told"]) == ("fails", True)
        assert "check its cable" in gone["remedy"]
        lab.bench.plug("cDAQ1Mod1")
        lab.until(lambda: result_of(lab, "input position") == "ok", what=lambda: told_of(lab))


def test_a_device_that_goes_while_it_is_asked_is_none_of_those_that_are_there(lab, monkeypatch) -> None:
    driver = Nidaqmx(NidaqmxSettings(server=f"127.0.0.1:{lab.server.port}", deadline=10.0, chunk=0.05), rig=lab.rig)
    listed = list(driver._system().devices)
    before = [entry["name"] for entry in driver.devices()]
    monkeypatch.setattr(driver, "_system", lambda: SimpleNamespace(devices=listed))
    lab.bench.unplug("cDAQ1Mod1")
    assert [entry["name"] for entry in driver.devices()] == [name for name in before if name != "cDAQ1Mod1"]
    driver.close()


def test_a_rig_without_hardware_is_told_as_that(lab) -> None:
    with lab.agent(settings(lab, **{"daq.server": "127.0.0.1:9", "daq.deadline": 1.0})):
        lab.until(lambda: "hardware" in told_of(lab))
        found = told_of(lab)
    assert found["hardware"]["result"] == "fails"
    assert "does not answer" in found["hardware"]["told"]
    assert "start the device server" in found["hardware"]["remedy"]


def test_an_agent_that_cannot_bring_its_rig_to_rest_is_heard_of(lab) -> None:
    heard: set[str] = set()

    def seen_again() -> bool:
        heard.update(rig["seen_at"] for rig in lab.client.get("/v1/rigs").json()["items"] if rig["name"] == lab.rig)
        return len(heard) > 3

    with lab.agent(settings(lab, **{"daq.server": "127.0.0.1:9", "daq.deadline": 1.0})):
        lab.until(seen_again)
        rig = next(rig for rig in lab.client.get("/v1/rigs").json()["items"] if rig["name"] == lab.rig)
    assert rig["present"]


def result_of(lab: Lab, what: str) -> str | None:
    """Return how something was found; None where nothing is said of it, as while the hardware does not answer."""
    return told_of(lab).get(what, {}).get("result")


def told_of(lab: Lab) -> dict[str, dict[str, str]]:
    """Return what the service knows of the rig, by what it is about."""
    rigs = [each["document"] for each in lab.client.get("/v1/rigs").json()["items"] if each["name"] == lab.rig]
    return {entry["what"]: entry for rig in rigs for entry in rig.get("findings", [])}
