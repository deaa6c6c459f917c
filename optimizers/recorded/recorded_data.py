"""What is wrong with recorded samples themselves, or poor in them, whatever model is fitted to them: sentences for `warnings`.

clipping     an extreme that is kept for samples, arrived at steeply (:mod:`engine.recordings.signal_quality`)
outliers     samples whose error lies apart from the median of the four around them, alone
feedback     an input that its own past foretells badly, but with the output's past and present exactly
excitation   an input that moves once, or by one sine: what then cannot be known, in numbers

References
----------
F. R. Hampel, "The influence curve and its role in robust estimation", J. Am. Stat. Assoc. 69 (1974) 383-393 (outliers).
L. Ljung, "System Identification: Theory for the User", 2nd ed., Prentice Hall 1999, sections 13.2 (excitation), 13.4 (feedback).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from engine.recordings.signal_quality import ChannelQuality, remarks

if TYPE_CHECKING:
    from optimizers.recorded.recording import RecordedExperiment, Recording

Samples = npt.NDArray[np.float64]

_APART: Final = 8.0
"""Standard deviations from the median of its neighbours at which a sample is no noise any more,"""
_SEEN: Final = 0.005
"""and the part of the signal's spread that it must be apart at least."""
_ALONE: Final = 3
"""Samples around an outlier among which there are no more than two; what is dense is a signal."""
_ITS_OWN: Final = 0.5
"""Part of an outlier's error that the signal itself is apart from its neighbours."""
_LONGEST: Final = 20_000
"""Samples of a stretch from which feedback is told."""
_PAST: Final = 8
_FORETOLD: Final = 0.02
"""Part of an input's own innovations, in variance, that is left where the output makes the input."""
_JUMP: Final = 8.0
"""Standard deviations by which a jump of a reference is apart from what else is left."""
_STEP: Final = 0.98
"""Part of an input's variance that one step explains."""
_SINE: Final = 0.995
"""Part of an input's power within the lines of one sine under a Hann window."""
_SINE_LINES: Final = 3


def doubted_data(experiment: RecordedExperiment) -> tuple[str, ...]:
    """Return a sentence on everything that is noticed in the estimation window (the whole recording without one)."""
    recording = experiment.recording
    window = experiment.windows[0] or (0.0, recording.end)
    part, where = recording.within(window), f" in {experiment.name}" if experiment.name else ""
    inputs = {name: signal[part] for name, signal in recording.inputs.items()}
    outputs = {name: signal[part] for name, signal in recording.outputs.items()}
    said = [*recording.remarks]
    for name, signal in (*inputs.items(), *outputs.items()):
        if not (name in inputs and held(signal)):
            said += [f"{sentence}{where}: a model sees that as dynamics" for sentence in clipped(name, signal)]
    for name, signal in inputs.items():
        if any(made_by(signal, y) for y in outputs.values()):
            said.append(
                f"{name}{where} follows from the output at every sample: a loop without a reference that moves tells of its "
                "controller, not of the plant (move the reference, or add a known signal to the command)"
            )
    poor = _poor(recording, part) if len(inputs) == 1 else ""
    said += [f"{poor}{where}"] if poor else []
    return tuple(said)


def held(signal: Samples) -> bool:
    """Tell whether a signal mostly keeps its value from one sample to the next, as a command does: its extremes are its own."""
    return bool(np.mean(np.diff(signal) == 0) > 0.5)


def clipped(name: str, signal: Samples) -> list[str]:
    """Return a sentence on each extreme at which a channel is cut."""
    quality = ChannelQuality()
    quality.add(signal)
    found = quality.document()
    return remarks(name, {**found, "missing": 0, "constant": False}, signal.size)


def doubted_samples(measured: Samples, simulated: Samples, output: str) -> tuple[str, ...]:
    """Return a sentence where single samples lie apart from what a model leaves around them."""
    errors = measured - simulated
    found = outliers(errors, float(np.ptp(np.quantile(measured, [0.01, 0.99]))))
    # where only the error jumps the model does not follow a command
    found = found[_from_around(measured)[found] > _ITS_OWN * _from_around(errors)[found]] if found.size else found
    if not found.size:
        return ()
    sentence = (
        f"{found.size} sample{'s' if found.size > 1 else ''} of {output} (the first is number {found[0]}) lie apart from the others: "
        "outliers draw the estimates to them, and no interval knows of it (remove or replace them)"
    )
    return (sentence,)


