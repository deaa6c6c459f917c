"""Measurements for the agent: every number in SI, every signal one of the few that an agent computes itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from api.convert.drives import Wish, check_limits, wish_of
from api.convert.signals import ReadChannel
from api.convert.values import si
from api.problems.documents import invalid
from api.schemas.acquisitions import AcquisitionBody

MOST_SAMPLES = 10**10
"""Of one measurement, all channels together: 80 GB."""
MOST_OF_SWEEP = 2_000_000
"""Samples of a sweep that is not recorded, of all channels together: the agent has them in memory, 16 MB."""
_CLOCKED = frozenset({"encoder", "counter", "digital"})
"""Kinds of inputs without a sample clock of their own."""
_ADDED: Mapping[str, Any] = {"trigger": None, "record": True, "commanded": False}
"""What a request has had since later versions of the agent, and what it is where nothing is asked for."""


def agent_request(
    body: AcquisitionBody, rig: Mapping[str, Any], *, read_channel: ReadChannel
) -> tuple[dict[str, Any], Wish | None]:
    """Return what the agent is told to do, and its drive, which is in the unit of its output.

    Raises
    ------
    Problem
        422 with the place of what is wrong.
    """
    duration = _positive(body.duration, "duration")
    pre_trigger = si(body.pre_trigger, "s", name="pre_trigger", place=("pre_trigger",))
    if pre_trigger < 0.0:
        raise invalid(f"pre_trigger must be >= 0 s, got {pre_trigger:g}", "pre_trigger")
    samples = (pre_trigger + duration * body.averages) * body.sample_rate
    if samples < 2.0:
        raise invalid(f"duration must hold at least 2 samples, got {samples:g}", "duration")
    if samples * len(body.channels) > MOST_SAMPLES:
        raise invalid(f"samples of all channels must be at most {MOST_SAMPLES:g}, got {samples:g} each", "duration")
    if not body.record:
        _check_unrecorded(body, samples)
    wish = wish_of(body, duration, rig, read_channel=read_channel)
    commanded = _commanded(body, rig)
    told = {
        "channels": [name for name in body.channels if name not in commanded],
        "commanded": bool(commanded),
        "sample_rate": body.sample_rate,
        "duration": duration,
        "pre_trigger": pre_trigger,
        "averages": body.averages,
        "drive": None if wish is None else {"output": wish.output, "signal": wish.told},
        "confirm": body.confirm,
        "record": body.record,
    }
    return told, wish


def _commanded(body: AcquisitionBody, rig: Mapping[str, Any]) -> set[str]:
    """Return the output of the drive where it is to be a channel of the recording, too; an input of that name comes first."""
    inputs = {entry["name"] for entry in rig.get("inputs", ())}
    return set() if body.drive is None else {body.drive.output} & set(body.channels) - inputs


def _check_unrecorded(body: AcquisitionBody, samples: float) -> None:
    """Refuse what only a recording can have."""
    for name, value, usual in (
        ("drive", body.drive, None),
        ("averages", body.averages, 1),
        ("then", body.then, []),
        ("confirm", body.confirm, False),
    ):
        if value != usual:
            raise invalid(f"{name} must be left out where nothing is recorded (record is false)", name)
    if samples * len(body.channels) > MOST_OF_SWEEP:
        raise invalid(
            f"pre_trigger and duration must hold at most {MOST_OF_SWEEP:g} samples of all channels where nothing is "
            f"recorded, got {samples * len(body.channels):g}",
            "duration",
        )


def unknown_to_agent(request: Mapping[str, Any], rig: Mapping[str, Any]) -> list[str]:
    """Name what of a request the agent of a rig does not know: it would pass over it without a word."""
    needed = [name for name, usual in _ADDED.items() if request.get(name, usual) != usual]
    return [name for name in needed if name not in rig.get("understands", ())]


def _positive(given: Any, name: str) -> float:
    value = si(given, "s", name=name, place=(name,))
    if value <= 0.0:
        raise invalid(f"{name} must be > 0 s, got {value:g}", name)
    return value


def check_against_rig(
    body: AcquisitionBody, request: Mapping[str, Any], rig: Mapping[str, Any], *, wish: Wish | None
) -> None:
    """Refuse channels that a rig does not have, and a drive that its limits forbid.

    The agent judges every sample again; this tells at once what it would refuse anyhow.

    Raises
    ------
    Problem
        422 with the place of what is wrong.
    """
    inputs = {entry["name"] for entry in rig.get("inputs", ())}
    outputs = {entry["name"]: entry for entry in rig.get("outputs", ())}
    seen: set[str] = set()
    for i, name in enumerate(body.channels):
        if name not in inputs | _commanded(body, rig):
            known = ", ".join(sorted(inputs)) or "none"
            raise invalid(
                f"channel must be one of the rig's inputs ({known}) or the output of the drive, got {name!r}",
                *("channels", i),
            )
        if name in seen:
            raise invalid(f"channel must be named once, got {name!r} twice", "channels", i)
        seen.add(name)
    if not request["channels"]:
        raise invalid("channels must have at least one input of the rig beside the output of the drive", "channels")
    _check_clock(request, rig)
    if body.drive is None:
        return
    output = outputs.get(body.drive.output)
    if output is None:
        known = ", ".join(sorted(outputs)) or "none"
        raise invalid(
            f"output must be one of the rig's outputs ({known}), got {body.drive.output!r}", "drive", "output"
        )
    longest = output.get("duration")
    driven = request["duration"] * request["averages"]
    if longest is not None and driven > longest:
        raise invalid(
            f"duration of the drive must be <= {longest:g} s, the limit of {output['name']}, got {driven:g}", "duration"
        )
    soft = sum(float(output.get(name, 0.0)) for name in ("soft_start", "soft_stop"))
    if driven < soft * (1 - 1e-9):
        raise invalid(
            f"duration of the drive must be >= {soft:g} s, soft_start and soft_stop of {output['name']}, got {driven:g}",
            "duration",
        )
    if wish is not None:
        check_limits(wish, output, rate=body.sample_rate, duration=request["duration"], averages=request["averages"])


def _check_clock(request: Mapping[str, Any], rig: Mapping[str, Any]) -> None:
    """Refuse inputs none of which has a sample clock."""
    kinds = {entry["name"]: entry.get("kind", "voltage") for entry in rig.get("inputs", ())}
    if all(kinds[name] in _CLOCKED for name in request["channels"]):
        raise invalid(
            f"channels must have an analog input, by whose clock {', '.join(sorted(_CLOCKED))} inputs are sampled, got "
            f"{', '.join(request['channels'])}",
            "channels",
        )
