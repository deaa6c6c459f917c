"""The rig through NI-DAQmx: the driver of this PC, or an NI gRPC Device Server; inputs and output on one clock, one start.

Values are volts as the module delivers them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import nidaqmx
import numpy as np
from nidaqmx.constants import AcquisitionType, RegenerationMode
from nidaqmx.errors import Error
from nidaqmx.stream_readers import AnalogMultiChannelReader
from nidaqmx.stream_writers import AnalogMultiChannelWriter

from agent.drivers.interface import Channel, Driver, Running, Samples
from agent.drivers.nidaqmx.deadline import channel
from agent.drivers.nidaqmx.errors import translated
from agent.drivers.nidaqmx.inputs import KINDS, add_input
from agent.drivers.nidaqmx.settings import NidaqmxSettings
from agent.errors import AttemptError
from agent.safety import Drive, way_home
from agent.settings import InputSettings, OutputSettings

_WHOLE = 2_000_000
"""Samples (of all channels) up to which a run is finite, and its drive is written before it starts."""
_AHEAD = 4.0
"""s of a longer drive that are written ahead of what is played."""
_HOME_RATE = 1000.0


class Nidaqmx(Driver):
    """The devices of a rig; the rig's name is part of the names of its tasks, by which what an earlier agent left is found."""

    settings = NidaqmxSettings
    kinds = KINDS

    def __init__(self, settings: NidaqmxSettings, *, rig: str) -> None:
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
        """Return the modules that are there."""
        with translated():
            return [
                {
                    "name": device.name,
                    "model": device.product_type,
                    "serial": f"{device.serial_num:08X}",
                    "simulated": bool(device.is_simulated),
                }
                for device in self._system().devices
            ]

    def channels(self) -> list[Channel]:
        """Return the analog channels of all modules; an output tells no range before a task has it."""
        found = []
        with translated():
            for device in self._system().devices:
                inputs = device.ai_physical_chans.channel_names
                ranges = tuple(sorted({abs(limit) for limit in device.ai_voltage_rngs})) if inputs else ()
                found += [Channel(name=name, direction="input", ranges=ranges) for name in inputs]
                found += [Channel(name=name, direction="output") for name in device.ao_physical_chans.channel_names]
        return found

    def _system(self) -> Any:
        if self._channel is None:
            return nidaqmx.system.System.local()
        return nidaqmx.system.System.remote(self._options("")["grpc_options"])

    def clean(self) -> None:
        """Clear the tasks that an agent of this rig has left on a device server; the driver of a PC does so by itself."""
        if self._channel is None:
            return
        with translated():
            for name in (self._input, self._output):
                self._task(name).close()

    def rest(self, output: OutputSettings, *, level: float | None = None) -> None:
        """Bring an output to its safe value, softly where it is known where it stands."""
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
        """Prepare the inputs; the rate that the hardware really has is then known."""
        with ExitStack() as stack:
            with translated():
                task = stack.enter_context(_closing(self._task(self._input)))
                for entry in inputs:
                    add_input(task, entry)
                finite = rate * seconds * len(inputs) <= _WHOLE
                task.timing.cfg_samp_clk_timing(rate, sample_mode=_mode(finite=finite), samps_per_chan=1000)
                actual = float(task.timing.samp_clk_rate)
            yield NidaqmxRunning(
                self, self._settings, stack, task, inputs=inputs, asked=rate, rate=actual, finite=finite
            )

    def output_task(self) -> Any:
        """Return the task of the outputs."""
        return self._task(self._output)

    def _task(self, name: str) -> Any:
        return nidaqmx.Task(name, **self._options(name))

    def _options(self, name: str) -> dict[str, Any]:
        if self._channel is None:
            return {}
        return {"grpc_options": nidaqmx.GrpcSessionOptions(self._channel, name)}


class NidaqmxRunning(Running):
    """Inputs that are ready, and what they deliver once they are started."""

    def __init__(
        self,
        hardware: Nidaqmx,
        settings: NidaqmxSettings,
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
        """Return the next samples, shape (channels, n); none when the run is over."""
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


@contextmanager
def _closing(task: Any) -> Iterator[Any]:
    """Close a task, whether the hardware still answers or not: what has gone wrong before is told, not this."""
    try:
        yield task
    finally:
        with contextlib.suppress(Error):
            task.close()
