"""The rig through NI-DAQmx: the driver of this PC, or an NI gRPC Device Server; inputs and output on one clock, one start.

Values are volts as the module delivers them: IEPE channels are made with a sensitivity of exactly 1 V for their unit, so that
the calibration stays with the recording and can be corrected later.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import nidaqmx
import numpy as np
import numpy.typing as npt
from nidaqmx.constants import (
    AccelSensitivityUnits,
    AccelUnits,
    AcquisitionType,
    BridgeUnits,
    Coupling,
    ExcitationSource,
    ForceIEPESensorSensitivityUnits,
    ForceUnits,
    RegenerationMode,
    VelocityIEPESensorSensitivityUnits,
    VelocityUnits,
)
from nidaqmx.errors import DaqError, DaqNotFoundError, DaqNotSupportedError, Error, RpcError
from nidaqmx.stream_readers import AnalogMultiChannelReader
from nidaqmx.stream_writers import AnalogMultiChannelWriter

from agent.deadline import channel
from agent.errors import AttemptError, of_driver, of_server
from agent.safety import Drive, way_home
from agent.settings import DaqSettings, DeviceSettings, InputSettings, OutputSettings

Samples = npt.NDArray[np.float64]

_WHOLE = 2_000_000
"""Samples (of all channels) up to which a run is finite, and its drive is written before it starts."""
_AHEAD = 4.0
"""s of a longer drive that are written ahead of what is played."""
_HOME_RATE = 1000.0


class Hardware:
    """The devices of a rig.

    Parameters
    ----------
    settings : DaqSettings
    rig : str
        Part of the names of the tasks, by which an agent finds what an earlier one has left behind.
    """

    def __init__(self, settings: DaqSettings, *, rig: str) -> None:
        self._settings = settings
        self._channel = channel(settings.server, margin=settings.deadline) if settings.server else None
        word = "".join(letter if letter.isalnum() else "-" for letter in rig)
        self._input, self._output = f"servotune-{word}-in", f"servotune-{word}-out"

    @property
    def description(self) -> str:
        """How the hardware is reached."""
        return f"NI gRPC Device Server {self._settings.server}" if self._settings.server else "NI-DAQmx of this PC"

    def close(self) -> None:
        """Let go of the device server."""
        if self._channel is not None:
            self._channel.close()

    def devices(self) -> list[dict[str, Any]]:
        """Return the modules that are there.

        Raises
        ------
        AttemptError
            When the hardware cannot be reached.
        """
        with translated():
            system = (
                nidaqmx.system.System.remote(self._options("")["grpc_options"])
                if self._channel is not None
                else nidaqmx.system.System.local()
            )
            return [
                {
                    "name": device.name,
                    "model": device.product_type,
                    "serial": f"{device.serial_num:08X}",
                    "simulated": bool(device.is_simulated),
                }
                for device in system.devices
            ]

    def check(self, expected: Sequence[DeviceSettings]) -> list[dict[str, Any]]:
        """Return the modules that are there, having made sure that they are the right ones.

        Raises
        ------
        AttemptError
            `unknown_device`, `wrong_device`.
        """
        found = self.devices()
        there = {device["name"]: device for device in found}
        for device in expected:
            got = there.get(device.name)
            if got is None:
                known = ", ".join(there) or "none"
                raise AttemptError(
                    "unknown_device", f"device {device.name} must be there ({known}): check cable and power"
                )
            for what in ("model", "serial"):
                wanted = getattr(device, what)
                if wanted and wanted.upper().lstrip("0") != got[what].upper().lstrip("0"):
                    raise AttemptError(
                        "wrong_device",
                        f"{what} of {device.name} must be {wanted}, got {got[what]}: the calibration is another one's",
                    )
        return found

    def clean(self) -> None:
        """Clear the tasks that an agent of this rig has left on a device server; the driver of a PC does so by itself."""
        if self._channel is None:
            return
        with translated():
            for name in (self._input, self._output):
                self._task(name).close()

    def rest(self, output: OutputSettings, *, level: float | None = None) -> None:
        """Bring an output to its safe value, softly where it is known where it stands.

        Raises
        ------
        AttemptError
            When the hardware does not answer: the output may stand anywhere.
        """
        start = output.safe if level is None else level
        with translated(), self._task(self._output) as task:
            task.ao_channels.add_ao_voltage_chan(output.channel, min_val=-output.amplitude, max_val=output.amplitude)
            task.timing.cfg_samp_clk_timing(_HOME_RATE, sample_mode=AcquisitionType.FINITE, samps_per_chan=4)
            way = way_home(output, start, float(task.timing.samp_clk_rate))
            task.timing.cfg_samp_clk_timing(_HOME_RATE, sample_mode=AcquisitionType.FINITE, samps_per_chan=way.size)
            AnalogMultiChannelWriter(task.out_stream, auto_start=False).write_many_sample(way[None, :])
            task.start()
            task.wait_until_done(way.size / _HOME_RATE + self._settings.deadline)
            task.stop()

    @contextmanager
    def run(self, inputs: Sequence[InputSettings], rate: float, *, seconds: float) -> Iterator[Running]:
        """Prepare the inputs; the rate that the hardware really has is then known.

        Parameters
        ----------
        seconds : float
            Length of the run, roughly.
        """
        with ExitStack() as stack:
            with translated():
                task = stack.enter_context(_closing(self._task(self._input)))
                for entry in inputs:
                    _add(task, entry)
                finite = rate * seconds * len(inputs) <= _WHOLE
                task.timing.cfg_samp_clk_timing(rate, sample_mode=_mode(finite=finite), samps_per_chan=1000)
                actual = float(task.timing.samp_clk_rate)
            yield Running(self, self._settings, stack, task, inputs=inputs, asked=rate, rate=actual, finite=finite)

    def output_task(self) -> Any:
        """Return the task of the outputs."""
        return self._task(self._output)

    def _task(self, name: str) -> Any:
        return nidaqmx.Task(name, **self._options(name))

    def _options(self, name: str) -> dict[str, Any]:
        if self._channel is None:
            return {}
        return {"grpc_options": nidaqmx.GrpcSessionOptions(self._channel, name)}


class Running:
    """Inputs that are ready, and what they deliver once they are started."""

    def __init__(
        self,
        hardware: Hardware,
        settings: DaqSettings,
        stack: ExitStack,
        task: Any,
        *,
        inputs: Sequence[InputSettings],
        asked: float,
        rate: float,
        finite: bool,
    ) -> None:
        self._hardware, self._settings, self._stack, self._task = hardware, settings, stack, task
        self._inputs, self._asked, self._finite = inputs, asked, finite
        self.rate = rate
        """samples/s, as the hardware has it."""
        self._drive: Drive | None = None
        self._writer: Any = None
        self._output: Any = None
        self._written = self._read = 0
        self._reader: Any = None
        self._samples = 0

    def prepare(self, samples: int, drive: Drive | None) -> None:
        """Set the length of the run, and arm its drive: it begins with the inputs."""
        self._samples, self._drive = samples, drive
        with translated():
            buffer = samples if self._finite else int(self.rate * _AHEAD) + 10_000
            self._task.timing.cfg_samp_clk_timing(
                self._asked, sample_mode=_mode(finite=self._finite), samps_per_chan=buffer
            )
            if drive is not None:
                self._arm(drive, samples)

    def _arm(self, drive: Drive, samples: int) -> None:
        task = self._output = self._stack.enter_context(_closing(self._hardware.output_task()))
        output = drive.output
        task.ao_channels.add_ao_voltage_chan(output.channel, min_val=-output.amplitude, max_val=output.amplitude)
        ahead = samples if self._finite else min(samples, int(self.rate * _AHEAD))
        task.timing.cfg_samp_clk_timing(
            self.rate,
            source=self._settings.clock or self._task.timing.samp_clk_term,
            sample_mode=_mode(finite=self._finite),
            samps_per_chan=ahead,
        )
        if not self._finite:
            task.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION
        # asked of the driver: within a chassis the terminals are the chassis', not the module's
        start = self._settings.trigger or self._task.triggers.start_trigger.term
        task.triggers.start_trigger.cfg_dig_edge_start_trig(start)
        self._writer = AnalogMultiChannelWriter(task.out_stream, auto_start=False)
        self._write(ahead)
        task.start()

    def _write(self, count: int) -> None:
        assert self._drive is not None
        block = self._drive.block(self._written, count)
        if block.size < count:  # after its end the drive rests, until the inputs have all their samples
            block = np.concatenate([block, np.full(count - block.size, self._drive.output.safe)])
        self._writer.write_many_sample(np.ascontiguousarray(block[None, :]), timeout=self._settings.deadline)
        self._written += count

    def start(self) -> None:
        """Let inputs and drive begin."""
        with translated():
            self._reader = AnalogMultiChannelReader(self._task.in_stream)
            self._task.start()

    def read(self) -> Samples:
        """Return the next samples, shape (channels, n); none when the run is over.

        Raises
        ------
        AttemptError
            With what the hardware complains about.
        """
        count = min(max(int(self.rate * self._settings.chunk), 1), self._samples - self._read)
        block = np.empty((len(self._inputs), count))
        if not count:
            return block
        with translated():
            patience = self._settings.deadline + 2.0 * count / self.rate
            got = self._reader.read_many_sample(block, count, timeout=patience)
            self._read += got
            if self._drive is not None and not self._finite:
                behind = self._read + int(self.rate * _AHEAD) - self._written
                if behind > 0:
                    self._write(behind)
        return block[:, :got]

    def halt(self) -> float | None:
        """Stop the drive, and return where it stands then; None when nothing is driven.

        The output is ahead of the samples that have been read, by a chunk and more: the way home must begin where it really
        is, so the task is asked how far it has come, right before it is stopped.
        """
        if self._drive is None:
            return None
        played = self._read
        with contextlib.suppress(AttemptError), translated():
            played = int(self._output.out_stream.total_samp_per_chan_generated)
            self._output.stop()
        if not played:
            return self._drive.output.safe
        return float(self._drive.block(min(played, self._drive.samples) - 1, 1)[0])


def _mode(*, finite: bool) -> Any:
    return AcquisitionType.FINITE if finite else AcquisitionType.CONTINUOUS


def _add(task: Any, entry: InputSettings) -> None:
    """Add an input that delivers volts."""
    limits = {"min_val": -entry.range, "max_val": entry.range}
    channels = task.ai_channels
    current = {
        "current_excit_source": ExcitationSource.INTERNAL,
        "current_excit_val": entry.excitation or 0.002,
    }
    match entry.kind:
        case "voltage":
            channels.add_ai_voltage_chan(entry.channel, **limits)
        case "acceleration":
            made = channels.add_ai_accel_chan(
                entry.channel,
                units=AccelUnits.G,
                sensitivity=1000.0,
                sensitivity_units=AccelSensitivityUnits.MILLIVOLTS_PER_G,
                **limits,
                **current,
            )
            made.ai_coupling = Coupling.AC
        case "force":
            channels.add_ai_force_iepe_chan(
                entry.channel,
                units=ForceUnits.NEWTONS,
                sensitivity=1000.0,
                sensitivity_units=ForceIEPESensorSensitivityUnits.MILLIVOLTS_PER_NEWTON,
                **limits,
                **current,
            )
        case "velocity":
            channels.add_ai_velocity_iepe_chan(
                entry.channel,
                units=VelocityUnits.METERS_PER_SECOND,
                sensitivity=1.0,  # mV/(mm/s) is V/(m/s)
                sensitivity_units=VelocityIEPESensorSensitivityUnits.MILLIVOLTS_PER_MILLIMETER_PER_SECOND,
                **limits,
                **current,
            )
        case _:
            channels.add_ai_bridge_chan(
                entry.channel,
                units=BridgeUnits.VOLTS_PER_VOLT,
                voltage_excit_val=entry.excitation or 2.5,
                **limits,
            )


@contextmanager
def _closing(task: Any) -> Iterator[Any]:
    """Close a task, whether the hardware still answers or not: what has gone wrong before is told, not this."""
    try:
        yield task
    finally:
        with contextlib.suppress(Error):
            task.close()


@contextmanager
def translated() -> Iterator[None]:
    """Turn what nidaqmx raises into a word and a sentence."""
    try:
        yield
    except (DaqNotFoundError, DaqNotSupportedError) as error:
        detail = "NI-DAQmx must be installed on this PC, or daq.server name an NI gRPC Device Server"
        raise AttemptError("no_driver", detail) from error
    except RpcError as error:
        raise of_server(getattr(error.rpc_code, "name", str(error.rpc_code)), error.description) from error
    except DaqError as error:
        raise of_driver(int(error.error_code), str(error)) from error
