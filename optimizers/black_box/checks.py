"""What must be true of a recording and a question before a model without a diagram is looked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal

import numpy as np

from optimizers.black_box.thinning import thinned
from optimizers.problem import ProblemError
from optimizers.recorded.recording import RecordedExperiment
from optimizers.search.limits import MOST_BYTES

Method = Literal["subspace", "transfer_function"]

MOST_ORDER: Final = 20
MOST_DELAYS: Final = 2500
"""Samples; no more than a quarter of what estimates, either."""
_SAMPLES_PER_COEFFICIENT: Final = 10
_ARRAYS: Final = 3
"""Tables that are in memory at once."""


def checked(
    experiment: RecordedExperiment,
    method: Method,
    orders: Sequence[int],
    largest_delay: float,
    *,
    most_bytes: float = MOST_BYTES,
) -> tuple[RecordedExperiment, int]:
    """Return the recording as it is used, and of how many samples each of its samples is the mean.

    Raises
    ------
    ProblemError
        With the place of what is wrong.
    """
    recording, window = experiment.recording, experiment.windows[0]
    if window is None:
        raise ProblemError("the recording must have an estimation window, got none", at=("split",))
    counts = len(recording.inputs), len(recording.outputs)
    if method == "transfer_function" and counts != (1, 1):
        raise ProblemError(
            f"a transfer function must have one input and one output, got {counts[0]} and {counts[1]}: use subspace",
            at=("inputs",),
        )
    if not orders or not all(1 <= order <= MOST_ORDER for order in orders):
        raise ProblemError(f"orders must be 1 to {MOST_ORDER}, got {list(orders)}", at=("orders",))
    part = recording.within(window)
    for kind, signals in (("inputs", recording.inputs), ("outputs", recording.outputs)):
        for name, signal in signals.items():
            if not np.isfinite(signal).all():
                raise ProblemError(f"{name} must be finite at every sample, got NaN or infinity", at=(kind, name))
            if part.stop > part.start and np.ptp(signal[part]) == 0:
                raise ProblemError(f"{name} must vary in the estimation window, got a constant", at=(kind, name))
    used, together = thinned(experiment)
    _check_size(used, method, orders, largest_delay, most_bytes)
    return used, together


def _check_size(
    experiment: RecordedExperiment, method: Method, orders: Sequence[int], largest_delay: float, most_bytes: float
) -> None:
    recording, window = experiment.recording, experiment.windows[0]
    part = slice(0, 0) if window is None else recording.within(window)
    samples, h, order = max(part.stop - part.start, 0), recording.sample_time, max(orders)
    inputs, outputs = len(recording.inputs), len(recording.outputs)
    most = 0 if method == "subspace" else min(MOST_DELAYS, samples // 4)
    delays = round(largest_delay / h) if math.isfinite(largest_delay) else -1
    if not 0 <= delays <= most:
        room = "0 for a subspace model" if method == "subspace" else f"0 to {most * h:g}"
        raise ProblemError(f"largest_delay must be {room} s, got {largest_delay:g}", at=("largest_delay",))
    fewest = _SAMPLES_PER_COEFFICIENT * (order + 1) * (inputs + outputs)
    if samples < fewest + delays:
        raise ProblemError(
            f"estimation must hold at least {fewest + delays} samples for order {order}, got {samples}",
            at=("estimation",),
        )
    columns = (
        3 * order + 3 if method == "transfer_function" else outputs * (order * (inputs + 1) + outputs * inputs + 1)
    )
    room_needed = 8.0 * samples * columns * _ARRAYS
    if room_needed > most_bytes:
        raise ProblemError(
            f"orders must be so low that their regressions fit into {most_bytes / 1e9:.3g} GB, order {order} of {samples:,} samples "
            f"needs about {room_needed / 1e9:.2g} GB: ask for lower orders, or a shorter estimation",
            at=("orders",),
        )
