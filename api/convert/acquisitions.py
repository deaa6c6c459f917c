"""Measurements for the agent: every number in SI, every signal one of the few that an agent computes itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from api.convert.signals import ReadChannel, signal_from_wire
from api.convert.values import si
from api.problems.documents import invalid
from api.problems.pointers import Place
from api.schemas.acquisitions import AcquisitionBody, SteppedSineSignal
from engine.model.between_samples import BetweenSamples
from engine.signals import Signal

AGENT_SIGNALS = frozenset({"step", "sine", "chirp", "multisine", "trapezoid", "sampled"})
"""Signals of the engine that an agent computes from their numbers, at the rate that the hardware really has."""

UNITS: Mapping[str, str] = {"voltage": "V", "current": "A", "digital": ""}
"""Kind of an output -> what it gives is told in."""
MOST_SAMPLES = 10**10
"""Of one measurement, all channels together: 80 GB."""
MOST_OF_SWEEP = 2_000_000
"""Samples of a sweep that is not recorded, of all channels together: the agent has them in memory, 16 MB."""
_ADDED: Mapping[str, Any] = {"trigger": None, "record": True, "commanded": False}
"""What a request has had since later versions of the agent, and what it is where nothing is asked for."""
_MOST_POINTS = 100_000


def agent_request(body: AcquisitionBody, rig: Mapping[str, Any], *, read_channel: ReadChannel) -> dict[str, Any]:
    """Return what the agent is told to do; a drive is in the unit of its output.

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
    drive = None
    if body.drive is not None:
        outputs = {entry["name"]: entry for entry in rig.get("outputs", ())}
        kind = outputs.get(body.drive.output, {}).get("kind", "voltage")
        signal = _signal(body, duration, read_channel, unit=UNITS[kind] or "1")
        _check_band(signal, body.sample_rate)
        drive = {"output": body.drive.output, "signal": signal}
    commanded = _commanded(body, rig)
    return {
        "channels": [name for name in body.channels if name not in commanded],
        "commanded": bool(commanded),
        "sample_rate": body.sample_rate,
        "duration": duration,
        "pre_trigger": pre_trigger,
        "averages": body.averages,
        "drive": drive,
        "confirm": body.confirm,
        "record": body.record,
    }


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


def _check_band(signal: dict[str, Any], rate: float) -> None:
    """Refuse what a sample rate cannot play: it would come out at another frequency."""
    highest = {
        "sine": lambda: signal["frequency"],
        "chirp": lambda: max(signal["start_frequency"], signal["end_frequency"]),
        "multisine": lambda: max(signal["harmonics"]) * signal["fundamental"],
        "stepped_sine": lambda: max(signal["frequencies"]),
    }.get(signal["kind"], lambda: 0.0)()
    if highest >= np.pi * rate:
        raise invalid(
            f"frequencies of a drive must be below half the sample rate, {rate / 2:g} Hz, got {highest / (2 * np.pi):g} Hz",
            *("drive", "signal"),
        )


def _signal(body: AcquisitionBody, duration: float, read_channel: ReadChannel, *, unit: str) -> dict[str, Any]:
    assert body.drive is not None
    given, place = body.drive.signal, ("drive", "signal")
    if isinstance(given, SteppedSineSignal):
        return _stepped(given, place, unit)
    signal = signal_from_wire(given, place=place, read_channel=read_channel, unit=unit)
    if signal.impulse():
        raise invalid("signal of a drive must not be an impulse: no output can give one", *place)
    # the agent joins samples by straight lines
    if signal.kind in AGENT_SIGNALS and getattr(signal, "between_samples", None) in {None, BetweenSamples.LINEAR}:
        return {"kind": signal.kind, **{param.name: _plain(getattr(signal, param.name)) for param in signal.parameters}}
    return _sampled(signal, duration, body.sample_rate)


def _stepped(given: SteppedSineSignal, place: Place, unit: str) -> dict[str, Any]:
    frequencies = [
        si(value, "rad/s", name="frequency", place=(*place, "frequencies", i))
        for i, value in enumerate(given.frequencies)
    ]
    for i, value in enumerate(frequencies):
        if value <= 0.0:
            raise invalid(f"frequency must be > 0 rad/s, got {value:g}", *place, "frequencies", i)
    dwell = si(given.dwell, "s", name="dwell", place=(*place, "dwell"))
    if dwell <= 0.0:
        raise invalid(f"dwell must be > 0 s, got {dwell:g}", *place, "dwell")
    return {
        "kind": "stepped_sine",
        "amplitude": si(given.amplitude, unit, name="amplitude", place=(*place, "amplitude")),
        "frequencies": frequencies,
        "dwell": dwell,
        "phase": si(given.phase, "rad", name="phase", place=(*place, "phase")),
    }


def _sampled(signal: Signal, duration: float, rate: float) -> dict[str, Any]:
    """Return a signal that the agent does not know as straight lines between its samples, breakpoints among them."""
    count = int(min(np.ceil(duration * rate), _MOST_POINTS - 1)) + 1
    breaks = [t for t in signal.breaks(duration) if 0.0 <= t <= duration]
    time = np.unique(np.concatenate([np.linspace(0.0, duration, count), breaks]))[:_MOST_POINTS]
    return {"kind": "sampled", "time": time.tolist(), "values": signal.value(time).tolist()}


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _positive(given: Any, name: str) -> float:
    value = si(given, "s", name=name, place=(name,))
    if value <= 0.0:
        raise invalid(f"{name} must be > 0 s, got {value:g}", name)
    return value


def check_against_rig(body: AcquisitionBody, request: dict[str, Any], rig: dict[str, Any]) -> None:
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
    peak = _peak(request["drive"]["signal"])
    if peak is not None and peak > output["amplitude"] * (1 + 1e-9):
        limit = f"{output['amplitude']:g} {UNITS[output.get('kind', 'voltage')]}".strip()
        raise invalid(
            f"drive must stay within {limit}, the limit of {output['name']}, got {peak:g}",
            "drive",
            "signal",
        )


def _peak(signal: dict[str, Any]) -> float | None:
    """Return the largest magnitude where it can be told from the numbers alone."""
    match signal["kind"]:
        case "sampled":
            return float(np.abs(signal["values"]).max())
        case "step" | "sine" | "chirp" | "stepped_sine":
            return abs(float(signal["amplitude"]))
        case _:
            return None
