"""What was measured, laid over a model's curve: the recording at the instants of the picture, with an error band.

σ = 1.4826 median |y(i-1) - 2 y(i) + y(i+1)| / √6

The second difference of white noise of variance σ² has 6 σ²; of a curve that is smooth from sample to sample almost nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from api.convert.signals import check_name
from api.convert.values import listed, numbers
from api.problems.documents import invalid
from api.schemas.live import LiveMeasured
from api.services.operation.app_context import Caller, Installation
from api.services.recordings.datasets import read_recording
from api.units.conversion import UnitError, factor
from engine.diagram.diagram import Diagram

_BAND = 2.0
"""Half of the width of the error band in standard deviations of a sample."""

Real = npt.NDArray[np.float64]


def noise(values: Real) -> float:
    """Return the standard deviation of what is white in a recording, 0 for fewer than three samples."""
    if values.size < 3:
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(values, 2))) / np.sqrt(6.0))


def at_instants(values: Real, sample_time: float, start: float, time: Real) -> Real:
    """Return a recording at other instants, NaN outside of it.

    Where several samples fall between two instants it is their mean, else the straight line between its neighbours.

    Parameters
    ----------
    values : ndarray (n,)
        One sample each ``sample_time``, the first at 0.
    sample_time : float
        s.
    start : float
        s; the instant of the recording at which ``time`` is 0.
    time : ndarray (k,)
        s, evenly spaced, k >= 2.
    """
    wanted = start + time
    step = float(time[1] - time[0])
    own = np.arange(values.size) * sample_time
    if sample_time < step:
        total = np.concatenate([[0.0], np.cumsum(values)])
        # A millionth of a sample, so that rounding does not decide which stretch a sample on the edge belongs to.
        edges = [np.ceil((wanted + side * step / 2) / sample_time - 1e-6) for side in (-1, 1)]
        first, last = (np.clip(edge, 0, values.size).astype(int) for edge in edges)
        count = last - first
        with np.errstate(invalid="ignore"):
            found = np.where(count > 0, (total[last] - total[first]) / np.maximum(count, 1), np.nan)
    else:
        found = np.interp(wanted, own, values)
    return np.where((wanted >= 0.0) & (wanted <= own[-1]), found, np.nan)


def overlays(
    service: Installation, caller: Caller, asked: Sequence[LiveMeasured], diagram: Diagram, time: Real
) -> list[dict[str, Any]]:
    """Return each recording at the instants of the picture, SI, with its error band.

    Raises
    ------
    Problem
        422 for a channel that does not exist or has another kind of unit than the output.
    """
    found = []
    for i, overlay in enumerate(asked):
        place = ("measured", i)
        check_name(
            overlay.output, diagram.outputs, name="output", what="the system's outputs", place=(*place, "output")
        )
        recording = read_recording(
            service.database, caller.workspace, overlay.dataset, {(*place, "channel"): overlay.channel},
            place=(*place, "dataset"),
        )  # fmt: skip
        expected, unit = diagram.output_units[overlay.output], recording.units[overlay.channel]
        try:
            if expected and unit:
                factor(unit, expected)
        except UnitError as error:
            raise invalid(
                f"channel {overlay.channel!r} must measure output {overlay.output} in a unit of {expected}, got {unit}",
                *place, "channel",
            ) from error  # fmt: skip
        values = recording.channels[overlay.channel]
        drawn = at_instants(values, recording.sample_time, overlay.start, time)
        seen = np.flatnonzero(np.isfinite(drawn))
        if overlay.relative and seen.size:
            drawn = drawn - drawn[seen[0]]
        first = max(0, int(overlay.start / recording.sample_time))
        sigma = noise(values[first : first + int(time[-1] / recording.sample_time) + 2])
        found.append(
            {
                "output": overlay.output,
                "dataset": overlay.dataset,
                "channel": overlay.channel,
                "sigma": sigma,
                "values": listed(numbers(drawn)),
                "low": listed(numbers(drawn - _BAND * sigma)),
                "high": listed(numbers(drawn + _BAND * sigma)),
            }
        )
    return found
