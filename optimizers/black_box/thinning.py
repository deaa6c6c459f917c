"""Long recordings that are sampled far faster than anything moves in them: means of so many samples each take their place.

    y_k' = (y_kR + ... + y_(k+1)R-1)/R,   u_k' alike:   R = 1/(20 f),   f in cycles per sample: where the output ends

The same mean of inputs and outputs leaves a linear plant what it is. Left as they are, discrete models of such samples have all
their poles within rounding of 1. The output ends where its spectrum sinks into what is flat beyond it, without coherence with an input,
or holds no more than 1e-8 of its power.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Final

import numpy as np
import numpy.typing as npt

from optimizers.recorded.recording import RecordedExperiment

Samples = npt.NDArray[np.float64]

LONG: Final = 10_000
"""Samples up to which a recording is left as it is."""
_LEFT: Final = LONG // 2
"""Means that there are at least."""
_WORTH: Final = 5
"""Samples of a mean that pay for the resolution of the delay."""
_FOR_A_PERIOD: Final = 20
"""Samples for each period of the fastest part."""
_ABOVE: Final = 3.0
"""Times the noise's power that a band has where the output still moves."""
_BANDS: Final = 60
_NOTHING: Final = 1e-8
_SEGMENTS: Final = 100
"""Of the coherence: half of them overlap the others."""
_CHANCE: Final = 5.0
"""Times 1/segments of coherence that no chance makes, on the mean over a band."""


def thinned(experiment: RecordedExperiment) -> tuple[RecordedExperiment, int]:
    """Return an experiment of means, and of how many samples each is: 1 where the recording stays as it is."""
    recording, window = experiment.recording, experiment.windows[0]
    part = slice(0, 0) if window is None else recording.within(window)
    long = part.stop - part.start
    if long <= LONG:
        return experiment, 1
    outputs = [signal[part] for signal in recording.outputs.values()]
    ends = max(_end(signal) for signal in outputs)
    together = min(int(1 / (_FOR_A_PERIOD * ends)), long // _LEFT)
    pairs = product([signal[part] for signal in recording.inputs.values()], outputs)
    if together < _WORTH or any(_follows(u, y, ends) for u, y in pairs):
        return experiment, 1
    count = recording.samples // together

    def meant(signal: Samples) -> Samples:
        return np.asarray(signal[: count * together].reshape(count, together).mean(axis=1))

    means = replace(
        recording,
        inputs={name: meant(signal) for name, signal in recording.inputs.items()},
        outputs={name: meant(signal) for name, signal in recording.outputs.items()},
        sample_time=together * recording.sample_time,
        between_samples={},  # means of steps are straight lines
    )
    estimation, validation = (_until(given, means.end) for given in (experiment.estimation, experiment.validation))
    return replace(experiment, recording=means, estimation=estimation, validation=validation), together


def _until(window: tuple[float, float] | None, end: float) -> tuple[float, float] | None:
    return None if window is None else (min(window[0], end), min(window[1], end))


def _follows(u: Samples, y: Samples, end: float) -> bool:
    """Tell whether an output still follows an input beyond a frequency: what looks like noise is an answer to it then."""
    from scipy.signal import coherence  # noqa: PLC0415 - a third of a second

    frequency, found = coherence(u, y, nperseg=max(256, 2 * u.size // _SEGMENTS))
    beyond = found[(frequency > end) & np.isfinite(found)]
    return bool(beyond.size) and float(beyond.mean()) > _CHANCE / _SEGMENTS


def _end(y: Samples) -> float:
    """Return the frequency, in cycles per sample, beyond which an output does not move."""
    lines = np.arange(1, y.size // 2)
    frequency = lines / (y.size - 1)
    # the difference has no jump from its last sample to its first one, which a record that ends elsewhere than it began has
    power = np.abs(np.fft.rfft(np.diff(y))[lines]) ** 2 / (4 * np.sin(np.pi * frequency) ** 2)
    noise = float(np.median(power[lines.size // 2 :])) / np.log(2.0)
    edges = np.unique(np.geomspace(1, lines.size, _BANDS).astype(int))
    means = np.add.reduceat(power, edges[:-1] - 1) / np.diff(edges)
    heard = edges[1:][means > _ABOVE * noise]
    rest = np.cumsum(power[::-1])[::-1]
    weak = int(np.argmax(rest <= _NOTHING * rest[0])) if rest[-1] <= _NOTHING * rest[0] else lines.size - 1
    return float(frequency[min(int(heard[-1]) - 1 if heard.size else 0, weak)])
