"""What a recording says of the clock of its channels, and what is said where devices cannot share one."""

from __future__ import annotations

import pytest

from agent.errors import AttemptError
from agent.settings import InputSettings, OutputSettings
from tests.integration.agent.test_families import measured, rig

UNSAID = "delays of converters and filters are not taken out"


def inputs(*channels: str, **more: str) -> list[InputSettings]:
    entries = [InputSettings(name=f"in{i}", channel=channel, range=5.0) for i, channel in enumerate(channels)]
    counted = [InputSettings(name=name, channel=channel, kind="digital") for name, channel in more.items()]
    return entries + counted


def test_modules_of_a_chassis_share_its_clock_and_the_output_follows() -> None:
    devices = {"cDAQ1Mod1": "NI 9234", "cDAQ1Mod2": "NI 9260", "cDAQ1Mod3": "NI 9215"}
    output = OutputSettings(name="valve", channel="cDAQ1Mod2/ao0", amplitude=4.0)
    with rig(devices) as (_, hardware):
        told = hardware.synchronisation(inputs("cDAQ1Mod1/ai0", "cDAQ1Mod3/ai0"), output).document()
    assert told == {
        "clock": "cDAQ1",
        "channels": ("in0", "in1", "valve"),
        "following": ("valve",),
        "words": f"in0 and in1 on the sample clock of cDAQ1; valve on the same clock, led there; {UNSAID}",
    }


def test_one_converter_takes_its_inputs_in_turn_and_lines_follow() -> None:
    with rig({"Dev1": "PCIe-6363"}) as (_, hardware):
        told = hardware.synchronisation(inputs("Dev1/ai0", "Dev1/ai1", limit="Dev1/port0/line0"), None).document()
        alone = hardware.synchronisation(inputs("Dev1/ai0"), None).document()
    assert (told["following"], told["in_turn"]) == (("limit",), ("in0", "in1"))
    assert told["words"].startswith(
        "in0 and in1 on the sample clock of Dev1; limit on the same clock, led there; in0 and "
    )
    assert "in_turn" not in alone


@pytest.mark.parametrize(
    ("first", "second", "units"),
    [("USB-6211", "USB-6211", ("Dev1", "Dev2")), ("PCI-6221", "USB-6211", ("Dev1", "Dev2"))],
)
def test_inputs_of_devices_that_nothing_connects_are_refused_by_name(first, second, units) -> None:
    entries = inputs("Dev1/ai0", "Dev1/ai1", "Dev2/ai0")
    with rig({"Dev1": first, "Dev2": second}) as (bench, hardware):
        for attempt in (lambda: measured(hardware, entries, None), lambda: hardware.trial(entries, rate=1000.0)):
            with pytest.raises(
                AttemptError, match=r"Dev1 \(in0, in1\) and Dev2 \(in2\) must share a sample clock"
            ) as refused:
                attempt()
            assert refused.value.code == "no_common_clock"
            assert "NI-DAQmx -200558" in refused.value.what
            assert refused.value.remedy.startswith("measure their channels one after the other")
        assert not bench.tasks


def test_an_output_and_a_line_of_another_device_are_refused_by_name() -> None:
    output = OutputSettings(name="valve", channel="Dev2/ao0", amplitude=4.0)
    with (
        rig({"Dev1": "USB-6211", "Dev2": "USB-6211"}) as (_, hardware),
        pytest.raises(AttemptError, match=r"Dev1 \(in0\) and Dev2 \(valve\) must share a sample clock.*-89125"),
    ):
        measured(hardware, inputs("Dev1/ai0"), output)
    with rig({"Dev1": "PCIe-6363", "cDAQ1Mod1": "NI 9401"}) as (bench, hardware):
        with pytest.raises(AttemptError, match=r"Dev1 \(in0\) and cDAQ1 \(limit\) must share a sample clock"):
            measured(hardware, inputs("Dev1/ai0", limit="cDAQ1Mod1/port0/line0"), None)
        assert not bench.tasks


def test_boards_with_trigger_lines_share_a_clock() -> None:
    with rig({"Dev1": "PCIe-6363", "Dev2": "PCIe-6321"}) as (_, hardware):
        entries = inputs("Dev1/ai0", "Dev2/ai0")
        values, _ = measured(hardware, entries, None)
        assert values.shape[0] == 2
        assert hardware.synchronisation(entries, None).document()["clock"] == "Dev1 and Dev2"


def test_the_facts_of_a_recording_say_so(lab) -> None:
    with lab.agent():
        done = lab.wait(lab.ask())
    told = done["attempts"][0]["facts"]["synchronisation"]
    assert told["channels"] == ["loopback", "position", "valve"]
    assert told["clock"] == "cDAQ1"
