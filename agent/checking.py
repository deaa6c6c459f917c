"""What a lab looks at on its first day: service, spool, devices, and every configured channel, without a sample or an output.

An input is tried alone, an output beside the first input that fits, then all inputs at once. What does not fit is told with its remedy.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, timedelta
from pathlib import Path
from typing import Any, Literal

from agent.data_sheets import differences
from agent.drivers.interface import Driver
from agent.drivers.loading import load
from agent.errors import AttemptError, SettingsError
from agent.service import KeyRefusedError, RefusedError, Service, ServiceError
from agent.settings import InputSettings, OutputSettings, Settings
from agent.spool import Spool, held

_USUAL, _SLOW = 1000.0, 10.0
"""samples/s that are asked for; the slower one tells a slow module from one that lacks something."""
_SOON = timedelta(days=30)
_REMEDIES = {
    "unknown_channel": "correct `channel` in the settings",
    "unknown_device": "switch it on and check its cable, or correct `name` in [[devices]]",
    "wrong_device": "put the right module in, or correct [[devices]] and the calibrations of its inputs",
    "unsupported_setting": "correct this entry in the settings",
    "server_unreachable": "start the device server, the controller or the other program, or correct where it is in [daq]",
    "no_driver": "install NI-DAQmx, or name an NI gRPC Device Server as `server` in [daq]",
    "device_busy": "close the other program that uses the device",
    "disk_full": "make room, or put `folder` of [spool] on another disk",
}
_MARKS = {"ok": "ok", "note": "note", "fails": "FAILS"}
_SEE_AGENT = "see docs/agent.md for the words of the driver"


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One line of the table: something fits, fails, or is to be known."""

    result: Literal["ok", "note", "fails"]
    what: str
    told: str
    remedy: str = ""


def check(settings: Settings, *, rate: float | None = None, today: date | None = None) -> list[Finding]:
    """Return what fits and what does not.

    Parameters
    ----------
    settings : Settings
    rate : float, optional
        samples/s at which channels are tried; by default 1000, and 10 for those that are slower.
    today : date, optional
        That calibrations are held against.
    """
    found = list(_service(settings))
    try:
        with held(Path(settings.spool.folder)):
            found.append(_spool(settings))
            # A name of its own: an agent on another PC may have tasks on the same device server.
            hardware = load(settings.daq.driver)(settings.daq, rig=f"{settings.rig.name}-check")
            with contextlib.closing(hardware):
                found += tried(settings, hardware, rate=rate)
                found += _sensors(settings, hardware)
    except SettingsError as error:
        # To try channels of a controller would end the measurement of the agent that has the rig.
        remedy = "stop the agent of this rig, or correct `folder` in [spool]; channels were not tried"
        found.append(Finding(result="fails", what="spool", told=str(error), remedy=remedy))
    return [*found, *_calibrations(settings, today or datetime.now().astimezone().date())]


def tried(settings: Settings, hardware: Driver, *, rate: float | None = None) -> Iterator[Finding]:
    """Yield a line for each device and each channel, as soon as it is known; of hardware that does not answer a single one."""
    yield from _Rig(settings, hardware, rate=rate).findings()


def table(findings: Sequence[Finding]) -> str:
    """Return them as text, one below the other, and how many fail."""
    width = max(len(entry.what) for entry in findings)
    lines = []
    for entry in findings:
        lines.append(f"{_MARKS[entry.result]:<6}{entry.what:<{width}}  {entry.told}")
        if entry.remedy:
            lines.append(f"{'':<{width + 8}}-> {entry.remedy}")
    failed = sum(entry.result == "fails" for entry in findings)
    noted = sum(entry.result == "note" for entry in findings)
    lines.append(f"{len(findings) - failed - noted} fit, {noted} to be known, {failed} fail")
    return "\n".join(lines)


def _service(settings: Settings) -> Iterator[Finding]:
    """Ask the service whether the key may acquire, and what it would refuse of the channels."""
    what, url = "service", settings.service.url
    service = Service(url, key=settings.key, timeout=settings.service.timeout)
    rig = settings.channels()
    with contextlib.closing(service):
        try:
            service.admits()
            yield Finding(result="ok", what=what, told=f"{url} answers, the key may acquire")
            service.judge({"rig": settings.rig.name, "instance": "only-judged", "name": "check", "document": rig})
        except KeyRefusedError as error:
            remedy = "give a key with the scope `acquire`: SERVOTUNE_AGENT_KEY, or key_file in [service]"
            yield Finding(result="fails", what=what, told=str(error), remedy=remedy)
        except RefusedError as error:
            for pointer, told in error.faults or [("", str(error))]:
                yield _refused(rig, pointer, told)
        except ServiceError as error:
            remedy = "see whether the service runs, and correct `url` in [service]"
            yield Finding(result="fails", what=what, told=str(error), remedy=remedy)


def _refused(rig: Mapping[str, Any], pointer: str, told: str) -> Finding:
    """Say of which channel it is what the service refuses; a pointer is such as /document/inputs/3/unit."""
    what, name = "rig", ""
    match pointer.split("/"):
        case ["", "document", ("inputs" | "outputs") as group, number, name, *_]:
            what = f"{group[:-1]} {rig[group][int(number)]['name']}"
    remedy = f"correct `{name}` in its entry" if name else "correct the settings"
    if name == "unit":
        remedy += ": one whose zero is zero (K, not degC) and that fits its `kind`"
    return Finding(result="fails", what=what, told=f"the service refuses it: {told}", remedy=remedy)


