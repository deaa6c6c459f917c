"""The right to move the rig, kept alive beside the measurement; by this PC's own steady clock, not by anybody's time of day."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from typing import Any, Self

from agent.errors import AttemptError
from agent.service import KeyRefusedError, RefusedError, Service, ServiceError
from agent.waking import WakingEvent

_log = logging.getLogger(__name__)
_PREVIEW, _LIVE = 1.0, 0.25
"""s between two previews, of a recording and of what is shown only."""
_MARGIN = 0.2
"""Share of a lease that is left when the rig must begin to come to rest."""
_STEP = sum(time.get_clock_info(name).resolution for name in ("time", "monotonic"))
"""s of the clocks of this PC: some 30 ms on Windows."""


class Lease:
    """The lease of one attempt; a thread of its own prolongs it.

    Parameters
    ----------
    service : Service
    agent : str
    claim : mapping
    """

    def __init__(self, service: Service, agent: str, claim: Mapping[str, Any]) -> None:
        self._service, self._agent, self._claim = service, agent, claim
        self._seconds = float(claim["lease_seconds"])
        record = claim["request"].get("record", True)
        self._pause = _PREVIEW if record else _LIVE
        self._kept = "what was recorded before is kept" if record else "nothing of it is kept"
        self._until = time.monotonic() + self._seconds
        self._lost: AttemptError | None = None
        self._closely = False
        self.lost = WakingEvent()
        """Set once the rig may not move any more."""
        self._told: dict[str, Any] = {"status": "claimed"}
        self._preview: dict[str, Any] | None = None
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._news = threading.Event()
        self._thread: threading.Thread | None = None
        self.clock_offset = 0.0
        """s by which the service's clock is ahead of this PC's."""
        self.clock_uncertainty: float | None = None
        """s, how far that is known; None before the service has answered."""

    def __enter__(self) -> Self:
        with contextlib.suppress(ServiceError):
            self._beat()  # measures the clocks; whether it is lost is looked at where it matters
        self._thread = threading.Thread(target=self._keep, name="lease", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._news.set()
        if self._thread is not None:
            self._thread.join()

    def check(self) -> None:
        """Make sure that the rig may move.

        Raises
        ------
        AttemptError
            `lease_lost`, `cancelled`.
        """
        self._look_at_the_clock()
        if self._lost is not None:
            raise self._lost

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Hear within a second that the measurement was cancelled, also while nothing is recorded that is sent anyhow."""
        self._closely = True
        self._news.set()
        try:
            yield
        finally:
            self._closely = False

    def tell(self, **values: Any) -> None:
        """Say how far it is: ``status``, ``progress``, ``message``."""
        with self._lock:
            changed = any(
                values.get(name, self._told.get(name)) != self._told.get(name) for name in ("status", "message")
            )
            self._told.update(values)
        if changed:
            self._news.set()

    def show(self, preview: dict[str, Any]) -> None:
        """Give the newest decimated samples; older ones that were not sent yet are dropped."""
        with self._lock:
            self._preview = preview

    def now(self) -> datetime:
        """Return the service's time."""
        return datetime.now(UTC) + timedelta(seconds=self.clock_offset)

    def _keep(self) -> None:
        beaten = time.monotonic()
        while not self._over.is_set():
            self._news.wait(min(self._pause, self._seconds / 3))
            urgent = self._news.is_set()
            self._news.clear()
            self._look_at_the_clock()
            due = self._closely or time.monotonic() - beaten > self._seconds / 3
            if self._over.is_set() or self._lost is not None or not (urgent or due or self._preview is not None):
                continue
            beaten = time.monotonic()
            try:
                self._beat()
            except (KeyRefusedError, RefusedError) as error:
                _log.warning("the rig may not move any more: %s", error)
            except ServiceError as error:
                _log.warning("no heartbeat: %s", error)

    def _look_at_the_clock(self) -> None:
        if self._lost is None and time.monotonic() > self._until - _MARGIN * self._seconds:
            detail = (
                f"the measurement was stopped: the service must be heard of within {(1 - _MARGIN) * self._seconds:g} s, "
                "it was not"
            )
            self._lose(AttemptError("lease_lost", detail))

    def _lose(self, error: AttemptError) -> None:
        self._lost = error
        self.lost.set()

    def _beat(self) -> None:
        with self._lock:
            document = {"agent": self._agent, **self._told}
            if self._preview is not None:
                document["preview"], self._preview = self._preview, None
        began, wall = time.monotonic(), time.time()
        try:
            reply = self._service.heartbeat(self._claim, document)
        except (KeyRefusedError, RefusedError) as error:
            if isinstance(error, RefusedError) and error.kind == "cancelled":
                self._lose(AttemptError("cancelled", f"the measurement was cancelled; {self._kept}"))
            else:
                self._lose(AttemptError("lease_lost", f"the measurement was stopped: {error}"))
            raise
        took = time.monotonic() - began
        self._seconds = float(reply["lease_seconds"])
        self._until = began + self._seconds
        self.clock_offset = datetime.fromisoformat(reply["time"]).timestamp() - (wall + took / 2)
        self.clock_uncertainty = took / 2 + _STEP
