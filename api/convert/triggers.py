"""Triggers for the agent: a window in the unit of the channel, which has one end only where a level is meant."""

from __future__ import annotations

import math
from typing import Any

from api.convert.values import si
from api.problems.documents import invalid
from api.schemas.acquisitions import AcquisitionBody, LevelTrigger, WindowTrigger

LONGEST_WAIT = 3600.0
"""s."""
MOST_BEFORE = 8_000_000
"""Samples before a trigger, of all channels together: the agent keeps them in memory, 64 MB."""

_WITHOUT_RANGE = frozenset({"thermocouple", "encoder", "counter"})
"""Kinds of inputs whose `range` says nothing."""


def agent_trigger(body: AcquisitionBody, request: dict[str, Any], rig: dict[str, Any]) -> dict[str, Any] | None:
    """Return what the agent waits for: ``when`` the channel `enters` or `leaves` ``low`` ... ``high``, null for an end that there is not.

    Parameters
    ----------
    request : dict
        What else the agent is told, all channels of which the rig has.

    Raises
    ------
    Problem
        422 with the place of what is wrong.
    """
    given = body.trigger
    if given is None:
        return None
    if body.drive is not None:
        detail = f"trigger must be left out beside a drive, got one for {given.channel}: the drive of {body.drive.output} begins with the inputs, at once"
        raise invalid(detail, "trigger")
    if body.averages > 1:
        raise invalid(f"averages must be 1 with a trigger, got {body.averages}", "averages")
    if given.channel not in body.channels:
        raise invalid(
            f"channel of the trigger must be one that is measured ({', '.join(body.channels)}), got {given.channel!r}",
            "trigger",
            "channel",
        )
    before = request["pre_trigger"] * body.sample_rate * len(body.channels)
    if before > MOST_BEFORE:
        raise invalid(
            f"pre_trigger must hold at most {MOST_BEFORE:g} samples of all channels with a trigger, got {before:g}",
            "pre_trigger",
        )
    entry = next(entry for entry in rig["inputs"] if entry["name"] == given.channel)
    unit = entry.get("unit", "")
    hysteresis = si(given.hysteresis, unit, name="hysteresis", place=("trigger", "hysteresis"))
    if hysteresis < 0.0:
        raise invalid(f"hysteresis must be >= 0 {unit}, got {hysteresis:g}", "trigger", "hysteresis")
    timeout = si(given.timeout, "s", name="timeout", place=("trigger", "timeout"))
    if not 0.0 < timeout <= LONGEST_WAIT:
        raise invalid(f"timeout must be > 0 and <= {LONGEST_WAIT:g} s, got {timeout:g}", "trigger", "timeout")
    window = _level(given, unit) if isinstance(given, LevelTrigger) else _window(given, unit, hysteresis)
    _check_reach(given, [end for end in (window["low"], window["high"]) if end is not None], entry, hysteresis)
    return {"channel": given.channel, "unit": unit, **window, "hysteresis": hysteresis, "timeout": timeout}


def _check_reach(
    given: LevelTrigger | WindowTrigger, ends: list[float], entry: dict[str, Any], hysteresis: float
) -> None:
    """Refuse a trigger that a channel cannot pass: all of its ends are beyond what the range of the channel lets through."""
    kind, unit = entry.get("kind", "voltage"), entry.get("unit", "")
    if kind in _WITHOUT_RANGE or "range" not in entry:
        return
    gain = entry.get("sensitivity", 1.0) * math.prod(stage["gain"] for stage in entry.get("chain", ()))
    middle, most = (0.5, 0.5) if kind == "digital" else (entry.get("offset", 0.0), abs(entry["range"] / gain))
    most *= 1 + 1e-9
    if any(abs(end - middle) <= most for end in ends):
        if isinstance(given, LevelTrigger):
            room = ends[0] - middle + most if given.edge == "rising" else middle + most - ends[0]
            _check_back(given, room, unit, hysteresis)
        return
    what = "level" if isinstance(given, LevelTrigger) else "window"
    told = " ... ".join(f"{end:g}" for end in ends)
    rule = "be" if what == "level" else "begin or end"
    raise invalid(
        f"{what} of the trigger must {rule} within {middle - most:g} ... {middle + most:g} {unit}, which is what the range of "
        f"{given.channel} lets through, got {told}",
        "trigger",
        what,
    )


def _check_back(given: LevelTrigger, room: float, unit: str, hysteresis: float) -> None:
    """Refuse a hysteresis by which a channel, which has some room, cannot come back from its level."""
    if hysteresis > room:
        detail = (
            f"hysteresis must be <= {room:.6g} {unit}, by which the range of {given.channel} lets it come back from the level, "
            f"got {hysteresis:g}"
        )
        raise invalid(detail, "trigger", "hysteresis")


def _level(given: LevelTrigger, unit: str) -> dict[str, Any]:
    level = si(given.level, unit, name="level", place=("trigger", "level"))
    low, high = (level, None) if given.edge == "rising" else (None, level)
    return {"when": "enters", "low": low, "high": high}


def _window(given: WindowTrigger, unit: str, hysteresis: float) -> dict[str, Any]:
    place = ("trigger", "window")
    low, high = (si(value, unit, name="window", place=(*place, i)) for i, value in enumerate(given.window))
    if not low < high:
        raise invalid(f"window must be [low, high] with low < high, got [{low:g}, {high:g}] {unit}", *place)
    if given.when == "leaves" and not 2 * hysteresis < high - low:
        raise invalid(
            f"hysteresis must be < half of the window that is left, {(high - low) / 2:g} {unit}, got {hysteresis:g}",
            "trigger",
            "hysteresis",
        )
    return {"when": given.when, "low": low, "high": high}
