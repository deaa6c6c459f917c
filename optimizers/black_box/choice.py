"""The order of a black-box model, chosen by what it simulates on samples that did not take part."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.model.between_samples import BetweenSamples, told
from engine.recordings.fit import Fit, baselines, compare
from optimizers.black_box.checks import Method, checked
from optimizers.black_box.continuous import Continuous, Discrete, continuous
from optimizers.black_box.document import document_of
from optimizers.black_box.doubts import UNJUDGED, doubts
from optimizers.black_box.output_error import OutputError
from optimizers.black_box.subspace import Subspace
from optimizers.black_box.thinning import LONG
from optimizers.estimation.noise import fitted
from optimizers.estimation.tall import triangle
from optimizers.problem import ProblemError
from optimizers.recorded.recording import RecordedExperiment
from optimizers.search.limits import MOST_BYTES, Limited
from optimizers.search.result import Monitor, Status, Unwatched

Samples = npt.NDArray[np.float64]

_BETTER: Final = 0.3
"""Points of FIT by which a higher order must be better to be preferred."""
_COARSE: Final = 12
"""Steps of the coarse grid of delays."""
_LOOKED_AT: Final = LONG
"""Samples on which delays are looked for and denominators begun: the liveliest ones of a longer recording."""
_TO_MOVE: Final = 6
"""Evaluations on the whole of a long recording: what begins so near has settled then."""
_PROMISING: Final = 3
"""So many delays of an order are followed to their minimum."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tried:
    """One order: FIT (%) of its simulation where it was estimated and where it was not (None: no such window)."""

    order: int
    delay: float
    estimation: float | None
    validation: float | None
    remark: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class BlackBox:
    """The model chosen.

    Attributes
    ----------
    order : int
    delay : float
        s, of all inputs.
    system : Continuous
    offsets : mapping of output to float
    tried : tuple of Tried
        Every order.
    estimation, validation : mapping of output to Fit
        Simulation fits; the state at the beginning of either window is found by regression.
    one_step : mapping of output to Fit
        One-step predictions where the validation is (the estimation without one): no simulations.
    baselines : mapping of baseline to mapping of output to Fit
    document : mapping
        A system document with the model.
    status : Status
        Cancelled, or out of time, where not all orders were tried.
    warnings : tuple of str
        What is doubtful about the samples, and about the model.
    """

    method: Method
    order: int
    delay: float
    system: Continuous
    offsets: Mapping[str, float]
    tried: tuple[Tried, ...]
    estimation: Mapping[str, Fit]
    validation: Mapping[str, Fit]
    one_step: Mapping[str, Fit]
    baselines: Mapping[str, Mapping[str, Fit]]
    document: Mapping[str, Any]
    status: Status
    seconds: float
    warnings: tuple[str, ...]


def black_box(
    experiment: RecordedExperiment,
    *,
    method: Method,
    orders: Sequence[int] = (1, 2, 3, 4, 5, 6),
    largest_delay: float = 0.0,
    offsets: bool = True,
    monitor: Monitor | None = None,
    most_bytes: float = MOST_BYTES,
) -> BlackBox:
    """Return a model without a diagram.

    Parameters
    ----------
    experiment : RecordedExperiment
        Any names serve for its inputs and outputs; a transfer function has one of each.
    method : {"subspace", "transfer_function"}
    orders : sequence of int
        Among which the validation chooses (the estimation where there is none, or nothing moves there): the lowest one that no other
        beats by more than 0.3 points of FIT.
    largest_delay : float
        s; a transfer function is tried with every delay of whole samples up to it.
    offsets : bool
        Whether each output has an unknown constant.
    most_bytes : float
        Regressions that need more are refused.
    monitor : Monitor, optional

    Raises
    ------
    ProblemError
        For orders that the recording is too short for, or when no order has a continuous, stable model.
    """
    began = time.perf_counter()
    watch = monitor or Unwatched()
    recorded, (experiment, together) = (
        experiment,
        checked(experiment, method, orders, largest_delay, most_bytes=most_bytes),
    )
    case = _Case(experiment, offsets=offsets)
    tried, candidates, status = _tried(case, method, orders, largest_delay, watch)
    if not candidates:
        raise ProblemError(
            "at least one order must have a stable continuous model, got none: "
            + ("; ".join(f"order {one.order}: {one.remark}" for one in tried) or "ended before the first"),
            at=("orders",),
        )
    tells = case.validates()
    judged = [_judged(one, validated=tells) for one, *_ in candidates]
    best, model, delay, constants = next(
        c for c, fit in zip(candidates, judged, strict=True) if fit >= max(judged) - _BETTER
    )
    held = [way is BetweenSamples.HOLD for way in told(experiment.recording.between_samples, case.inputs)]
    system = continuous(model, case.h, held=held)
    assert system is not None  # tried above
    window = experiment.windows[1] or experiment.windows[0]
    parts = [case.compared(model, delay, constants, part) for part in experiment.windows]
    return BlackBox(
        method=method, order=best.order, delay=best.delay, system=system,
        offsets=dict(zip(case.outputs, constants.tolist(), strict=True)) if offsets else {}, tried=tuple(tried),
        estimation={name: compare(*pair) for name, pair in parts[0].items()},
        validation={name: compare(*pair) for name, pair in parts[1].items()},
        one_step=case.predicted(model, delay, constants), baselines=case.trivial(window, offsets=offsets),
        document=document_of(
            case.inputs, case.outputs, system, best.delay, one_path=method == "transfer_function"
        ), status=status, seconds=time.perf_counter() - began,
        warnings=(
            *doubts(recorded, together, parts[0], delay, round(largest_delay / case.h)),
            *((UNJUDGED,) if experiment.windows[1] is not None and not tells else ()),
        ),
    )  # fmt: skip


