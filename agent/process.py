"""The life of an agent: bring the rig to rest, register, then one measurement after the other until it is told to end."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterable
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from agent.checking import Finding, failed, tried
from agent.drivers.loading import load
from agent.errors import AttemptError, SettingsError
from agent.lease import Lease
from agent.measuring import Confirm, Measurement
from agent.plan import UNDERSTOOD
from agent.service import KeyRefusedError, RefusedError, Service, ServiceError
from agent.settings import Settings
from agent.spool import Spool
from agent.uploading import Uploader
from agent.waking import WakingEvent

_log = logging.getLogger(__name__)
_PAUSE, _LONGEST_PAUSE = 0.5, 30.0
_LONGEST_UNREST = 5.0
"""s between two trials to bring the rig to rest: the service hears of each, and takes the agent for gone after a lease without a word."""
_CLAIM_WAIT = 2.0
"""s in one request; an agent that is told to end waits no longer."""
_PATIENCE_AT_START, _PATIENCE_AT_END = 5.0, 10.0
_LONGEST_TEXT = 2000
"""Characters of a finding that the service takes."""
_CONFLICT = 409
"""What the service answers to an agent whose rig another one has."""


class Agent:
    """An agent of one rig.

    Parameters
    ----------
    settings : Settings
    name : str
        Of this PC.
    confirm : callable
        Asks the person at the rig (see `agent.measuring`).
    """

    def __init__(self, settings: Settings, *, name: str, confirm: Confirm) -> None:
        self._settings, self._name, self._confirm = settings, name, confirm
        self._stop = WakingEvent()
        self._spool = Spool(Path(settings.spool.folder), limit=settings.spool.limit, reserve=settings.spool.reserve)
        self._service = Service(settings.service.url, key=settings.key, timeout=settings.service.timeout)
        self._hardware = load(settings.daq.driver)(settings.daq, rig=settings.rig.name)
        self._uploader = Uploader(self._service, self._spool)
        self._found: dict[str, Any] = {}
        """How devices and channels were found when they were tried last, and when that was."""
        self._there: list[dict[str, Any]] = []
        """The devices that were there then."""

    def stop(self) -> None:
        """Let it come to an end: the rig to rest, the samples to disk."""
        self._stop.set()

    def run(self) -> None:
        """Live until told to stop."""
        self._end_what_was_interrupted()
        self._uploader.start()
        try:
            resting = not self._is_anothers()
            if resting:
                self._rest_until_it_works()
            while not self._stop.is_set():
                agent = self._register()
                if agent is not None:
                    self._uploader.agent = agent
                    if not resting:  # whoever had the rig in between may have left it anywhere
                        self._rest_until_it_works()
                    self._serve(agent)
                    resting = False
        finally:
            self._uploader.stop(patience=_PATIENCE_AT_END)
            self._hardware.close()
            self._service.close()

    def _end_what_was_interrupted(self) -> None:
        """Give every attempt that an earlier process left in the middle its end: what was recorded is sent."""
        for run in self._spool.runs():
            if not run.ended:
                run.repair()
                samples = sum(segment.samples for segment in run.segments())
                begin = run.read("begin") or {}
                facts = {**begin.get("facts", {}), "samples": samples, "complete": False}
                detail = "the agent's process ended in the middle of it; what was on its disk is here"
                run.write("end", {"facts": facts, "error": {"code": "agent_died", "detail": detail}})
                _log.warning("%s was interrupted: %d samples of each channel are kept", run.name, samples)

    def _is_anothers(self) -> bool:
        """Ask whether another agent has the rig, which then is not to be touched; no answer is no."""
        try:
            self._service.register(self._document(), timeout=_PATIENCE_AT_START)
        except RefusedError as error:
            return error.status == _CONFLICT
        except (ServiceError, AttemptError, SettingsError):
            return False
        return False

    def _rest_until_it_works(self) -> None:
        """Clear what was left on the hardware and bring every output to its safe value, before anything else."""
        pause = _PAUSE
        while not self._stop.is_set():
            try:
                self._rest()
            except AttemptError as error:
                _log.error("the rig cannot be brought to rest, and nothing is measured before: %s", error)
                self._tell([failed("hardware", error)], again=True)
                self._stop.wait(pause)
                pause = min(2 * pause, _LONGEST_UNREST)
            else:
                self._try_channels()
                return

    def _rest(self) -> None:
        self._hardware.check(self._settings.devices)
        self._hardware.clean()
        for output in self._settings.outputs:
            self._hardware.rest(output)

    def _try_channels(self) -> None:
        """Set every channel up without a start: whoever looks at the rig sees what is wrong before anything is measured."""
        self._there = self._devices()
        self._tell(tried(self._settings, self._hardware))

    def _tell(self, findings: Iterable[Finding], *, again: bool = False) -> None:
        """Let the service know how devices and channels were found, as far as it can be reached; what it knows ``again``, as a sign of life."""
        told = []
        for entry in findings:
            if self._stop.is_set():
                return
            told.append({key: value[:_LONGEST_TEXT] for key, value in asdict(entry).items()})
        if again or told != self._found.get("findings"):
            self._found = {"findings": told, "checked_at": datetime.now(UTC).isoformat()}
            with contextlib.suppress(ServiceError, AttemptError, SettingsError):
                self._service.register(self._document(), timeout=_PATIENCE_AT_START)

    def _register(self) -> str | None:
        """Take the rig; None when it could not be taken yet."""
        pause = _PAUSE
        while not self._stop.is_set():
            try:
                reply = self._service.register(self._document())
            except (ServiceError, AttemptError, SettingsError) as error:
                _log.warning("not registered: %s", error)
                if isinstance(error, RefusedError) and error.status != _CONFLICT:
                    pause = _LONGEST_PAUSE
                self._stop.wait(pause)
                pause = min(2 * pause, _LONGEST_PAUSE)
            else:
                _log.info("agent %s has the rig %s", reply["id"], reply["rig"])
                return str(reply["id"])
        return None

    def _document(self) -> dict[str, Any]:
        settings = self._settings
        return {
            "rig": settings.rig.name,
            "instance": self._spool.instance(),
            "name": self._name,
            "version": _version(),
            "document": {
                "devices": self._devices(),
                **settings.channels(),
                "daq": self._hardware.description,
                "understands": list(UNDERSTOOD),
                **self._found,
            },
        }

    def _devices(self) -> list[dict[str, Any]]:
        """Return the devices that are there, or, where nobody answers, those that are to be there."""
        try:
            return self._hardware.devices()
        except AttemptError:
            return [asdict(entry) for entry in self._settings.devices]

    def _serve(self, agent: str) -> None:
        """Take one attempt after the other, until the service wants to be asked anew."""
        pause = _PAUSE
        while not self._stop.is_set():
            try:
                if self._hardware.devices() != self._there:
                    self._try_channels()
                claim = self._service.claim(agent, wait=_CLAIM_WAIT)
            except AttemptError:
                # Whatever had the hardware in its hands is not there: nobody knows where the outputs stand.
                self._rest_until_it_works()
                continue
            except RefusedError as error:
                _log.warning("to be registered again: %s", error)
                self._stop.wait(_PAUSE)
                return
            except (ServiceError, SettingsError) as error:
                _log.warning("no work in the next %g s: %s", pause, error)
                self._stop.wait(pause)
                longest = _LONGEST_PAUSE if isinstance(error, KeyRefusedError) else 5.0
                pause = min(2 * pause, longest)
                continue
            pause = _PAUSE
            if claim is not None:
                self._measure(agent, claim)

    def _measure(self, agent: str, claim: dict[str, Any]) -> None:
        _log.info("attempt %s of %s: %s", claim["attempt"], claim["acquisition"], claim["name"])
        try:
            run = self._spool.open(claim)
        except AttemptError as error:
            document = {"agent": agent, "error": {"code": error.code, "detail": error.detail}}
            with contextlib.suppress(ServiceError):  # then it is lost, which is true as well
                self._service.finish(claim, document)
            return
        with Lease(self._service, agent, claim) as lease:
            measurement = Measurement(
                self._hardware,
                self._spool,
                self._settings,
                lease=lease,
                claim=claim,
                stop=self._stop,
                confirm=self._confirm,
            )
            outcome = measurement.run(run)
        if outcome.error is not None:
            _log.error("attempt %s of %s: %s", claim["attempt"], claim["acquisition"], outcome.error)
        if not outcome.resting:
            self._rest_until_it_works()


def _version() -> str:
    try:
        return version("servotune")
    except PackageNotFoundError:
        return ""