def outliers(errors: Samples, spread: float) -> npt.NDArray[np.int64]:
    """Return the samples whose errors lie apart from those around them, one or two in a row.

    Parameters
    ----------
    errors : ndarray, shape (samples,)
        What a model leaves; the signal itself jumps and turns as its input wants it.
    spread : float
        Of the signal.
    """
    if errors.size < 16:
        return np.zeros(0, dtype=np.int64)
    apart = _from_around(errors)
    found = np.flatnonzero(apart > max(_APART * 1.4826 * float(np.median(apart)), _SEEN * spread))
    if not found.size:
        return found
    near = np.searchsorted(found, found + _ALONE, side="right") - np.searchsorted(found, found - _ALONE)
    return np.asarray(found[near <= 2]) if np.mean(near <= 2) > 0.5 else found[:0]


def _from_around(signal: Samples) -> Samples:
    """Return how far each sample is from the median of the four around it.

    Without itself: where a signal mostly rises or falls it is the median of five, and any turn would be far from that.
    """
    padded = np.concatenate([signal[[0, 0]], signal, signal[[-1, -1]]])
    around = [padded[k : k + signal.size] for k in (0, 1, 3, 4)]
    return np.asarray(np.abs(signal - np.median(np.stack(around), axis=0)))


def made_by(u: Samples, y: Samples) -> bool:
    """Tell whether an input is made of an output's past and present, and of nothing else.

    What a reference still does to it is left over: all the time, or as jumps, which may be far between.
    """
    last = max(u.size - _LONGEST, 0)
    stretches = (slice(first, first + _LONGEST) for first in (*range(0, last, _LONGEST - _PAST), last))
    return all(_made_by(u[part], y[part]) for part in stretches)


def _made_by(u: Samples, y: Samples) -> bool:
    if u.size < 20 * _PAST or held(u) or np.ptp(y) == 0 or np.ptp(u) == 0:
        return False
    u, y = (u - u.mean()) / u.std(), (y - y.mean()) / y.std()
    rows = u.size - _PAST
    past = [u[_PAST - k : _PAST - k + rows] for k in range(1, _PAST + 1)]
    heard = [y[_PAST - k : _PAST - k + rows] for k in range(_PAST + 1)]
    alone, both = (_left(np.stack(columns, axis=1), u[_PAST:]) for columns in (past, [*past, *heard]))
    rounding = 1e-9
    if float(alone.std()) < rounding or float(both.var()) > _FORETOLD * float(alone.var()):
        return False
    return bool(np.abs(both).max() < max(_JUMP * float(both.std()), 10 * rounding))


def _left(table: Samples, wanted: Samples) -> Samples:
    solved = np.linalg.lstsq(table, wanted, rcond=1e-12)[0]
    return np.asarray(wanted - table @ solved)


def _poor(recording: Recording, part: slice) -> str:
    """Say what an input cannot tell that moves once, or by one sine; nothing of every other one."""
    ((name, whole),) = recording.inputs.items()
    u, h = whole[part], recording.sample_time
    if (step := one_step(u)) is not None:
        fastest = min(_fastest(signal[part], h) for signal in recording.outputs.values())
        return (
            f"{name} moves once, at {(part.start + step) * h:.4g} s: when it does between two samples shifts a delay by up to "
            f"{h:.3g} s, and poles beyond {fastest:.3g} rad/s cannot be known (there the answer to a step is weaker than the noise, "
            "or not sampled); several steps, a chirp or a multisine tell more"
        )
    if (sine := one_sine(u)) is not None:
        return (
            f"{name} is one sine of {sine / h:.4g} Hz: no more than a gain and a phase there can be known; a chirp or a multisine "
            "tells more"
        )
    return ""


def one_step(u: Samples) -> int | None:
    """Return the sample from which on an input has another value for good, None where it moves more often."""
    level = u - u.mean()
    power = float(level @ level)
    if u.size < 8 or power == 0:
        return None
    sums = np.cumsum(level)[:-1]
    count = np.arange(1, u.size)
    explained = sums**2 * u.size / (count * (u.size - count))
    best = int(np.argmax(explained))
    return best + 1 if explained[best] >= _STEP * power else None


def one_sine(u: Samples) -> float | None:
    """Return the frequency of an input that is one sine, in cycles per sample; None for every other one."""
    if u.size < 64:
        return None
    power = np.abs(np.fft.rfft((u - u.mean()) * np.hanning(u.size))) ** 2
    peak = int(np.argmax(power))
    lines = power[max(peak - _SINE_LINES, 0) : peak + _SINE_LINES + 1]
    return peak / u.size if peak > _SINE_LINES and float(lines.sum()) > _SINE * float(power.sum()) else None


def _fastest(y: Samples, h: float) -> float:
    """Return the frequency (rad/s) where the spectrum of a step of the output, A/ω, sinks into noise of σ h √N."""
    noise = 1.4826 * float(np.median(np.abs(np.diff(y, 2)))) / math.sqrt(6.0)
    size = float(np.ptp(np.quantile(y, [0.01, 0.99])))
    return math.pi / h if noise <= 0 else min(math.pi / h, size / (noise * h * math.sqrt(y.size)))