_Candidate = tuple[Tried, Discrete, int, Samples]
"""What was tried, its model, its delay in samples, its constants."""


def _tried(
    case: _Case, method: Method, orders: Sequence[int], largest_delay: float, watch: Monitor
) -> tuple[list[Tried], list[_Candidate], Status]:
    """Return every order tried, those that have a stable continuous model, and how the search ended."""
    candidates: list[_Candidate] = []
    tried = []

    def check() -> None:
        if watch.cancelled():
            raise _EndedError

    try:
        for done, (order, delay, model, constants) in enumerate(_models(case, method, orders, largest_delay, check)):
            check()
            seconds = delay * case.h
            if not model.stable or continuous(model, case.h) is None:
                remark = "unstable" if not model.stable else "no continuous model: a pole at half the sample rate"
                tried.append(Tried(order=order, delay=seconds, estimation=None, validation=None, remark=remark))
                continue
            scores = [case.score(model, delay, constants, window) for window in case.experiment.windows]
            tried.append(Tried(order=order, delay=seconds, estimation=scores[0], validation=scores[1]))
            candidates.append((tried[-1], model, delay, constants))
            watch.progress((done + 1) / (len(orders) + 1), f"order {order}: FIT {scores[0]:.2f} %")
    except _EndedError:
        return tried, candidates, Status.BUDGET if isinstance(watch, Limited) and watch.over else Status.CANCELLED
    return tried, candidates, Status.CONVERGED


class _EndedError(Exception):
    """The monitor wants the search to end: the best so far is the answer."""


class _Case:
    """The recording as matrices."""

    def __init__(self, experiment: RecordedExperiment, *, offsets: bool) -> None:
        recording = experiment.recording
        self.experiment, self.offsets, self.h = experiment, offsets, recording.sample_time
        self.inputs, self.outputs = tuple(recording.inputs), tuple(recording.outputs)
        self.u = np.array(list(recording.inputs.values()))
        self.y = np.array(list(recording.outputs.values()))
        window = experiment.windows[0]
        if window is None:
            raise ProblemError("the recording must have an estimation window, got none", at=("split",))
        self.part = recording.within(window)

    def validates(self) -> bool:
        """Tell whether inputs move in a validation window: a model without dynamics fits there where none do."""
        window = self.experiment.windows[1]
        return window is not None and bool(np.ptp(self.u[:, self.experiment.recording.within(window)], axis=1).any())

    def driven(self, delay: int) -> Samples:
        """Return the inputs later; each had its first value before the recording began, which is 0 where constants are free."""
        u = self.u - self.u[:, :1] if self.offsets else self.u
        return np.concatenate([np.repeat(u[:, :1], delay, axis=1), u[:, : u.shape[1] - delay]], axis=1)

    def path(self, part: slice, *, lead: int, check: Callable[[], None]) -> OutputError:
        """Return a part of the only path, with so many samples of the input from before it."""
        u = np.pad(self.driven(0)[0], (lead, 0), constant_values=0.0 if self.offsets else self.u[0, 0])
        return OutputError(
            u[part.start : part.stop + lead], self.y[0, part], offset=self.offsets, lead=lead, check=check
        )

    def liveliest(self, samples: int) -> slice:
        """Return the stretch of so many samples of the estimation window in which the output moves most."""
        start, stop = self.part.start, self.part.stop
        if stop - start <= samples:
            return self.part
        y = self.y[0, self.part] - self.y[0, self.part].mean()
        first, second = (np.concatenate([[0.0], np.cumsum(power)]) for power in (y, y * y))
        moves = second[samples:] - second[:-samples] - (first[samples:] - first[:-samples]) ** 2 / samples
        begin = start + int(np.argmax(moves))
        return slice(begin, begin + samples)

    def compared(
        self, model: Discrete, delay: int, constants: Samples, window: tuple[float, float] | None
    ) -> dict[str, tuple[Samples, Samples]]:
        """Return measured and simulated outputs in a window, from the state that fits best."""
        if window is None:
            return {}
        part = self.experiment.recording.within(window)
        still = Discrete(a=model.a, b=model.b, c=model.c, d=model.d, x0=np.zeros(len(model.a)))
        forced = still.simulate(self.driven(delay)[:, part]) + constants[:, None]
        free = model.c @ model.powers(forced.shape[1])
        y = self.y[:, part]
        table = free.reshape(-1, len(model.a))
        scale = np.linalg.norm(table, axis=0)
        scale[scale == 0] = 1.0
        corner = triangle(np.concatenate([table / scale, (y - forced).T.reshape(-1, 1)], axis=1))
        state = np.linalg.lstsq(corner[:, :-1], corner[:, -1], rcond=1e-9)[0] / scale
        simulated = forced + (free @ state).T
        return {name: (measured, own) for name, measured, own in zip(self.outputs, y, simulated, strict=True)}

    def score(
        self, model: Discrete, delay: int, constants: Samples, window: tuple[float, float] | None
    ) -> float | None:
        """Return the mean FIT of the outputs in a window, %."""
        pairs = self.compared(model, delay, constants, window)
        fits = [compare(*pair).fit_percent for pair in pairs.values()]
        return float(np.mean([fit for fit in fits if fit is not None])) if fits else None

    def predicted(self, model: Discrete, delay: int, constants: Samples) -> dict[str, Fit]:
        """Return the fits of one-step predictions: the simulation plus an autoregression of the errors just measured."""
        estimation, validation = self.experiment.windows
        learnt = self.compared(model, delay, constants, estimation)
        judged = self.compared(model, delay, constants, validation or estimation)
        found = {}
        for name, (measured, simulated) in judged.items():
            noise = fitted(learnt[name][0] - learnt[name][1])
            found[name] = compare(measured, measured - noise.innovations(measured - simulated))
        return found

    def trivial(self, window: tuple[float, float] | None, *, offsets: bool) -> dict[str, dict[str, Fit]]:
        """Return what models without dynamics reach in a window."""
        part = self.experiment.recording.within(window or (0.0, self.experiment.recording.end))
        by_output = {
            name: baselines(y[part], self.u[:, part], constant=offsets)
            for name, y in zip(self.outputs, self.y, strict=True)
        }
        return {
            kind: {name: fits[kind] for name, fits in by_output.items()} for kind in ("mean", "input", "static_gain")
        }


