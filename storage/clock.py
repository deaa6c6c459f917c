"""Which clock counts: the one that everybody who uses a database shares, watched for jumps by one that nobody sets.

Machines disagree about the time, and a machine's clock may be set. So whatever one process writes and another one compares,
heartbeats, leases, the beginnings of jobs, the instants of schedules, is told by the clock of the database's machine: Postgres is
asked for it; SQLite has one machine. A clock that is set is noticed, because it goes on by more or less than the monotonic one::

    jump = (now - now before) - (monotonic - monotonic before),    |jump| > 2 s
"""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

#: A difference (s) between two clocks that is no jump: a clock that is adjusted, an answer that took its time.
TOLERANCE = 2.0


class WallClock:
    """The time of day on this machine."""

    def __init__(self) -> None:
        #: By how much the clock is wrong. Tests let it jump.
        self.ahead = timedelta(0)

    def now(self) -> datetime:
        """Return the time of now, aware, in UTC."""
        return datetime.now(UTC) + self.ahead


#: The one place where this software reads the time of day that goes into a database.
WALL = WallClock()


def utc_now() -> datetime:
    """Return the time of now on this machine, aware, in UTC."""
    return WALL.now()


def shared_now(session: Session) -> datetime:
    """Return the time of now on the database's machine, aware, in UTC."""
    if session.get_bind().dialect.name == "sqlite":
        return utc_now()
    now = session.scalar(select(func.clock_timestamp()))
    assert isinstance(now, datetime)
    return now.astimezone(UTC)


def moment(session: Session) -> Any:
    """Return what writes `shared_now` into a row, without asking for it first."""
    return utc_now() if session.get_bind().dialect.name == "sqlite" else func.clock_timestamp()


class JumpDetector:
    """Tells whether a clock went on as time did since it was last noted.

    Parameters
    ----------
    clock : callable
        Monotonic time in s.
    """

    def __init__(self, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._noted: tuple[datetime, float] | None = None

    def note(self, now: datetime) -> None:
        """Remember a reading; whatever a jump before it has spoiled is mended."""
        self._noted = (now, self._clock())

    def steady(self, now: datetime) -> bool:
        """Return False when the clock was set since the last note, or none was ever taken."""
        noted = self._noted
        if noted is None:
            return False
        return abs((now - noted[0]).total_seconds() - (self._clock() - noted[1])) <= TOLERANCE


def jumps(session: Session) -> JumpDetector:
    """Return the detector of this process for the database's clock."""
    detector = session.info["jumps"]
    assert isinstance(detector, JumpDetector)
    return detector
