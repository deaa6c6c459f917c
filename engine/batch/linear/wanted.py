"""What is watched of a response, and what is read off it, as numbers that compiled code takes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import numpy as np

from engine.batch.linear import readings
from engine.batch.linear.evaluate import Watched
from engine.batch.linear.readings import Wanted
from engine.batch.linear.response_requests import lines_of, lines_within, number_of, within

if TYPE_CHECKING:
    from engine.analysis.measuring import MetricRequest
    from engine.batch.linear.commands import Command
    from engine.batch.linear.response_requests import ResponseRequests
    from engine.diagram.diagram import Diagram

CODES: Final[Mapping[str, int]] = {
    "overshoot": readings.OVERSHOOT, "undershoot": readings.UNDERSHOOT, "rise_time": readings.RISE,
    "settling_time": readings.ENTRY, "response_time": readings.ENTRY, "peak": readings.PEAK,
    "max_velocity": readings.PEAK, "max_acceleration": readings.PEAK, "control_effort": readings.PEAK,
    "peak_time": readings.PEAK_TIME, "control_effort_rms": readings.RMS, "iae": readings.IAE, "ise": readings.ISE,
    "itae": readings.ITAE, "ie": readings.IE, "residual_vibration": readings.RESIDUAL,
    "steady_state_error": readings.ERROR, "recovery_time": readings.RECOVERY, "tracking_error": readings.TRACKING,
    "envelope": readings.ENVELOPE,
}  # fmt: skip
HELD: Final = frozenset({"tracking_error", "envelope"})
_ERRORS: Final = frozenset({"iae", "ise", "itae", "ie", "steady_state_error"})


def order_of(diagram: Diagram, request: MetricRequest) -> int | None:
    """Return how often the output of a request is differentiated; None where the request cannot be read off pieces."""
    order, output = request.order(diagram), str(request.output)
    if (
        request.metric not in CODES
        or not request.signals
        or output not in diagram.outputs
        or not isinstance(order, int)
    ):
        return None
    if any(name not in diagram.inputs for name in request.signals):
        return None
    if request.compares and diagram.references.unlike(request.signals, output):
        return None
    if request.metric == "recovery_time" and request.options.recovery_band is None:
        return None
    return None if request.metric in HELD and not lines_of(request) else order


def reaches(request: MetricRequest) -> bool:
    """Return whether a response is followed as far as the straight lines go that it is held against."""
    last = max(line.times[-1] for line, _ in lines_of(request))
    return request.duration is not None and request.duration >= last


def readings_of(
    diagram: Diagram, response: ResponseRequests, command: Command, *, outputs_too: bool = False
) -> tuple[Watched, Wanted]:
    """Return what is watched of the response to a command, and what is read off it.

    With ``outputs_too`` every output is watched as it is, whatever is read.
    """
    references, names = diagram.references, [diagram.inputs[number] for number in response.inputs]
    outputs = sorted(set(response.outputs))
    rows: dict[tuple[int, bool, int], int] = {}
    codes, row, first, stop, lines = [], [], [], [], []
    numbers = np.zeros((len(response.requests), 2))
    last = int(np.searchsorted(command.times, command.last))
    asked = zip(response.requests, response.orders, response.outputs, strict=True)
    for k, (request, order, output) in enumerate(asked):
        key = (outputs.index(output), request.metric in _ERRORS, order)
        row.append(rows.setdefault(key, len(rows)))
        codes.append(CODES[request.metric])
        until = request.duration if within(request) else None
        stop.append(-1 if until is None else int(np.searchsorted(command.times, until)))
        first.append(last if request.metric == "residual_vibration" else 0)
        numbers[k, 0] = number_of(request)
        lines += lines_within(k, request, command)
    for lane in range(len(outputs) if outputs_too else 0):
        rows.setdefault((lane, False, 0), len(rows))
    watched_names = [diagram.outputs[outputs[lane]] for lane, _, _ in rows]
    named = [references.input_of(names, name) for name in watched_names]
    watched = Watched(
        outputs=np.array([lane for lane, _, _ in rows], np.int64),
        kinds=np.array(
            [-1.0 if error and name not in references.errors else 1.0
             for (_, error, _), name in zip(rows, watched_names, strict=True)]
        ),
        orders=np.array([order for _, _, order in rows], np.int64),
        reference=np.array([[float(name == own) for name in names] for own in named]),
        errors=np.array([error for _, error, _ in rows], np.int64),
    )  # fmt: skip
    wanted = Wanted(
        codes=np.array(codes, np.int64), row=np.array(row, np.int64), first=np.array(first, np.int64),
        stop=np.array(stop, np.int64), numbers=numbers, lines=np.array(lines, dtype=float).reshape(-1, 7),
        start=float(response.start), loading=int(np.searchsorted(command.times, response.loading)),
    )  # fmt: skip
    return watched, wanted
