"""What the driver and the device server complain about becomes a word for programs and a sentence that says what to do."""

from __future__ import annotations

import grpc
import pytest
from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.errors import DaqError, DaqNotFoundError, RpcError

from agent.drivers.nidaqmx.errors import DRIVER_ERRORS, translated
from agent.errors import AttemptError


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("PAL_RESOURCE_RESERVED", "device_busy"),
        ("PAL_TRANSFER_ABORTED", "device_gone"),
        ("DEV_CANNOT_BE_ACCESSED", "device_gone"),
        ("DEV_ABSENT_OR_UNAVAILABLE", "device_gone"),
        ("DEV_ABSENT_OR_UNAVAILABLE_ROUTING", "device_gone"),
        ("DEVICE_REMOVED", "device_gone"),
        ("HW_UNEXPECTEDLY_POWERED_OFF_AND_ON", "device_gone"),
        ("NETWORK_STATUS_CONNECTION_LOST", "device_gone"),
        ("RUNTIME_ABORTED_ROUTING", "aborted"),
        ("ROUTE_NOT_SUPPORTED_BY_HW_ROUTING", "no_route"),
        ("INVALID_ROUTING_SOURCE_TERMINAL_NAME_ROUTING", "no_route"),
        ("INVALID_DEVICE_ID", "unknown_device"),
        ("PHYSICAL_CHAN_DOES_NOT_EXIST", "unknown_channel"),
        ("INVALID_ATTRIBUTE_VALUE", "unsupported_setting"),
        ("PHYS_CHAN_MEAS_TYPE", "unsupported_setting"),
        ("SAMPLES_NO_LONGER_AVAILABLE", "overrun"),
        ("ACQ_STOPPED_TO_PREVENT_INPUT_BUFFER_OVERWRITE", "overrun"),
        ("INPUT_FIFO_OVERFLOW_2", "overrun"),
        ("ADC_OVERRUN", "overrun"),
        ("GEN_STOPPED_TO_PREVENT_REGEN_OF_OLD_SAMPLES", "underrun"),
        ("OUTPUT_FIFO_UNDERFLOW_2", "underrun"),
        ("DAC_UNDERFLOW", "underrun"),
        ("SAMPLES_NOT_YET_AVAILABLE", "timeout"),
        ("WAIT_UNTIL_DONE_DOES_NOT_INDICATE_DONE", "timeout"),
        ("INVALID_AO_DATA_WRITE", "drive_limit"),
        ("PLL_BECAME_UNLOCKED", "clock_lost"),
        ("TEDS_SENSOR_NOT_DETECTED", "no_teds"),
        ("TEDS_NOT_SUPPORTED", "no_teds"),
    ],
)
def test_the_drivers_numbers_are_what_ni_calls_them(name: str, word: str) -> None:
    """The names are those of nidaqmx.error_codes, which NI generates from its driver."""
    number = int(DAQmxErrors[name].value)
    with pytest.raises(AttemptError, match=f"NI-DAQmx {number}: what it says - .+") as caught, translated():
        raise DaqError("what it says\nDevice: Mod1", number)
    assert caught.value.code == word


def test_every_number_is_one_that_the_driver_has() -> None:
    known = {int(entry.value) for entry in DAQmxErrors}
    assert set(DRIVER_ERRORS) <= known
    for word, advice in DRIVER_ERRORS.values():
        assert word.isidentifier()
        assert advice.strip()


def test_a_number_without_a_sentence_is_told_as_it_is() -> None:
    with pytest.raises(AttemptError, match=r"NI-DAQmx -200956: .* look the number up") as caught, translated():
        raise DaqError("", -200956)
    assert caught.value.code == "daqmx_200956"


@pytest.mark.parametrize(
    ("status", "word"),
    [
        (grpc.StatusCode.UNAVAILABLE, "server_unreachable"),
        (grpc.StatusCode.DEADLINE_EXCEEDED, "server_unreachable"),
        (grpc.StatusCode.UNIMPLEMENTED, "server_too_old"),
        (grpc.StatusCode.RESOURCE_EXHAUSTED, "server_overloaded"),
        (grpc.StatusCode.UNAUTHENTICATED, "server_refuses"),
        (grpc.StatusCode.FAILED_PRECONDITION, "server_restarted"),
    ],
)
def test_a_device_server_that_says_no_is_not_one_that_is_silent(status: grpc.StatusCode, word: str) -> None:
    with pytest.raises(AttemptError, match=f"{status.name}: why") as caught, translated():
        raise RpcError(status, "why")
    assert caught.value.code == word


def test_a_pc_without_a_driver_is_told_both_ways_out() -> None:
    with pytest.raises(AttemptError, match=r"must be installed on this PC, or daq.server name") as caught, translated():
        raise DaqNotFoundError("Could not find an installation of NI-DAQmx.")
    assert caught.value.code == "no_driver"