def _spool(settings: Settings) -> Finding:
    spool = Spool(Path(settings.spool.folder), limit=settings.spool.limit, reserve=settings.spool.reserve)
    try:
        spool.admit(0)
        spool.instance()
    except AttemptError as error:
        return failed("spool", error)
    waiting = len(spool.runs())
    verb = "waits" if waiting == 1 else "wait"
    told = f"{settings.spool.folder} takes samples, {_counted(waiting, 'recording')} {verb} for the service"
    return Finding(result="ok", what="spool", told=told)


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def failed(what: str, error: AttemptError) -> Finding:
    """Return what an error says of something, with its remedy."""
    remedy = error.remedy or _REMEDIES.get(error.code, _SEE_AGENT)
    return Finding(result="fails", what=what, told=error.what, remedy=remedy)


class _Rig:
    """The devices and the channels of one rig."""

    def __init__(self, settings: Settings, hardware: Driver, *, rate: float | None) -> None:
        self._settings, self._hardware, self._rate = settings, hardware, rate
        self._analog: InputSettings | None = None
        """The first input that fits and has a clock."""

    def findings(self) -> Iterator[Finding]:
        """Return a line for each device and each channel; of hardware that does not answer a single one."""
        try:
            there = self._hardware.devices()
        except AttemptError as error:
            yield failed("hardware", error)
            return
        yield Finding(
            result="ok", what="hardware", told=f"{self._hardware.description}, {_counted(len(there), 'device')}"
        )
        for device in there:
            told = f"{device['model']}, serial {device['serial']}"
            if device["simulated"]:
                told += ": simulated, its inputs are made-up signals"
            yield Finding(result="note" if device["simulated"] else "ok", what=f"device {device['name']}", told=told)
        for expected in self._settings.devices:
            try:
                self._hardware.check([expected])
            except AttemptError as error:
                yield failed(f"device {expected.name}", error)
        yield from self._channels()

    def _channels(self) -> Iterator[Finding]:
        entries = self._settings.inputs
        if not entries:
            told = "there is none: nothing can be measured"
            yield Finding(result="fails", what="inputs", told=told, remedy="describe each channel in an [[inputs]]")
        fitting: list[InputSettings] = []
        own = [entry for entry in entries if entry.kind not in self._hardware.following]
        for entry in [*own, *(entry for entry in entries if entry not in own)]:
            beside = [] if entry in own or self._analog is None else [self._analog]
            finding = self._tried(f"input {entry.name}", entry.channel, [*beside, entry])
            yield finding
            if finding.result != "fails":
                fitting.append(entry)
                if entry in own and self._analog is None:
                    self._analog = entry
        for output in self._settings.outputs:
            yield self._output(output)
        if len(fitting) > 1:
            yield self._tried("all inputs", "that fit, at once", fitting, together=True)

    def _output(self, output: OutputSettings) -> Finding:
        what = f"output {output.name}"
        if self._analog is None:
            try:
                self._hardware.admit((), output)
            except AttemptError as error:
                return failed(what, error)
            told = f"{output.channel} is there; it was not tried, because no input fits that gives it a clock"
            return Finding(result="note", what=what, told=told, remedy="let an input fit first")
        return self._tried(what, output.channel, [self._analog], output)

    def _tried(
        self,
        what: str,
        where: str,
        inputs: Sequence[InputSettings],
        output: OutputSettings | None = None,
        *,
        together: bool = False,
    ) -> Finding:
        try:
            got = self._hardware.trial(inputs, output, rate=self._rate or _USUAL)
        except AttemptError as error:
            if self._rate is None and error.code == "unsupported_setting":
                with contextlib.suppress(AttemptError):
                    got = self._hardware.trial(inputs, output, rate=_SLOW)
                    told = f"{where}, at {got:g} samples/s, but not at {_USUAL:g}: {error.what}"
                    return Finding(result="note", what=what, told=told, remedy="ask for a lower sample rate")
            if together:
                remedy = "ask for those channels together that can share a clock"
                return Finding(result="note", what=what, told=error.what, remedy=error.remedy or remedy)
            return failed(what, error)
        return Finding(result="ok", what=what, told=f"{where}, at {got:g} samples/s")


def _sensors(settings: Settings, hardware: Driver) -> Iterator[Finding]:
    """Hold the entries against the data sheets that are in their sensors; those without one are not spoken of."""
    for entry in settings.inputs:
        what = f"sensor {entry.name}"
        try:
            sheet = hardware.data_sheet(entry)
        except AttemptError as error:
            if error.code == "no_teds":
                yield Finding(result="note", what=what, told=error.what, remedy=error.remedy)
            continue  # what keeps a channel from being reached has been told of the channel
        if sheet is None:
            continue
        found = list(differences(entry, sheet))
        for difference in found:
            remedy = "connect the sensor that is meant, or correct model, serial and sensitivity in its entry"
            yield Finding(
                result="fails" if difference.grave else "note", what=what, told=difference.told, remedy=remedy
            )
        if not found:
            yield Finding(result="ok", what=what, told=f"says {sheet.words}")


def _calibrations(settings: Settings, today: date) -> Iterator[Finding]:
    for entry in settings.inputs:
        parts = [("its calibration", entry.calibration, "the sensor", "sensitivity")]
        parts += [(f"the calibration of {s.model or 'its chain'}", s.calibration, "it", "gain") for s in entry.chain]
        for whose, calibration, what, number in parts:
            if not calibration.due:
                continue
            due = date.fromisoformat(calibration.due)
            if due < today + _SOON:
                told = f"{whose} {'was' if due < today else 'is'} due on {due}"
                remedy = f"have {what} calibrated, then write certificate, {number} and due into its entry"
                yield Finding(result="note", what=f"input {entry.name}", told=told, remedy=remedy)
