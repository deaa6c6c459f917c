"""Brings recordings to the service, while they are made or days later; deletes nothing that is not confirmed as a whole."""

from __future__ import annotations

import hashlib
import logging
import threading
import time
from collections.abc import Sequence
from typing import Any

from agent.errors import AttemptError
from agent.service import KeyRefusedError, RefusedError, Service, ServiceError, UnreachableError
from agent.spool import Run, Segment, Spool

_log = logging.getLogger(__name__)
_LOOK = 0.2
_PAUSE, _LONGEST_PAUSE = 0.5, 10.0
_ASK = 2.0
"""Until a service that reads a large recording is asked how far it is, s."""
_SENDINGS = 3
"""Of a segment that arrives otherwise than it left."""


class Uploader:
    """Works through the spool, in a thread of its own.

    Parameters
    ----------
    service : Service
    spool : Spool
    """

    def __init__(self, service: Service, spool: Spool) -> None:
        self._service, self._spool = service, spool
        self.agent: str | None = None
        """The id under which this agent is registered; nothing is sent before."""
        self._there: dict[str, set[str]] = {}
        self._aside: set[str] = set()
        self._arrived: set[str] = set()
        """Of those the service has everything, and this disk could not let go of them yet."""
        self._told: set[str] = set()
        self._being_read: dict[str, tuple[dict[str, Any], float]] = {}
        """Manifests of recordings that the service is reading, which are not hashed twice, and when to ask again."""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name="uploader", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self, *, patience: float) -> None:
        """End, after some s for what is there already."""
        self._drained(patience)
        self._stop.set()
        self._thread.join()

    def _drained(self, patience: float) -> bool:
        waited = 0.0
        while waited < patience and self.agent is not None:
            if all(run.name in self._aside for run in self._spool.runs()):
                return True
            if self._stop.wait(_LOOK):
                return False
            waited += _LOOK
        return False

    def _work(self) -> None:
        pause = _PAUSE
        while not self._stop.is_set():
            try:
                worked = self._round()
                pause = _PAUSE
            except (UnreachableError, KeyRefusedError, AttemptError, OSError) as error:
                _log.warning("the upload has to wait %g s: %s", pause, error)
                self._stop.wait(pause)
                pause = min(2 * pause, _LONGEST_PAUSE)
                continue
            if not worked:
                self._stop.wait(_LOOK)

    def _round(self) -> bool:
        """Do one thing for every attempt; say whether there was anything to do."""
        worked = False
        if self.agent is None:
            return False
        for run in self._spool.runs():
            if self._stop.is_set() or run.name in self._aside:
                continue
            try:
                worked |= self._forward(run, self.agent)
            except RefusedError as error:
                # Nothing that is tried again by itself would help; it stays on the disk, for a person and for the next start.
                _log.error("%s stays on this disk, the service refuses it: %s", run.folder, error)
                self._aside.add(run.name)
        return worked

    def _forward(self, run: Run, agent: str) -> bool:
        if run.name in self._arrived:
            return self._forget(run)
        begin, ended = run.read("begin"), run.ended
        self._tell_once(run, agent)
        if begin is None:
            return self._finish(run, agent) if ended else False
        dataset = self._dataset(run, agent, begin)
        there = self._there.setdefault(run.name, set())
        worked = False
        for segment in run.segments():
            if self._stop.is_set():
                return True
            self._tell_once(run, agent)  # the run may end while what has piled up is on its way
            if segment.sha256 not in there:
                there.add(self._send(run, dataset, segment, channels=len(begin["channels"])))
                worked = True
        if ended and run.ended and all(segment.sha256 in there for segment in run.segments()):
            return self._commit(run, dataset) and self._finish(run, agent)
        return worked

    def _tell_once(self, run: Run, agent: str) -> None:
        """Say of a run that has ended that its samples are on their way, which may take longer than a lease."""
        if not run.ended or run.name in self._told:
            return
        document = {"agent": agent, "status": "uploading", "message": "on its way"}
        try:
            self._service.heartbeat(run.claim, document)
        except RefusedError as error:
            _log.info("%s comes late: %s", run.name, error)
        self._told.add(run.name)

    def _dataset(self, run: Run, agent: str, begin: dict[str, Any]) -> str:
        known = run.read("dataset")
        if known is not None and run.name in self._there:
            return str(known["id"])
        document = {key: begin[key] for key in ("start_time", "sample_rate", "channels", "facts")}
        identifier = self._service.open_dataset(run.claim, {"agent": agent, **document})
        self._there[run.name] = self._service.segments(identifier)
        run.write("dataset", {"id": identifier})
        return identifier

    def _send(self, run: Run, dataset: str, segment: Segment, *, channels: int) -> str:
        """Bring one segment, and return the hash under which it is there."""
        data = segment.path.read_bytes()
        if hashlib.sha256(data).hexdigest() != segment.sha256:
            _log.error("%s is not what was written: the disk has spoilt it", segment.path)
            segment = run.replace_spoilt(segment, channels=channels)
            spoilt = (run.read("spoilt") or {"segments": []})["segments"]
            run.write("spoilt", {"segments": [*spoilt, {"number": int(segment.path.stem), "samples": segment.samples}]})
            data = segment.path.read_bytes()
        for sending in range(1, _SENDINGS + 1):
            try:
                self._service.put(dataset, segment, data)
            except RefusedError as error:
                if error.kind != "checksum-mismatch" or sending == _SENDINGS:
                    raise
                _log.warning("segment %s arrived otherwise than it left, and is sent again", segment.path.stem)
            else:
                break
        return segment.sha256

    def _commit(self, run: Run, dataset: str) -> bool:
        """Close the recording, and make sure that the service has what this disk has; False while it reads a large one."""
        segments = run.segments()
        if not segments:
            return True
        manifest, again = self._being_read.get(run.name) or (_manifest(segments), 0.0)
        if time.monotonic() < again:
            return False
        reply = self._service.commit(dataset, manifest)
        if reply["status"] == "parsing":
            self._being_read[run.name] = manifest, time.monotonic() + _ASK
            return False
        self._being_read.pop(run.name, None)
        size = sum(segment.size for segment in segments)
        if (reply["sha256"], reply["size"], reply["status"]) != (manifest["sha256"], size, "ready"):
            raise ServiceDiffersError(409, "not-confirmed", f"dataset {dataset} is not what this disk has: {reply}")
        return True

    def _finish(self, run: Run, agent: str) -> bool:
        end = run.read("end") or {}
        facts, error = dict(end.get("facts", {})), end.get("error")
        spoilt = run.read("spoilt")
        if spoilt is not None:
            facts["spoilt_segments"] = spoilt["segments"]
            error = error or {
                "code": "spoilt_segment",
                "detail": "the disk of the lab PC has spoilt a part of the recording: its samples are missing values",
            }
        try:
            self._service.finish(run.claim, {"agent": agent, "facts": facts, "error": error})
        except ServiceError:
            self._there.pop(run.name, None)  # begin with what is there, the next time
            raise
        self._there.pop(run.name, None)
        self._arrived.add(run.name)
        _log.info("%s has arrived", run.name)
        return self._forget(run)

    def _forget(self, run: Run) -> bool:
        run.remove()
        self._arrived.discard(run.name)
        return True


def _manifest(segments: Sequence[Segment]) -> dict[str, Any]:
    """Return what closes a recording."""
    whole = hashlib.sha256()
    for segment in segments:
        whole.update(segment.path.read_bytes())
    return {"segments": [segment.sha256 for segment in segments], "sha256": whole.hexdigest()}


class ServiceDiffersError(RefusedError):
    """The service confirms something else than was sent."""
