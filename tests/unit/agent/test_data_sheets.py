"""The data sheet of a real accelerometer, and of simulated ones, held against entries of inputs."""

from __future__ import annotations

import pytest

from agent.data_sheets import DataSheet, differences
from agent.errors import AttemptError
from agent.settings import InputSettings
from rig_simulator.sensors import Teds

# Brüel & Kjær 4507-B: the virtual data sheet in github.com/SDL-MCI/SDLMA-Core (src/sdlma_teds/teds.py), without the head of the
# file; its 100 mV/(m/s²) version, of which this one has 95.86.
REAL = bytes.fromhex("11c06644140979006480e63944255be14412290be94610026d01800300")
FITTING = {"model": "4507-B-004", "serial": "30985", "sensitivity": 0.09586, "unit": "m/s**2"}


def entry(**given: object) -> InputSettings:
    return InputSettings(name="a", channel="Dev1/ai0", kind="acceleration", **given)  # type: ignore[arg-type] # its settings


def test_a_real_sensor_is_read() -> None:
    sheet = DataSheet.of(REAL)
    assert (sheet.manufacturer, sheet.model, sheet.version, sheet.serial) == (17, 4507, "B5", 30985)
    assert sheet.sensitivity == pytest.approx(0.0958585, rel=1e-6)


@pytest.mark.parametrize("sensitivity", [5e-7, 0.00102, 0.0102, 0.1, 170.0])
def test_what_a_simulated_sensor_says_is_read_within_its_resolution(sensitivity) -> None:
    made = Teds(manufacturer=16381, model=32767, serial=16777215, version=63, letter="Z", sensitivity=sensitivity)
    sheet = DataSheet.of(made.bits())
    assert (sheet.manufacturer, sheet.model, sheet.version, sheet.serial) == (16381, 32767, "Z63", 16777215)
    assert sheet.sensitivity == pytest.approx(sensitivity, rel=0.00015)


@pytest.mark.parametrize(
    "change",
    [
        lambda bits: bits | 1 << 64,  # another selector
        lambda bits: bits ^ 1 << 66,  # another template
        lambda bits: bits | 1 << 74,  # a force transducer
        lambda bits: bits | 1 << 75,  # further functions
        lambda bits: bits & (1 << 88) - 1,  # cut off within the sensitivity
    ],
)
def test_of_other_templates_only_the_identity_is_read(change) -> None:
    bits = change(int.from_bytes(REAL, "little"))
    sheet = DataSheet.of(bits.to_bytes((bits.bit_length() + 7) // 8, "little"))
    assert (sheet.serial, sheet.sensitivity) == (30985, None)
    assert "V/(m/s²)" not in sheet.words


def test_a_data_sheet_that_is_too_short_is_refused() -> None:
    with pytest.raises(AttemptError, match="must have at least 8 bytes, got 7") as refused:
        DataSheet.of(REAL[:7])
    assert refused.value.code == "no_teds"


@pytest.mark.parametrize(
    ("change", "told", "grave"),
    [
        ({}, None, False),
        ({"serial": "LW-030985", "model": ""}, None, False),
        ({"serial": "", "sensitivity": 0.94, "unit": "g_0"}, None, False),
        ({"sensitivity": 0.0965}, None, False),
        ({"sensitivity": -0.0958}, None, False),  # mounted the other way round
        ({"sensitivity": 96.0, "unit": "mm/s**2"}, None, False),  # a unit that is not known here is not compared
        ({"serial": "30986"}, "the sensor has serial 30985, its entry 30986", True),
        ({"model": "352C33"}, "the sensor says model 4507, its entry 352C33", False),
        ({"sensitivity": 0.1}, "the sensor says 0.09586 V for one m/s**2, its entry 0.1", False),
        ({"sensitivity": 0.94}, "the sensor says 0.09586 V for one m/s**2, its entry 0.94", True),
        ({"sensitivity": 0.1, "unit": "g_0"}, "the sensor says 0.9401 V for one g_0, its entry 0.1", True),
    ],
)
def test_what_an_entry_says_otherwise_is_told(change, told, grave) -> None:
    found = list(differences(entry(**FITTING | change), DataSheet.of(REAL)))
    assert [(one.told, one.grave) for one in found] == ([] if told is None else [(told, grave)])
