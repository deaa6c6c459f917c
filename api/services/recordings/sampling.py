"""The instants of samples, told by a column of time: sample rate, gaps, unevenness.

    rate = steps / (t_last - t_first),   a gap is a step of more than 1.5 usual ones

A gap is filled with missing samples, so that what follows keeps its place on the time axis; everything that needs a
whole recording then refuses it by name, instead of bending at the joint. Instants that are on no even axis are told
(`regular`): they are kept as they are, or resampled where that is asked for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from api.formats import FormatError
from api.services.recordings.evenness import Evenness, rounding
from engine.recordings.sample_rates import refusal

Values = npt.NDArray[np.float64]

_UNREAD = "say sample_rate in import, without time, and the instants are not looked at"
_GAP = 1.5
_MOST_GAPS = 100_000
_SHOWN = 100
_FREE = 1_000_000
_DAY = 86_400.0
_TELLING = 64
"""Instants of a piece that tell their rounding: few may be round by chance."""
_SLOPE = 1.25
"""How much wider a band of instants may be for a slope that is known from the first of them."""
_SLOPE_OF_ANOTHER = 2.0
"""The same between gaps, for the slope of the longest stretch."""
_EVEN = 1e-3
"""What an instant may be off its place on an even axis, in samples, whatever its printing."""


@dataclass(slots=True, kw_only=True)
class TimeAxis:
    """Follows the instants of samples piece by piece.

    Parameters
    ----------
    requested : float, optional
        Samples per second that were asked for.
    fill : bool
        Whether gaps are filled with missing samples.
    of_day : bool
        Whether the instants are times of day, which begin again at midnight.
    scale : float
        What an instant is multiplied by to be s.
    judging : bool
        Whether the instants are only looked at: gaps are not bounded then.
    """

    requested: float | None = None
    fill: bool = True
    of_day: bool = False
    scale: float = 1.0
    judging: bool = False
    count: int = 0
    missing: int = 0
    _first: float = math.nan
    _last: float = math.nan
    _usual: float = math.nan
    _slack: float = 0.0
    _lost: float = 0.0  # time in gaps that are not filled, s
    _gaps: list[tuple[int, int, float]] = field(default_factory=list)
    _evenness: Evenness = field(default_factory=Evenness)
    _rounding: float = 0.0
    _days: float = 0.0

    def add(self, instants: Values) -> Values:
        """Look at the next instants (n,) as the file has them, and return them in s from the first one.

        Raises
        ------
        FormatError
            When time stands still, runs backwards, is missing, or leaps over more than was recorded.
        """
        if not instants.size:
            return instants
        if not np.all(np.isfinite(instants)):
            at = self.count + int(np.flatnonzero(~np.isfinite(instants))[0])
            raise FormatError(f"time must be given for every sample, got none at sample {at}: {_UNREAD}")
        if instants.size >= _TELLING or not self.count:
            self._rounding = max(self._rounding, rounding(instants) * self.scale)
        instants = instants * self.scale
        if self.of_day:
            instants = self._past_midnight(instants)
        steps = np.diff(instants, prepend=self._last)
        if math.isnan(self._last):
            self._first = float(instants[0])
            steps = steps[1:]
            self._learn(steps)
        offset = self.count + instants.size - steps.size
        if np.any(steps < 0.0):
            at = int(np.flatnonzero(steps < 0.0)[0])
            raise FormatError(
                f"time must not run backwards, got a step of {steps[at]:.6g} s at sample {offset + at}: sort its rows, or {_UNREAD}"
            )
        gaps = np.flatnonzero(steps > _GAP * self._usual + self._slack)
        self._evenness.add(instants, gaps + instants.size - steps.size)
        self.count += instants.size
        for at in gaps.tolist():
            self._gap(offset + at, float(steps[at]))
        self._last = float(instants[-1])
        return instants - self._first

    def _past_midnight(self, instants: Values) -> Values:
        before = math.nan if math.isnan(self._last) else self._last - self._days
        back = np.diff(instants, prepend=before) < -0.5 * _DAY
        instants = instants + self._days + _DAY * np.cumsum(back)
        self._days += _DAY * float(back.sum())
        return instants

    def _learn(self, steps: Values) -> None:
        if not steps.size:
            raise FormatError(f"time must have at least 2 instants, got 1: {_UNREAD}")
        positive = steps[steps > 0.0]
        if not positive.size:
            raise FormatError(f"time must rise, got {steps.size + 1} equal instants: {_UNREAD}")
        # the mean of what is no gap, so that steps which take turns do not count as gaps
        usual = float(steps[steps <= 1.75 * np.median(steps)].mean())
        if positive.size < steps.size:
            # instants of a coarse clock: several samples share one
            usual = float(steps.sum()) / steps.size
            self._slack = float(positive.min())
        self._usual = usual if self.requested is None else 1.0 / self.requested

    def _gap(self, before: int, step: float) -> None:
        missing = max(round(step / self._usual) - 1, 1)
        if self.judging:
            return
        if len(self._gaps) >= _MOST_GAPS:
            raise FormatError(f"time must have at most {_MOST_GAPS} gaps, got more: is its unit right?")
        self._gaps.append((before, missing, step))
        if not self.fill:
            self._lost += step - self._usual
            return
        self.missing += missing
        if self.missing > _FREE + self.count:
            raise FormatError(
                f"gaps must not be longer than what was recorded, got {self.missing} missing samples after "
                f'{self.count} at sample {before} ({step:.6g} s): cut the file there, or say gaps: "close"'
            )

    def filled(self, start: int, values: Values) -> Values:
        """Return samples, the first of which is number ``start``, with the missing ones between them."""
        if not self.fill or not self._gaps:
            return values
        inside = [(at - start, missing) for at, missing, _ in self._gaps if start <= at < start + values.size]
        if not inside:
            return values
        places, counts = zip(*inside, strict=True)
        return np.insert(values, np.repeat(places, counts), np.nan)

    @property
    def rate(self) -> float:
        """Samples per second, found from the first and the last instant; that asked for where they cannot tell."""
        steps = self.count - 1 + self.missing
        span = self._last - self._first - self._lost
        if steps < 1 or span <= 0.0:
            raise FormatError(f"time must have at least 2 different instants, got fewer: {_UNREAD}")
        found = float(f"{steps / span:.9g}")
        if refused := refusal(found):
            raise FormatError(f"{refused} by the instants of the file: is the unit of time right?")
        # a stamp is known to the clock's step or to a millionth of its usual distance, a gap to half a sample
        doubt = (max(self._slack, 1e-6 * self._usual) + 0.5 * self._usual * len(self._gaps)) / span
        nominal = self.requested or float(f"{1.0 / self._usual:.9g}")
        return nominal if abs(found - nominal) <= doubt * nominal else found

    @property
    def regular(self) -> bool:
        """Whether the instants are on an even axis, as far as their rounding tells.

        Rounding leaves a band as wide as the last digit, or as the step of a clock that gives several samples one stamp.
        """
        band = (_SLOPE_OF_ANOTHER if self._evenness.broken else _SLOPE) * max(self._rounding, self._slack)
        return self._evenness.jitter() <= max(0.5 * band, _EVEN * self._usual)

    def places(self, samples: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Return the places (n,) of some samples of the file on the even axis, where filled gaps have places of their own."""
        if not self.fill or not self._gaps:
            return samples
        at, missing, _ = zip(*self._gaps, strict=True)
        before = np.concatenate([[0], np.cumsum(missing)]).astype(np.int64)
        return samples + before[np.searchsorted(at, samples, side="right")]

    @property
    def first(self) -> float:
        """The first instant as the file has it, s."""
        return self._first

    def uneven(self) -> float:
        """Return how far an instant is from its place on an even axis, at most, in samples; what rounding does counts."""
        return self._evenness.jitter() / self._usual

    @property
    def usual_rate(self) -> float:
        """Samples per second of the usual step."""
        return 1.0 / self._usual

    @property
    def span(self) -> float:
        """From the first instant to the last, s."""
        return self._last - self._first

    def document(self) -> dict[str, Any]:
        """Return what is known of the instants: the first one, gaps (the first 100) as sample, missing samples and seconds."""
        shown = [{"sample": at, "missing": missing, "step": step} for at, missing, step in self._gaps[:_SHOWN]]
        return {
            "requested": self.requested,
            "first": self._first,
            "actual": self.rate,
            "uneven": self.uneven(),
            "gaps": shown,
            "gap_count": len(self._gaps),
            "filled": self.missing,
        }

    def remarks(self) -> list[str]:
        """Return sentences on what a person should know."""
        said = []
        if self._gaps:
            what = "filled with missing samples" if self.fill else "closed: what follows is too early on the time axis"
            at, missing, step = max(self._gaps, key=lambda gap: gap[2])
            said.append(
                f"time has {len(self._gaps)} gaps, the longest of {step:.6g} s ({missing} samples) before sample {at}; "
                f"they are {what}"
            )
        if self.requested and abs(self.rate - self.requested) > 1e-3 * self.requested:
            said.append(f"the time column gives {self.rate:.9g} samples/s where {self.requested:.9g} were requested")
        return said
