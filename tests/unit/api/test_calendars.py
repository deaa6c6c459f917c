"""Instants of cron expressions where clocks change, and what is done about those that were missed.

Clocks in Berlin: 2026-03-29 02:00 becomes 03:00 (01:00 UTC), 2026-10-25 03:00 becomes 02:00 (01:00 UTC); EU directive 2000/84/EC.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import pytest

from api.problems.documents import Problem
from api.services.schedules.calendars import calendar, plan


def utc(text: str) -> datetime:
    return datetime.fromisoformat(text).replace(tzinfo=UTC)


def instants(cron: str, zone: str, after: str, count: int) -> list[str]:
    return [time.strftime("%d %H:%M") for time in calendar(cron, zone).following(utc(after), count)]


@pytest.mark.parametrize(
    ("cron", "after", "expected"),
    [
        # 02:30 does not exist on the 29th: the job runs at once after the gap, once.
        ("30 2 * * *", "2026-03-27T23:00", ["28 01:30", "29 01:00", "30 00:30"]),
        # 02:30 comes twice on the 25th: the job runs the first time only.
        ("30 2 * * *", "2026-10-23T22:00", ["24 00:30", "25 00:30", "26 01:30"]),
        # Every hour is every hour.
        ("0 * * * *", "2026-03-28T23:30", ["29 00:00", "29 01:00", "29 02:00"]),
        ("0 * * * *", "2026-10-24T23:30", ["25 00:00", "25 01:00", "25 02:00"]),
        ("15 6 * * mon-fri", "2026-11-20T12:00", ["23 05:15", "24 05:15", "25 05:15"]),
    ],
)
def test_a_job_runs_once_where_clocks_change(cron, after, expected) -> None:
    assert instants(cron, "Europe/Berlin", after, 3) == expected


@pytest.mark.parametrize(
    ("cron", "expected"),
    [
        ("@hourly", ["2026-03-01T12:00", "2026-03-01T13:00"]),
        ("@daily", ["2026-03-02T00:00", "2026-03-03T00:00"]),
        ("@midnight", ["2026-03-02T00:00", "2026-03-03T00:00"]),
        ("@Weekly", ["2026-03-08T00:00", "2026-03-15T00:00"]),  # Sundays
        ("@monthly", ["2026-04-01T00:00", "2026-05-01T00:00"]),
        ("@yearly", ["2027-01-01T00:00", "2028-01-01T00:00"]),
        (" @annually ", ["2027-01-01T00:00", "2028-01-01T00:00"]),
    ],
)
def test_nicknames_are_those_of_crontab(cron, expected) -> None:
    found = calendar(cron, "UTC").following(utc("2026-03-01T11:30"), 2)
    assert found == [utc(time) for time in expected]


def test_the_29th_of_february_comes_every_fourth_year() -> None:
    assert calendar("0 0 29 2 *", "UTC").following(utc("2026-01-01T00:00"), 2) == [
        utc("2028-02-29T00:00"),
        utc("2032-02-29T00:00"),
    ]


@pytest.mark.parametrize(
    ("cron", "zone", "pointer", "says"),
    [
        ("61 * * * *", "UTC", "/cron", "got '61 * * * *'"),
        ("* * * *", "UTC", "/cron", "5 fields"),
        ("* * * * * *", "UTC", "/cron", "5 fields"),
        ("@reboot", "UTC", "/cron", "or be one of @yearly"),
        ("@every 5m", "UTC", "/cron", "@hourly, got '@every 5m'"),
        ("", "UTC", "/cron", "5 fields"),
        ("0 0 31 2 *", "UTC", "/cron", "day-of-month"),
        ("0 0 * * *", "Mars/Olympus", "/time_zone", "'Mars/Olympus'"),
        ("0 0 * * *", "../../etc/passwd", "/time_zone", "IANA"),
        ("0 0 * * *", "", "/time_zone", "IANA"),
    ],
)
def test_what_has_no_instants_is_refused(cron, zone, pointer, says) -> None:
    with pytest.raises(Problem) as caught:
        calendar(cron, zone)
    (fault,) = caught.value.document()["errors"]
    assert fault["pointer"] == pointer
    assert says in fault["detail"]


# Every ten minutes; due at 12:00.
DUE = utc("2026-11-20T12:00")


@pytest.mark.parametrize(
    ("policy", "late", "run", "missed", "following"),
    [
        # On time: the policy does not matter.
        ("none", 0, "12:00", None, "12:10"),
        ("one", 60, "12:00", None, "12:10"),
        ("all", 59, "12:00", None, "12:10"),
        # 35 minutes late: 12:00, 12:10, 12:20 and 12:30 have gone by.
        ("none", 35 * 60, None, ("12:00", "12:30"), "12:40"),
        ("one", 35 * 60, "12:30", ("12:00", "12:20"), "12:40"),
        ("all", 35 * 60, "12:00", None, "12:10"),
        # Back just in time for 12:30.
        ("none", 30 * 60 + 20, "12:30", ("12:00", "12:20"), "12:40"),
        # One only was missed.
        ("none", 5 * 60, None, ("12:00", "12:00"), "12:10"),
        ("one", 5 * 60, "12:00", None, "12:10"),
    ],
)
def test_missed_instants_are_made_up_for_as_the_policy_says(policy, late, run, missed, following) -> None:
    found = plan(calendar("*/10 * * * *", "UTC"), policy=policy, due=DUE, now=DUE + timedelta(seconds=late))

    def shown(time: datetime | None) -> str | None:
        return time.strftime("%H:%M") if time else None

    assert shown(found.run) == run
    assert (found.missed and tuple(map(shown, found.missed))) == missed
    assert shown(found.next_at) == following
