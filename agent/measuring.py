"""One attempt on the rig, from the claim to the last sample on disk; whatever happens, the output comes to rest."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt

from agent.drivers.interface import Driver, Running
from agent.drives import signal_of
from agent.errors import AttemptError
from agent.lease import Lease
from agent.plan import LONGEST_LIVE, Plan, plan_of
from agent.safety import Drive
from agent.settings import InputSettings, OutputSettings, Settings
from agent.spool import USUAL_BYTES, Recorder, Run, Spool
from agent.sweeping import preview, sweeps
from agent.triggering import Waiting
from agent.waking import WakingEvent
from agent.watching import Watch

Samples = npt.NDArray[np.float64]
Confirm = Callable[[str, Sequence[WakingEvent]], bool]

_log = logging.getLogger(__name__)
_MOST_SEGMENTS = 10_000
_GIVEN = {"digital": "state"}
"""Kind of an output -> the quantity that it gives, where the kind is not its name."""
_MOST_TOLD = 1000
"""Numbers of a drive that its facts repeat."""
_STRETCHES, _OF_SWEEP = 20, 200
"""Of one preview, and of one sweep."""
_OFF = 1e-4
"""Share by which the sample clock of hardware may be off: NI states 50 ppm for most, crystals of controllers have 100."""


@dataclass(slots=True, kw_only=True)
class Outcome:
    """How an attempt went; ``resting`` is False where the output could not be brought to its safe value."""

    error: AttemptError | None = None
    resting: bool = True


class Measurement:
    """One attempt.

    Parameters
    ----------
    hardware, spool, settings
    lease : Lease
    claim : mapping
    stop : WakingEvent
        Set when the agent is to end.
    confirm : callable
        Asks the person at the rig: (question, events that end it) -> whether it may begin.
    """

    def __init__(
        self,
        hardware: Driver,
        spool: Spool,
        settings: Settings,
        *,
        lease: Lease,
        claim: Mapping[str, Any],
        stop: WakingEvent,
        confirm: Confirm,
    ) -> None:
        self._hardware, self._spool, self._settings = hardware, spool, settings
        self._lease, self._claim, self._stop, self._confirm = lease, claim, stop, confirm
        self._level: float | None = None
        self._facts: dict[str, Any] = {"hardware": hardware.description}

    def run(self, run: Run) -> Outcome:
        """Measure, and put everything on disk; nothing is raised."""
        outcome = Outcome()
        plan: Plan | None = None
        try:
            plan = plan_of(self._claim, self._settings)
            self._measure(run, plan)
        except AttemptError as error:
            outcome.error = error
        except Exception as error:  # noqa: BLE001 - see below
            # An error of this program must neither leave the rig moving nor the attempt without an end.
            _log.exception("attempt %s failed", run.name)
            outcome.error = AttemptError("internal", f"an error of the agent ({type(error).__name__}): see its log")
        if plan is not None and plan.output is not None:
            self._rest(plan.output, outcome)
        told = None if outcome.error is None else {"code": outcome.error.code, "detail": outcome.error.detail}
        try:
            run.write("end", {"facts": self._facts, "error": told})
        except AttemptError as full:  # then the next start finds an attempt without an end
            _log.error("%s", full)
            outcome.error = outcome.error or full
        return outcome

    def _rest(self, output: OutputSettings, outcome: Outcome) -> None:
        try:
            self._hardware.rest(output, level=self._level)
            self._facts["output_at_rest"] = True
        except AttemptError as error:
            outcome.resting = self._facts["output_at_rest"] = False
            detail = f"the output {output.name} could not be brought to {f'{output.safe:g} {output.unit}'.strip()}: {error.detail}"
            _log.error("%s", detail)
            before = f"{outcome.error.detail}; moreover " if outcome.error else ""
            outcome.error = AttemptError(outcome.error.code if outcome.error else error.code, before + detail)

    def _measure(self, run: Run, plan: Plan) -> None:
        if plan.record:
            self._spool.admit(int(plan.seconds * plan.sample_rate * 1.1) * plan.width * 8)
        self._facts["devices"] = self._hardware.check(self._settings.devices)
        self._hardware.admit(plan.inputs, plan.output)
        self._facts["synchronisation"] = self._hardware.synchronisation(plan.inputs, plan.output).document()
        ranges = {entry.name: entry.ranges for entry in self._hardware.channels() if entry.direction == "input"}
        self._hardware.clean()
        with self._hardware.run(plan.inputs, plan.sample_rate, seconds=plan.longest) as running:
            rate = running.rate
            wait, length = round(plan.pre_trigger * rate), max(round(plan.duration * rate), 1)
            samples = wait + length * plan.averages
            watch = Watch(plan.inputs, rate=rate, ranges=ranges)
            if not plan.record:
                self._show_sweeps(plan, running, watch, samples=samples, before=wait)
                return
            drive = self._drive(plan, rate=rate, wait=wait, length=length)
            waiting = Waiting(plan.trigger, plan.inputs, rate=rate, before=wait) if plan.trigger else None
            running.prepare(samples + (waiting.most - wait if waiting else 0), drive)
            self._facts |= {
                "requested_rate": plan.sample_rate,
                "actual_rate": rate,
                "drive": self._driven(plan),
                "repeats": {"first": wait, "length": length, "count": plan.averages, **self._fades(plan, rate, length)},
            }
            self._ask(plan)
            self._lease.check()
            recorder = Recorder(run, channels=plan.width, samples=self._segment(plan, rate))
            try:
                self._run(run, plan, running, recorder, watch, drive=drive, waiting=waiting, samples=samples)
            finally:
                try:
                    recorder.close()  # a disk that is full takes the rest no more than what was before
                finally:
                    recorded = {"samples": recorder.samples, "complete": recorder.samples == samples}
                    self._facts |= watch.facts() | recorded

    def _show_sweeps(self, plan: Plan, running: Running, watch: Watch, *, samples: int, before: int) -> None:
        """Show sweep after sweep and keep nothing, until it is cancelled or has lasted for long enough."""
        rate = running.rate
        self._facts |= {"requested_rate": plan.sample_rate, "actual_rate": rate, "sweeps": 0}
        width = max(-(-samples // _OF_SWEEP), 1)
        running.prepare(round(LONGEST_LIVE * rate), None)
        self._lease.check()
        self._start(running)

        def watched() -> Iterator[Samples]:
            for block in self._blocks(running):
                watch.take(block)
                message = "; ".join(filter(None, ["live, nothing is recorded", watch.told()]))
                self._lease.tell(status="running", message=message)
                yield block

        def waiting() -> Waiting | None:
            return Waiting(plan.trigger, plan.inputs, rate=rate, before=before) if plan.trigger else None

        try:
            for number, sweep in sweeps(watched(), samples=samples, waiting=waiting):
                self._facts["sweeps"] = number
                start = -before / rate
                self._show(preview(plan.inputs, sweep, start=start, rate=rate, width=width, sweep=number))
        finally:
            running.halt()
            self._facts |= watch.facts()

    def _segment(self, plan: Plan, rate: float) -> int:
        """Return the samples of a segment: small, because several copies of one are in memory; few enough for a manifest."""
        usual = min(self._settings.spool.segment * rate, USUAL_BYTES / (8 * plan.width))
        return int(max(usual, plan.seconds * rate / _MOST_SEGMENTS, 1))

    def _drive(self, plan: Plan, *, rate: float, wait: int, length: int) -> Drive | None:
        if plan.output is None or plan.signal is None:
            return None
        drive = Drive(
            signal=signal_of(plan.signal),
            output=plan.output,
            rate=rate,
            wait=wait,
            length=length,
            repeats=plan.averages,
        )
        drive.check()
        return drive

    def _driven(self, plan: Plan) -> dict[str, Any] | None:
        """Return the drive as it was asked for, and what softens its beginning and end (see `agent.safety`).

        Of one that came as points their number stands for them: the service has them, and takes no document of any size.
        """
        if plan.output is None:
            return None
        drive = self._claim["request"]["drive"]
        signal = {
            name: {"points": len(value)} if isinstance(value, list) and len(value) > _MOST_TOLD else value
            for name, value in drive["signal"].items()
        }
        softened = {"soft_start": plan.output.soft_start, "soft_stop": plan.output.soft_stop}
        return {**drive, "signal": signal, **softened}

    def _fades(self, plan: Plan, rate: float, length: int) -> dict[str, Any]:
        """Say how many repetitions the drive fades in and out in: they are not like the others."""
        if plan.output is None or not (plan.output.soft_start or plan.output.soft_stop):
            return {}
        fades = (plan.output.soft_start, plan.output.soft_stop)
        return {"fading": [math.ceil(seconds * rate / length) for seconds in fades]}

    def _ask(self, plan: Plan) -> None:
        if not plan.confirm:
            return
        what = f"drive {plan.output.name} for {plan.duration * plan.averages:g} s" if plan.output else "measure"
        self._lease.tell(message="waits for the person at the rig")
        with self._lease.watched():
            agreed = self._confirm(f"{self._claim['name']}: may I {what}?", (self._lease.lost, self._stop))
        self._lease.check()
        if self._stop.is_set():
            raise AttemptError("stopped", "the agent was stopped")
        if not agreed:
            raise AttemptError(
                "not_confirmed",
                "the person at the rig has not agreed; an agent that runs as a service has no terminal to ask at",
            )

    def _run(
        self,
        run: Run,
        plan: Plan,
        running: Running,
        recorder: Recorder,
        watch: Watch,
        *,
        drive: Drive | None,
        waiting: Waiting | None,
        samples: int,
    ) -> None:
        """Let the inputs run until the recording is whole."""
        began = self._start(running)
        there: Iterable[Samples] = ()
        try:
            blocks = self._shown(plan.inputs, self._blocks(running), rate=running.rate)
            if waiting is None:
                self._begin(run, plan, running.rate, began)
            else:
                there = self._await(waiting, blocks, rate=running.rate, began=began)
                first = self._facts["repeats"]["first"]
                self._begin(run, plan, running.rate, began + timedelta(seconds=(waiting.at - first) / running.rate))
            self._record(recorder, watch, chain(there, blocks), samples, commanded=drive if plan.commanded else None)
        finally:
            self._level = running.halt()

    def _start(self, running: Running) -> datetime:
        """Let it begin, and return when the first sample was taken: while the hardware was told so."""
        before, steady = self._lease.now(), time.perf_counter()
        running.start()
        half = (time.perf_counter() - steady) / 2
        known = self._lease.clock_uncertainty
        self._facts |= {
            "clock_offset": self._lease.clock_offset,
            "clock_uncertainty": known,
            "start_time_uncertainty": None if known is None else half + known,
        }
        return before + timedelta(seconds=half)

    def _begin(self, run: Run, plan: Plan, rate: float, start: datetime) -> None:
        document = {
            "start_time": start.isoformat(),
            "sample_rate": rate,
            "channels": [
                *(described(entry) for entry in plan.inputs),
                *([commanded(plan.output)] if plan.commanded and plan.output else []),
            ],
            "facts": self._facts,
        }
        run.write("begin", document)

    def _blocks(self, running: Running) -> Iterator[Samples]:
        """Read as long as somebody wants samples, there are any, and the rig may run."""
        while True:
            if self._stop.is_set():
                raise AttemptError("stopped", "the agent was stopped")
            self._lease.check()
            block = running.read()
            if not block.shape[1]:
                return
            yield block

    def _shown(self, inputs: Sequence[InputSettings], blocks: Iterator[Samples], *, rate: float) -> Iterator[Samples]:
        """Show each block on its way."""
        got = 0
        for block in blocks:
            width = max(block.shape[1] // _STRETCHES, 1)
            self._show(preview(inputs, block, start=got / rate, rate=rate, width=width))
            got += block.shape[1]
            yield block

    def _show(self, told: dict[str, Any] | None) -> None:
        if told is not None:
            self._lease.show(told)

    def _await(self, waiting: Waiting, blocks: Iterator[Samples], *, rate: float, began: datetime) -> Iterator[Samples]:
        """Wait for the trigger, and return what is there of the recording."""
        self._lease.tell(status="running", progress=0.0, message="waits for the trigger")
        while not waiting.take(next(blocks)):
            pass
        self._facts["trigger"] = {
            "sample": self._facts["repeats"]["first"],
            "time": (began + timedelta(seconds=waiting.at / rate)).isoformat(),
            "waited": waiting.at / rate,
        }
        known = self._facts["start_time_uncertainty"]
        self._facts["start_time_uncertainty"] = None if known is None else known + _OFF * waiting.at / rate
        return waiting.recorded()

    def _record(
        self, recorder: Recorder, watch: Watch, blocks: Iterator[Samples], samples: int, *, commanded: Drive | None
    ) -> None:
        self._lease.tell(status="running", progress=0.0, message="recording")
        got = 0
        while got < samples:
            block = next(blocks)[:, : samples - got]  # inputs that have waited for a trigger go on beyond the end
            # Output and inputs have one clock and one start: sample k of the drive is played while sample k is taken.
            played = [] if commanded is None else [commanded.block(got, block.shape[1])[None, :]]
            recorder.add(np.concatenate([block, *played]))
            watch.take(block)
            got += block.shape[1]
            message = "; ".join(filter(None, ["recording", watch.told()]))
            self._lease.tell(status="running", progress=got / samples, message=message)


def described(entry: InputSettings) -> dict[str, Any]:
    """Return a channel as a dataset has it: raw volts, and what turns them into the quantity."""
    return {
        "name": entry.name,
        "quantity": entry.quantity or ("" if entry.kind == "voltage" else entry.kind),
        "unit": entry.unit,
        "scale": 1.0 / entry.overall_sensitivity,
        "offset": entry.overall_offset,
        "sensor": {
            "model": entry.model,
            "serial": entry.serial,
            "calibrated_on": entry.calibration.calibrated_on,
            "certificate": entry.calibration.certificate,
            "uncertainty_percent": entry.uncertainty_percent,
            "chain": [
                {
                    "model": stage.model,
                    "serial": stage.serial,
                    "gain": stage.gain,
                    "calibrated_on": stage.calibration.calibrated_on,
                    "certificate": stage.calibration.certificate,
                }
                for stage in entry.chain
            ],
        },
    }


def commanded(output: OutputSettings) -> dict[str, Any]:
    """Return the channel of what an output was told to play: nobody has measured it."""
    return {
        "name": output.name,
        "quantity": f"commanded {_GIVEN.get(output.kind, output.kind)}",
        "unit": output.unit,
        "scale": 1.0,
        "offset": 0.0,
    }
