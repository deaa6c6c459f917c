"""What an output is to play: as its agent computes it, and judged against the limits of the output before it waits for its rig.

    u(t) = safe + s(t) (d(t) - safe),   s as in `agent.safety`

Samples of u at the rate asked for are looked at, all or a part of them: what is refused here, the agent would refuse. The rate
that the hardware has is known to the agent alone, which judges every sample.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from api.convert.signals import ReadChannel, signal_from_wire
from api.convert.values import si
from api.problems.documents import invalid
from api.schemas.acquisitions import AcquisitionBody, SteppedSineSignal
from engine.model.between_samples import BetweenSamples
from engine.signals import Signal

FloatArray = npt.NDArray[np.float64]

AGENT_SIGNALS = frozenset({"step", "sine", "chirp", "multisine", "trapezoid", "sampled"})
"""Signals of the engine that an agent computes from their numbers, at the rate that the hardware really has."""

UNITS: Mapping[str, str] = {"voltage": "V", "current": "A", "digital": ""}
"""Kind of an output -> what it gives is told in."""
_MOST_POINTS = 100_000
_MOST_PERIODS = 1000
"""Of which the breaks are looked at."""
_MOST_SINES = 5_000_000
"""Sines of one number that are computed to judge a drive: a tenth of a second."""
_BESIDE = 0.01
"""Of a limit: the hardware's samples lie beside those that are looked at."""
_PLACE = ("drive", "signal")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wish:
    """A drive: ``told`` to the agent, its ``value`` at times (s), the times where it ``breaks``, and what it consists of.

    ``period`` s, None where it does not repeat by itself; ``fastest`` rad/s, of what repeats; ``sines`` that one value costs.
    """

    output: str
    told: dict[str, Any]
    value: Callable[[FloatArray], FloatArray]
    breaks: tuple[float, ...]
    period: float | None = None
    fastest: float = 0.0
    sines: int = 1


def wish_of(
    body: AcquisitionBody, duration: float, rig: Mapping[str, Any], *, read_channel: ReadChannel
) -> Wish | None:
    """Return the drive of a measurement, in the unit of its output; None where nothing is driven.

    Raises
    ------
    Problem
        422 with the place of what is wrong.
    """
    if body.drive is None:
        return None
    outputs = {entry["name"]: entry for entry in rig.get("outputs", ())}
    unit = UNITS[outputs.get(body.drive.output, {}).get("kind", "voltage")] or "1"
    given = body.drive.signal
    if isinstance(given, SteppedSineSignal):
        wish = _stepped(body.drive.output, given, unit)
    else:
        signal = signal_from_wire(given, place=_PLACE, read_channel=read_channel, unit=unit)
        if signal.impulse():
            raise invalid("signal of a drive must not be an impulse: no output can give one", *_PLACE)
        period, sines = signal.repeats_after(), signal.sines()
        fastest = 0.0 if period is None else 2 * np.pi / period
        _check_band(fastest, body.sample_rate)
        wish = Wish(
            output=body.drive.output,
            told=_told(signal, duration, body.sample_rate),
            value=signal.value,
            breaks=signal.breaks(duration if period is None else min(duration, _MOST_PERIODS * period)),
            period=period,
            fastest=fastest if sines is None else float(sines[:, 1].max(initial=fastest)),
            sines=1 if sines is None else len(sines),
        )
    _check_band(_highest(wish.told), body.sample_rate)
    return wish


def check_limits(wish: Wish, output: Mapping[str, Any], *, rate: float, duration: float, averages: int) -> None:
    """Refuse a drive that goes beyond the amplitude or the rate of change of its output.

    Parameters
    ----------
    output : mapping
        As its rig has it.
    rate : float
        samples/s that are asked for.
    duration : float
        s of one repetition.

    Raises
    ------
    Problem
        422 with the limit and what the drive would do.
    """
    unit = UNITS[output.get("kind", "voltage")]
    k, played = _played(wish, output, rate=rate, length=max(round(duration * rate), 1), averages=averages)
    known = _peak(wish.told)
    peak, beside = (float(np.abs(played).max()), _BESIDE) if known is None else (known, 1e-9)
    if peak > output["amplitude"] * (1 + beside):
        limit = f"{output['amplitude']:g} {unit}".strip()
        raise invalid(f"drive must stay within {limit}, the limit of {output['name']}, got {peak:g}", *_PLACE)
    slew = output.get("slew")
    if slew is None or output.get("kind") == "digital":
        return
    steepest = float(np.abs(np.diff(played))[np.diff(k) == 1].max(initial=0.0)) * rate
    if steepest > slew * (1 + _BESIDE):
        raise invalid(
            f"drive must change by at most {slew:g} {unit}/s, the limit of {output['name']}, got {steepest:.4g} at "
            f"{rate:g} samples/s: lower its amplitude or its frequency, or let the output start and stop softly",
            *_PLACE,
        )