def _judged(tried: Tried, *, validated: bool) -> float:
    fit = tried.validation if validated else tried.estimation
    return -np.inf if fit is None else fit


def _models(
    case: _Case, method: Method, orders: Sequence[int], largest_delay: float, check: Callable[[], None]
) -> Iterator[tuple[int, int, Discrete, Samples]]:
    """Yield order, delay in samples, model and constants."""
    y = case.y[:, case.part]
    if method == "subspace":
        u = case.driven(0)[:, case.part]
        horizon = min(2 * max(orders) + 10, u.shape[1] // (4 * (len(u) + len(y))))
        decomposed = Subspace(u, y, horizon, offset=case.offsets)
        for order in sorted(orders):
            yield order, 0, *decomposed.model(order)
        return
    delays = round(largest_delay / case.h)
    whole = case.path(case.part, lead=delays, check=check)
    looked = case.path(case.liveliest(_LOOKED_AT), lead=delays, check=check)
    before: tuple[Samples, int] | None = None
    for order in sorted(orders):
        starts = _begun(looked, order, delays)
        if before is not None and len(before[0]) == order - 1:
            starts.append((whole.extended(before[0]), before[1]))
        found = [(looked.polished(f, delay), delay) for f, delay in starts]
        if looked.samples < whole.samples:  # the rest of a long recording only moves what the liveliest part has found
            f, delay = min(found, key=lambda one: whole.left(*one))
            delay = whole.nearest(f, delay, delays)
            found = [(whole.polished(f, delay, most=_TO_MOVE), delay)]
        before = min(found, key=lambda one: whole.left(*one))
        model, constant = whole.model(*before)
        yield order, before[1], model, np.array([constant])


def _begun(whole: OutputError, order: int, delays: int) -> list[tuple[Samples, int]]:
    """Return the most promising denominators with their delays, the best first.

    Where the input and the output begin to agree tells roughly which delays to try, and a coarse grid guards against that being
    wrong; around the best of both the grid becomes finer, down to single samples.
    """
    tried: dict[int, tuple[Samples, float]] = {}

    def look(candidates: Iterable[int]) -> None:
        for delay in candidates:
            if 0 <= delay <= delays and delay not in tried:
                tried[delay] = whole.started(order, delay)

    def best() -> list[int]:
        return sorted(tried, key=lambda delay: tried[delay][1])[:_PROMISING]

    stride = max(1, delays // _COARSE)
    likely = whole.onset(delays)
    look([*range(0, delays + 1, stride), delays, *range(likely - 2, likely + 3)])
    while stride > 1:
        stride = (stride + 1) // 2
        for delay in best():
            look((delay - stride, delay + stride))
    return [(tried[delay][0], delay) for delay in best()]
