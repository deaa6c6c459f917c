"""A run on NI hardware: inputs, what follows their clock, and an output that begins with them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, Protocol

import numpy as np
from nidaqmx.constants import AcquisitionType, RegenerationMode, TaskMode
from nidaqmx.errors import Error
from nidaqmx.stream_readers import AnalogMultiChannelReader

from agent.drivers.interface import Running, Samples
from agent.drivers.nidaqmx.errors import translated
from agent.drivers.nidaqmx.followers import Follower
from agent.drivers.nidaqmx.outputs import add_output, follow, write
from agent.drivers.nidaqmx.settings import NidaqmxSettings
from agent.drivers.nidaqmx.sharing import one_clock
from agent.errors import AttemptError
from agent.safety import Drive
from agent.settings import InputSettings, OutputSettings

_AHEAD = 4.0
"""s of a longer drive that are written ahead of what is played."""
_BEHIND, _MOST_BEHIND = 20.0, 16_000_000
"""s, and samples of all channels, that a driver keeps while a disk or another program holds this one up; at least ``_AHEAD`` s."""


class Hardware(Protocol):
    """What a run needs of its driver."""

    def output_task(self) -> Any:
        """Return the task of the outputs."""

    def device_of(self, channel: str) -> Any:
        """Return the device of a physical channel."""


class NidaqmxRunning(Running):
    """Inputs that are ready, and what they deliver once they are started."""

    def __init__(
        self,
        hardware: Hardware,
        settings: NidaqmxSettings,
        stack: ExitStack,
        task: Any,
        *,
        inputs: Sequence[InputSettings],
        followers: Sequence[Follower],
        asked: float,
        rate: float,
        finite: bool,
    ) -> None:
        self._hardware, self._settings, self._stack, self._task = hardware, settings, stack, task
        self._inputs, self._followers = inputs, followers
        self._asked, self._finite = asked, finite
        self.rate = rate
        """samples/s, as the hardware has it."""
        self._drive: Drive | None = None
        self._output: Any = None
        self._written = self._read = 0
        self._reader: Any = None
        self._samples = 0

    def prepare(self, samples: int, drive: Drive | None) -> None:
        """Set the length of the run, and arm its drive: it begins with the inputs."""
        self._samples, self._drive = samples, drive
        with self._judged(drive.output if drive is not None else None):
            behind = max(min(_BEHIND * self.rate, _MOST_BEHIND / len(self._inputs)), _AHEAD * self.rate + 10_000)
            buffer = samples if self._finite else int(behind)
            timing = {"sample_mode": mode(finite=self._finite), "samps_per_chan": buffer}
            self._task.timing.cfg_samp_clk_timing(self._asked, **timing)
            self._task.control(TaskMode.TASK_RESERVE)
            for follower in self._followers:
                follower.arm(self._task.timing.samp_clk_term, self.rate, timing)
            if drive is not None:
                self._arm(drive, samples)

    def verify(self, output: OutputSettings | None) -> None:
        """Let the driver judge and reserve everything, the clocks of the output with it; nothing is started."""
        with self._judged(output):
            self._task.control(TaskMode.TASK_RESERVE)
            timing = {"sample_mode": AcquisitionType.FINITE, "samps_per_chan": 1000}
            for follower in self._followers:
                follower.follow(self._task.timing.samp_clk_term, self.rate, timing)
            if output is not None:
                self._follow(output, timing)

    @contextmanager
    def _judged(self, output: OutputSettings | None) -> Iterator[None]:
        entries: list[InputSettings | OutputSettings] = [*self._inputs, *([output] if output is not None else [])]
        with translated(), one_clock(self._hardware.device_of, entries):
            yield

    def _arm(self, drive: Drive, samples: int) -> None:
        ahead = samples if self._finite else min(samples, int(self.rate * _AHEAD))
        timing = {"sample_mode": mode(finite=self._finite), "samps_per_chan": ahead}
        task = self._output = self._follow(drive.output, timing)
        if not self._finite:
            task.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION
        self._write(ahead)
        task.start()

    def _follow(self, output: OutputSettings, timing: dict[str, Any]) -> Any:
        """Return a task of the output that runs with the inputs."""
        device = self._hardware.device_of(output.channel)
        if output.kind != "digital" and not device.ao_samp_clk_supported:
            raise AttemptError(
                "unsupported_setting",
                f"output {output.name} must have a sample clock to play a drive, {device.product_type} sets its values by "
                "software: take an output of another device",
            )
        task = self._stack.enter_context(closing(self._hardware.output_task()))
        add_output(task, output, device)
        follow(task, self._task, output=output, settings=self._settings, rate=self.rate, timing=timing)
        return task

    def _write(self, count: int) -> None:
        assert self._drive is not None
        block = self._drive.block(self._written, count)
        if block.size < count:  # after its end the drive rests, until the inputs have all their samples
            block = np.concatenate([block, np.full(count - block.size, self._drive.output.safe)])
        write(self._output, self._drive.output, block, now=False, timeout=self._settings.deadline)
        self._written += count

    def start(self) -> None:
        """Let inputs and drive begin."""
        with translated():
            self._reader = AnalogMultiChannelReader(self._task.in_stream)
            self._task.start()

    def read(self) -> Samples:
        """Return the next samples, shape (channels, n); none when the run is over."""
        count = min(max(int(self.rate * self._settings.chunk), 1), self._samples - self._read)
        if not count:
            return np.empty((len(self._inputs), 0))
        analog = np.empty((len(self._inputs) - sum(len(follower.names) for follower in self._followers), count))
        with translated():
            patience = self._settings.deadline + 2.0 * count / self.rate
            got = self._reader.read_many_sample(analog, count, timeout=patience)
            others: dict[str, Samples] = {}
            for follower in self._followers:
                others |= zip(follower.names, follower.read(got, patience), strict=True)
            self._read += got
        self._look_after_output()
        if not others:
            return analog[:, :got]
        rows = iter(analog[:, :got])
        return np.array([others[entry.name] if entry.name in others else next(rows) for entry in self._inputs])

    def _look_after_output(self) -> None:
        """Write what the output needs next, and hear what has become of it: a module that was pulled out says nothing by itself."""
        if self._drive is None:
            return
        with translated(f"output {self._drive.output.name} ({self._drive.output.channel})"):
            self._output.is_task_done()  # raises what has gone wrong
            behind = self._read + int(self.rate * _AHEAD) - self._written
            if behind > 0 and not self._finite:
                self._write(behind)

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


def mode(*, finite: bool) -> Any:
    """Return the sample mode of a run."""
    return AcquisitionType.FINITE if finite else AcquisitionType.CONTINUOUS


@contextmanager
def closing(task: Any) -> Iterator[Any]:
    """Close a task, whether the hardware still answers or not: what has gone wrong before is told, not this."""
    try:
        yield task
    finally:
        with contextlib.suppress(Error):
            task.close()