def _played(
    wish: Wish, output: Mapping[str, Any], *, rate: float, length: int, averages: int
) -> tuple[npt.NDArray[np.int64], FloatArray]:
    """Return numbers of samples, in order, and what is played then; a part of all where there are many.

    Sample -1 is the safe value before the drive. Neighbours of breaks and joints are always among them.
    """
    driven, safe = length * averages, output.get("safe", 0.0)
    most = max(min(_MOST_POINTS, _MOST_SINES // wish.sines) // 2, 10)
    spread = np.unique(np.linspace(0, driven - 1, min(driven, most)).astype(np.int64))
    breaks = np.array([t * rate for t in wish.breaks[:most]]).astype(np.int64)
    joints = length * np.arange(min(averages, most))
    near = [(breaks[:, None] + np.arange(-1, 3)).ravel(), joints, [driven - 1]]
    chosen = np.concatenate([spread, *near]).astype(np.int64)
    k = np.unique(np.clip(np.concatenate([chosen, chosen - 1]), -1, driven - 1))
    soft = np.ones(k.size)
    rise, fall = output.get("soft_start", 0.0) * rate, output.get("soft_stop", 0.0) * rate
    soft *= _half_cosine(k / rise) if rise > 0 else 1.0
    soft *= _half_cosine((driven - 1 - k) / fall) if fall > 0 else np.where(k < driven - 1, 1.0, 0.0)
    asked = wish.value(np.where(k >= 0, k % length, 0) / rate)
    return k, np.where(k >= 0, safe + soft * (asked - safe), safe)


def _half_cosine(x: FloatArray) -> FloatArray:
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.clip(x, 0.0, 1.0)))


def _check_band(highest: float, rate: float) -> None:
    """Refuse what a sample rate cannot play: it would come out at another frequency."""
    if highest >= np.pi * rate:
        raise invalid(
            f"frequencies of a drive must be below half the sample rate, {rate / 2:g} Hz, got {highest / (2 * np.pi):g} Hz",
            *_PLACE,
        )


def _highest(told: Mapping[str, Any]) -> float:
    """Return the highest frequency, rad/s, where it is among the numbers; 0 where it is not."""
    match told["kind"]:
        case "sine":
            return float(told["frequency"])
        case "chirp":
            return float(max(told["start_frequency"], told["end_frequency"]))
        case "multisine":
            return float(max(told["harmonics"]) * told["fundamental"])
        case "stepped_sine":
            return float(max(told["frequencies"]))
        case _:
            return 0.0


def _told(signal: Signal, duration: float, rate: float) -> dict[str, Any]:
    # the agent joins samples by straight lines
    if signal.kind in AGENT_SIGNALS and getattr(signal, "between_samples", None) in {None, BetweenSamples.LINEAR}:
        return {"kind": signal.kind, **{param.name: _plain(getattr(signal, param.name)) for param in signal.parameters}}
    return _sampled(signal, duration, rate)


def _stepped(output: str, given: SteppedSineSignal, unit: str) -> Wish:
    frequencies = [
        si(value, "rad/s", name="frequency", place=(*_PLACE, "frequencies", i))
        for i, value in enumerate(given.frequencies)
    ]
    for i, frequency in enumerate(frequencies):
        if frequency <= 0.0:
            raise invalid(f"frequency must be > 0 rad/s, got {frequency:g}", *_PLACE, "frequencies", i)
    dwell = si(given.dwell, "s", name="dwell", place=(*_PLACE, "dwell"))
    if dwell <= 0.0:
        raise invalid(f"dwell must be > 0 s, got {dwell:g}", *_PLACE, "dwell")
    amplitude = si(given.amplitude, unit, name="amplitude", place=(*_PLACE, "amplitude"))
    phase = si(given.phase, "rad", name="phase", place=(*_PLACE, "phase"))
    told = {
        "kind": "stepped_sine",
        "amplitude": amplitude,
        "frequencies": frequencies,
        "dwell": dwell,
        "phase": phase,
    }
    w = np.array(frequencies)
    phases = phase + np.concatenate([[0.0], np.cumsum(w[:-1] * dwell)])

    def value(t: FloatArray) -> FloatArray:
        i = np.minimum((t / dwell).astype(int), w.size - 1)
        return np.where(t < dwell * w.size, amplitude * np.sin(w[i] * (t - i * dwell) + phases[i]), 0.0)

    return Wish(output=output, told=told, value=value, breaks=tuple(dwell * np.arange(w.size + 1)))


def _sampled(signal: Signal, duration: float, rate: float) -> dict[str, Any]:
    """Return a signal that the agent does not know as straight lines between its samples, breakpoints among them."""
    count = int(min(np.ceil(duration * rate), _MOST_POINTS - 1)) + 1
    breaks = [t for t in signal.breaks(duration) if 0.0 <= t <= duration]
    time = np.unique(np.concatenate([np.linspace(0.0, duration, count), breaks]))[:_MOST_POINTS]
    return {"kind": "sampled", "time": time.tolist(), "values": signal.value(time).tolist()}


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _peak(told: Mapping[str, Any]) -> float | None:
    """Return the largest magnitude where it can be told from the numbers alone."""
    match told["kind"]:
        case "sampled":
            return float(np.abs(told["values"]).max())
        case "step" | "sine" | "chirp" | "stepped_sine":
            return abs(float(told["amplitude"]))
        case _:
            return None
