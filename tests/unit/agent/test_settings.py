"""Settings: a file, then the environment, then arguments; what is wrong is named by its place."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from agent.errors import SettingsError
from agent.measuring import described
from agent.settings_file import read
from agent.sweeping import preview
from agent.triggering import Trigger, Waiting

GOOD = """
[service]
url = "http://one"
[rig]
name = "bench-1"
[[inputs]]
name = "position"
channel = "Dev1/ai0"
sensitivity = 2
[[outputs]]
name = "valve"
channel = "Dev1/ao0"
amplitude = 5.0
"""
CHAIN = GOOD.replace(
    "[[outputs]]",
    """calibration = {uncertainty_percent = 3}
[[inputs.chain]]
model = "charge amplifier"
gain = 10
calibration = {certificate = "C-18", due = "2027-03-02", uncertainty_percent = 4}
[[inputs.chain]]
gain = -0.5
calibration = {uncertainty_percent = 12}
[[outputs]]""",
)
LINE = GOOD.replace("amplitude = 5.0", 'amplitude = 1\nkind = "digital"')
CALIBRATED = GOOD.replace("sensitivity = 2", 'calibration = {due = "2027-03-02", uncertainty_percent = 1}')


def settings(tmp_path, text=GOOD, environment=None, **arguments):
    path = tmp_path / "agent.toml"
    path.write_text(text)
    return read(path, environment or {}, arguments)


def test_the_later_one_counts(tmp_path) -> None:
    assert settings(tmp_path).service.url == "http://one"
    environment = {"SERVOTUNE_AGENT_URL": "http://two", "SERVOTUNE_AGENT_KEY": "st_key"}
    assert settings(tmp_path, environment=environment).service.url == "http://two"
    made = settings(tmp_path, environment=environment, **{"service.url": "http://three"})
    assert (made.service.url, made.key()) == ("http://three", "st_key")
    assert "st_key" not in repr(made)  # no key in a log


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[rig]\nname = 1", "rig.name must be text, got 1"),
        ("[rig]", "rig.name must be given"),
        ("rig = 3", "rig must be a table, got 3"),
        ("[rg]", r"section must be one of .* got \[rg\]"),
        (GOOD.replace("amplitude = 5.0", ""), r"outputs\[0\].amplitude must be given"),
        (GOOD.replace("amplitude", "amplitud"), r"outputs\[0\]: setting must be one of .* got 'amplitud'"),
        (GOOD.replace("5.0", "-5.0"), "output valve: amplitude must be > 0, got -5"),
        (
            GOOD.replace("5.0", "5.0\nduration = 2\nsoft_start = 1\nsoft_stop = 1.5"),
            "output valve: soft_start and soft_stop must fit into duration, 2 s, got 1 and 1.5",
        ),
        (GOOD.replace("5.0", "5.0\nsafe = 6"), "output valve: safe must be within 5 V, got 6"),
        (GOOD.replace("sensitivity = 2", "sensitivity = 0"), "input position: sensitivity must be finite and not 0"),
        (GOOD.replace("sensitivity = 2", 'kind = "magic"'), "input position: kind must be one of voltage, "),
        (CHAIN.replace("gain = 10", "gain = 0"), r"position: chain\[0\].gain must be finite and not 0, got 0"),
        (CHAIN.replace("gain = 10", "gian = 10"), r"chain\[0\]: setting must be one of model, .* got 'gian'"),
        (CHAIN.replace("2027-03-02", "soon"), r"position: chain\[0\]: calibration.due must be a day"),
        (GOOD.replace("sensitivity = 2", "chain = 2"), r"chain must be written as \[\[inputs.chain\]\], got 2"),
        (CALIBRATED.replace("percent = 1", "percent = -1"), "uncertainty_percent must be finite and >= 0, got -1"),
        (
            GOOD.replace("sensitivity = 2", 'kind = "encoder"\npulses = 1024\nunit = "deg"'),
            "position: sensitivity must be given where unit is not rad, which an encoder delivers: rad for one deg",
        ),
        (LINE.replace("amplitude = 1", "amplitude = 5"), "valve: amplitude must be 1 for a digital output, got 5"),
        (LINE + "safe = 0.5", "valve: safe must be 0 or 1 for a digital output, got 0.5"),
        (LINE + "soft_stop = 0.5", "valve: soft_stop must be 0 for a digital output, got 0.5"),
        (
            CALIBRATED.replace("2027-03-02", "soon"),
            "position: calibration.due must be a day such as 2027-03-02, got 'soon'",
        ),
        (
            CALIBRATED.replace("{due", '{calibrated_on = "2027-04-02", due'),
            "position: calibration.due must not be before calibrated_on, 2027-04-02, got 2027-03-02",
        ),
        (
            GOOD.replace("Dev1/ao0", "/dev1/AI0"),
            "output valve: channel must be one that no other entry has, got '/dev1/AI0', which input position has",
        ),
        (
            GOOD + '[[inputs]]\nname = "fine"\nchannel = "Dev1/ai0"\nrange = 0.2',
            "input fine: channel must be one that no other entry has, got 'Dev1/ai0', which input position has",
        ),
        (CALIBRATED.replace("due", "until"), r"inputs\[0\].calibration: setting must be one of .* got 'until'"),
        (GOOD.replace("sensitivity = 2", "calibration = 3"), r"inputs\[0\].calibration must be a table, got 3"),
        (GOOD + '[[outputs]]\nname = "valve"\nchannel = "x"\namplitude = 1', "got 'valve' twice"),
        (
            GOOD.replace('"position"', '"load cell"'),
            "must begin with a letter .* digits and _ only, .* got 'load cell'",
        ),
        (GOOD.replace('"valve"', f'"{"v" * 65}"'), "64 at most, got 'vvv"),
        (GOOD + "[spool]\nlimit = -5", "spool.limit must be > 0, got -5"),
        (GOOD + "[spool]\nreserve = -1", "spool.reserve must be >= 0, got -1"),
        (GOOD + "[daq]\nchunk = 0", "daq.chunk must be > 0 s, got 0"),
        (GOOD + "[daq]\ndeadline = inf", "daq.deadline must be finite, got inf"),
        (GOOD + "[daq]\ndriver = 'nidacmx'", "daq.driver must be one of .*nidaqmx.*, got 'nidacmx'"),
        (GOOD + "[daq]\ndriver = 3", "daq.driver must be text, got 3"),
        ("daq = 3", "daq must be a table, got 3"),
        ("[[", "must be TOML"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, says) -> None:
    with pytest.raises(SettingsError, match=says):
        settings(tmp_path, text)


def test_a_chain_multiplies_and_its_uncertainties_add_up_as_independent_ones(tmp_path) -> None:
    (position,) = settings(tmp_path, CHAIN).inputs
    assert [stage.gain for stage in position.chain] == [10.0, -0.5]
    assert position.chain[0].calibration.certificate == "C-18"
    assert position.overall_sensitivity == -10.0  # 2 V for one unit, times 10, times -0.5
    assert position.uncertainty_percent == pytest.approx(13.0)  # 3, 4 and 12
    (alone,) = settings(tmp_path, CHAIN.replace("calibration = {uncertainty_percent = 12}", "")).inputs
    assert alone.uncertainty_percent is None
    assert settings(tmp_path, LINE).outputs[0].unit == ""


def test_a_key_is_read_anew_each_time(tmp_path) -> None:
    key = tmp_path / "key"
    made = settings(tmp_path, **{"service.key_file": str(key)})
    with pytest.raises(SettingsError, match="key_file must be readable"):
        made.key()
    key.write_text("first\n")
    assert made.key() == "first"
    key.write_text("second\n")
    assert made.key() == "second"
    with pytest.raises(SettingsError, match="a key must be given"):
        settings(tmp_path).key()


@pytest.mark.parametrize("day", ['"2027-03-02"', "2027-03-02"])
def test_a_day_is_text_or_what_toml_has_for_days(tmp_path, day) -> None:
    made = settings(tmp_path, CALIBRATED.replace('"2027-03-02"', day)).inputs[0].calibration
    assert (made.due, made.uncertainty_percent, made.certificate) == ("2027-03-02", 1.0, "")


def test_the_examples_of_the_manual_are_settings(tmp_path) -> None:
    """docs/agent.md: what its reader copies works."""
    manual = (Path(__file__).parents[3] / "docs" / "agent.md").read_text()
    agent = re.search(r"```toml\n(\[service\].*?)```", manual, re.DOTALL)
    assert agent is not None
    made = settings(tmp_path, agent[1])
    assert (made.rig.name, made.inputs[0].calibration.due, made.outputs[0].slew) == ("bench-1", "2027-03-02", 500.0)


def test_a_sensor_of_4_to_20_ma_is_zero_at_4_ma(tmp_path) -> None:
    """0 to 10 bar (IEC 60381-1): 12 mA are the middle, 5 bar; told to the service, triggers and previews alike."""
    path = tmp_path / "agent.toml"
    scaled = 'unit = "bar"\nkind = "current"\nrange = 0.02\nsensitivity = 0.0016\nzero = 0.004'
    path.write_text(GOOD.replace("sensitivity = 2", scaled))
    settings = read(path, {}, {})
    (pressure,) = settings.inputs
    milliamperes = np.array([[0.004, 0.012, 0.020]])
    channel = described(pressure)
    assert channel["scale"] * milliamperes + channel["offset"] == pytest.approx(np.array([[0.0, 5.0, 10.0]]), abs=1e-12)
    (told,) = settings.channels()["inputs"]
    assert told["offset"] == channel["offset"] == pytest.approx(-2.5)
    assert "zero" not in told  # the service knows one number for both
    shown = preview(settings.inputs, milliamperes, start=0.0, rate=1.0, width=1)
    assert shown is not None
    assert np.array(shown["channels"]["position"])[:, 0] == pytest.approx([0.0, 5.0, 10.0], abs=1e-12)
    level = Trigger(channel="position", when="enters", low=5.0)
    waiting = Waiting(level, settings.inputs, rate=1.0, before=0)
    assert waiting.take(milliamperes)
    assert waiting.at == 1


def test_a_digital_input_has_no_unit(tmp_path) -> None:
    path = tmp_path / "agent.toml"
    line = GOOD.replace('channel = "Dev1/ai0"\nsensitivity = 2', 'channel = "Dev1/port0/line0"\nkind = "digital"')
    path.write_text(line)
    settings = read(path, {}, {})
    assert described(settings.inputs[0])["unit"] == settings.channels()["inputs"][0]["unit"] == ""
    path.write_text(line.replace('kind = "digital"', 'kind = "digital"\nunit = "V"'))
    with pytest.raises(SettingsError, match="input position: unit must be left out for a digital input"):
        read(path, {}, {})
