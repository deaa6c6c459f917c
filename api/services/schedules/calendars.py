"""Instants of a cron expression in a time zone.

Where clocks are changed, a job at a fixed time of day runs once: at the first of two equal times, and just after the gap when its time is left
out; one that runs every so many minutes or hours goes on regardless (the rules of Debian's cron, kept by `cronsim`).
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from itertools import islice
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from cronsim import CronSim, CronSimError

from api.problems.documents import invalid

GRACE = timedelta(seconds=60)
"""How late an instant may be dealt with and still count as on time."""

_FIELDS = 5

NICKNAMES = {
    "@yearly": "0 0 1 1 *",
    "@annually": "0 0 1 1 *",
    "@monthly": "0 0 1 * *",
    "@weekly": "0 0 * * 0",
    "@daily": "0 0 * * *",
    "@midnight": "0 0 * * *",
    "@hourly": "0 * * * *",
}
"""What crontab(5) has words for."""


@dataclass(frozen=True, slots=True)
class Calendar:
    """The instants of a cron expression."""

    cron: str
    zone: ZoneInfo

    def after(self, time: datetime) -> datetime | None:
        """Return the first instant after a time, None when there is none within 50 years."""
        found = self.following(time, 1)
        return found[0] if found else None

    def following(self, time: datetime, count: int) -> list[datetime]:
        """Return the next instants after a time, in UTC."""
        return [instant.astimezone(UTC) for instant in islice(CronSim(self.cron, time.astimezone(self.zone)), count)]

    def latest(self, now: datetime) -> datetime:
        """Return the last instant that is not after now; there must be one."""
        minute_after = now.astimezone(self.zone) + timedelta(minutes=1)
        for instant in CronSim(self.cron, minute_after, reverse=True):
            if instant <= now:
                return instant.astimezone(UTC)
        raise AssertionError("an instant was due, so there is a latest one")


@lru_cache(maxsize=1024)
def calendar(cron: str, time_zone: str) -> Calendar:
    """Return the calendar of a cron expression in a time zone.

    Raises
    ------
    Problem
        422 for an expression without instants, or a zone that nobody knows.
    """
    try:
        zone = ZoneInfo(time_zone)
    except (ZoneInfoNotFoundError, ValueError, OSError) as error:
        raise invalid(f"time_zone must be an IANA name such as Europe/Paris, got {time_zone!r}", "time_zone") from error
    fields = NICKNAMES.get(cron.strip().lower(), cron)
    if len(fields.split()) != _FIELDS:
        raise invalid(
            "cron must have 5 fields: minute, hour, day of month, month, day of week, or be one of "
            f"{', '.join(NICKNAMES)}, got {cron!r}",
            "cron",
        )
    found = None
    try:
        found = next(CronSim(fields, datetime.now(zone)), None)
    except CronSimError as error:
        raise invalid(f"cron must be an expression such as 30 2 * * mon-fri, got {cron!r}: {error}", "cron") from error
    if found is None:
        raise invalid(f"cron must have an instant within 50 years, got {cron!r}", "cron")
    return Calendar(cron=fields, zone=zone)


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What to do about a schedule that is due.

    ``run`` is the instant to run the job for, ``missed`` the first and the last of those that are not made up for, ``next_at``
    the next one to look at.
    """

    run: datetime | None
    missed: tuple[datetime, datetime] | None
    next_at: datetime | None


def plan(days: Calendar, *, policy: str, due: datetime, now: datetime) -> Plan:
    """Return what to do about the instants from ``due`` until now.

    Parameters
    ----------
    policy : {"none", "one", "all"}
        Which of the missed instants are made up for: none of them, the last one, or each in its turn.
    """
    if policy == "all" or now - due <= GRACE:
        return Plan(run=due, missed=None, next_at=days.after(due))
    latest = max(days.latest(now), due)
    next_at = days.after(now)
    if policy == "one" or now - latest <= GRACE:
        last_missed = _before(days, latest, due)
        return Plan(run=latest, missed=(due, last_missed) if last_missed else None, next_at=next_at)
    return Plan(run=None, missed=(due, latest), next_at=next_at)


def _before(days: Calendar, latest: datetime, due: datetime) -> datetime | None:
    """Return the instant before the latest one, None when that is the one that was due."""
    if latest <= due:
        return None
    return max(days.latest(latest - timedelta(minutes=1)), due)
