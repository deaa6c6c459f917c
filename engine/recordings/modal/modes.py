"""Natural frequencies and damping ratios of measured frequency response functions, with their confidence.

Candidates come from a linear estimate at many orders (``poles``), are fitted together (``fit``), and a mode stays only if the
fit needs it:  cost without it - cost with it > unknowns · ln(numbers) · variance   (G. Schwarz, Ann. Statist. 6 (1978) 461).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from engine.exact.frequency.fourier import Complex, Real
from engine.model.errors import SpectrumError
from engine.recordings.modal.fit import Fitted, Lines, fit_modes
from engine.recordings.modal.poles import MOST_ORDER, Candidate, candidates
from engine.recordings.spectra.frf import Frf

MOST_MODES = 20
_FEWEST_LINES = 12
_ORDERS = (20, 30, 40, 60, MOST_ORDER)
"""Highest orders of the models that candidates come from: the lower the modes lie in a band, the higher it must be."""
_USUAL_ORDER, _LINES_FOR_ORDER = 40, 8
"""Higher orders take so many lines for each: of a few coarse ones they would make two modes of one that leakage has bent."""
_EXPLAINED = 1.5
"""Weighted squares for each number that is fitted, up to which a fit leaves nothing but the known random errors."""
_KNOWN, _AROUND = 0.3, 3
"""Standard deviation of a phase, rad, beyond which a response is noise; it counts as far as so many lines on either side agree, for
noise is sometimes coherent by chance."""
_LEAST_ERROR = 1e-4
"""Relative standard deviation below which nobody knows a line: sensors do not."""
_MOST_UNCERTAIN = 0.5
"""Of a damping ratio: beyond it a mode is a guess."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Mode:
    """One mode.

    Parameters
    ----------
    frequency, frequency_error : float
        Undamped natural frequency and its standard deviation, rad/s.
    damping, damping_error : float
        Damping ratio and its standard deviation.
    residues : mapping of str to complex
        A of A/(jω - λ) + A*/(jω - λ*), for each response, in its unit times rad/s.
    doubt : str
        What the error does not show; "" for nothing.
    """

    frequency: float
    frequency_error: float
    damping: float
    damping_error: float
    residues: Mapping[str, complex]
    doubt: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Modes:
    """The modes of a band by frequency, what they give on its lines, and the relative error of that in percent.

    ``left_out`` counts the lines that tell nothing: no input is there, or noise hides the response.
    """

    modes: tuple[Mode, ...]
    frequency: Real
    model: Mapping[str, Complex]
    relative_error_percent: float
    left_out: int = 0


def modes_of(frfs: Mapping[str, Frf], *, count: int | None = None) -> Modes:
    """Return the modes that several responses to one input have in common.

    Parameters
    ----------
    frfs : mapping of str to Frf
        With the same lines; velocities and accelerations over forces as receptances.
    count : int, optional
        How many modes there are; by default those that the data need.

    Raises
    ------
    SpectrumError
        If there are too few lines, or fewer modes than asked for.
    """
    lines = _lines(frfs)
    line_width = max(frf.line_width for frf in frfs.values())
    if count is not None and not 1 <= count <= MOST_MODES:
        raise SpectrumError(f"count must be 1 to {MOST_MODES}, got {count}", at=("count",))
    most, seen, best = min(lines.w.size // 2 - 1, max(_USUAL_ORDER, lines.w.size // _LINES_FOR_ORDER)), 0, None
    for order in sorted({min(most, max(order, 4 * (count or 0) + 12)) for order in _ORDERS}):
        found = candidates(lines.w, lines.responses, lines.weights / lines.weights.max(), order=order)
        seen = max(seen, len(found))
        if not found or len(found) < (count or 0):
            continue
        fitted = _fitted(lines, found, count=count, line_width=line_width)
        if best is None or _criterion(lines, fitted, line_width) < _criterion(lines, best, line_width):
            best = fitted
        if all(frf.phase_error is not None for frf in frfs.values()) and best.cost < _EXPLAINED * lines.numbers:
            break
    if best is not None:
        return _named(frfs, lines, best)
    if count is not None:
        shown = (
            f"count must be <= {seen}, the modes that the band shows"
            if seen
            else "the band must show modes, it shows none"
        )
        raise SpectrumError(
            f"{shown}, got {count}: take another band, or leave count out to see what there is", at=("count",)
        )
    empty = {name: np.zeros(lines.w.size, dtype=np.complex128) for name in frfs}
    return Modes(
        modes=(), frequency=lines.w, model=empty, relative_error_percent=100.0, left_out=_left_out(frfs, lines)
    )


def _fitted(lines: Lines, found: list[Candidate], *, count: int | None, line_width: float) -> Fitted:
    """Return the candidates fitted together, without those that the fit does not need."""
    likely = sorted(found, key=lambda candidate: -candidate.orders)[:MOST_MODES]
    start = _Poles(np.array([each.frequency for each in likely]), np.array([each.damping for each in likely]))
    # the many poles that noise makes go while their residues are all that is fitted; then all is
    fitted = fit_modes(lines, *_needed(lines, start, count=count, line_width=line_width), line_width=line_width)
    while True:
        poles = _needed(lines, _Poles(fitted.frequency, fitted.damping), count=count, line_width=line_width)
        if count is None:
            poles = _apart(lines, poles, line_width * float(np.diff(lines.w).min()))
        if len(poles.frequency) == len(fitted.frequency):
            return fitted
        fitted = fit_modes(lines, *poles, line_width=line_width)


def _criterion(lines: Lines, fitted: Fitted, line_width: float) -> float:
    """Return Schwarz's criterion of a fit: the less, the better."""
    numbers = lines.numbers / line_width
    return float(numbers * np.log(max(fitted.cost, 1e-300)) + lines.unknowns(fitted.frequency.size) * np.log(numbers))


def _lines(frfs: Mapping[str, Frf]) -> Lines:
    first = next(iter(frfs.values()))
    there = np.all([np.isfinite(frf.value) & (np.abs(frf.value) > 0) for frf in frfs.values()], axis=0)
    w = first.frequency[there]
    if w.size < _FEWEST_LINES:
        raise SpectrumError(f"band must hold at least {_FEWEST_LINES} lines to find modes, got {w.size}", at=("band",))
    known = np.array([_known(frf)[there] for frf in frfs.values()]).any(axis=0)
    if np.count_nonzero(known) >= _FEWEST_LINES:  # else whatever there is
        there[there] = known
        w = first.frequency[there]
    responses = np.array([frf.value[there] for frf in frfs.values()])
    weights = []
    for frf, response in zip(frfs.values(), responses, strict=True):
        if frf.phase_error is None:
            weights.append(np.full(w.size, 1 / np.linalg.norm(response)))
        else:
            error = np.clip(frf.phase_error[there], _LEAST_ERROR, 10.0)
            weights.append(1 / (np.abs(response) * error))
    return Lines(w=w, responses=responses, weights=np.array(weights))


def _known(frf: Frf) -> npt.NDArray[np.bool_]:
    """Return on which lines a response is known; noise over noise, where nothing excites, would be fitted as modes."""
    if frf.phase_error is None:
        return np.ones(frf.value.shape, dtype=np.bool_)
    error = np.where(np.isfinite(frf.phase_error), frf.phase_error, np.inf)
    around = np.pad(error, _AROUND, mode="edge")
    usual = np.median(np.lib.stride_tricks.sliding_window_view(around, 2 * _AROUND + 1), axis=-1)
    return np.asarray((error < _KNOWN) & (usual < _KNOWN))


class _Poles(NamedTuple):
    frequency: Real
    damping: Real

    def without(self, r: int) -> _Poles:
        return _Poles(np.delete(self.frequency, r), np.delete(self.damping, r))


def _needed(lines: Lines, poles: _Poles, *, count: int | None, line_width: float) -> _Poles:
    """Return the poles without which the fit is worse than their number excuses, or the ``count`` most needed ones."""
    cost = lines.cost(*poles)
    while len(poles.frequency) > (count or 1):
        costs = [lines.cost(*poles.without(r)) for r in range(len(poles.frequency))]
        least = int(np.argmin(costs))
        freedom = max(lines.numbers - lines.unknowns(len(poles.frequency)), 1)
        price = (lines.unknowns(1) - lines.unknowns(0)) * np.log(lines.numbers)
        gained = (costs[least] - cost) / max(cost / freedom, 1e-300) / line_width
        if count is None and gained > price:
            break
        poles, cost = poles.without(least), costs[least]
    return poles


def _apart(lines: Lines, poles: _Poles, resolution: float) -> _Poles:
    """Return poles without one of two that are nearer to each other than the lines tell apart: leakage bends one into two."""
    order = np.argsort(poles.frequency)
    near = np.flatnonzero(np.diff(poles.frequency[order]) < resolution)
    if not near.size:
        return poles
    pair = order[near[0] : near[0] + 2]
    return poles.without(int(min(pair, key=lambda r: lines.cost(*poles.without(int(r))))))


def _named(frfs: Mapping[str, Frf], lines: Lines, fitted: Fitted) -> Modes:
    order = np.argsort(fitted.frequency)
    modes = tuple(
        Mode(
            frequency=float(fitted.frequency[r]),
            frequency_error=float(fitted.frequency_error[r]),
            damping=float(fitted.damping[r]),
            damping_error=float(fitted.damping_error[r]),
            residues=dict(zip(frfs, (complex(value) for value in fitted.residues[:, r]), strict=True)),
            doubt=_doubt(frfs, fitted, int(r)),
        )
        for r in order
    )
    left = np.linalg.norm(lines.responses - fitted.model) / np.linalg.norm(lines.responses)
    model = dict(zip(frfs, fitted.model, strict=True))
    return Modes(
        modes=modes,
        frequency=lines.w,
        model=model,
        relative_error_percent=float(100 * left),
        left_out=_left_out(frfs, lines),
    )


def _left_out(frfs: Mapping[str, Frf], lines: Lines) -> int:
    return next(iter(frfs.values())).frequency.size - lines.w.size


def _doubt(frfs: Mapping[str, Frf], fitted: Fitted, r: int) -> str:
    frequency, damping = fitted.frequency[r], fitted.damping[r]
    if fitted.damping_error[r] > _MOST_UNCERTAIN * damping:
        return "the damping ratio is a guess: its error is as large as itself"
    for frf in frfs.values():
        for doubt in frf.doubts:
            near = doubt.frequency is not None and abs(doubt.frequency - frequency) < 0.05 * frequency
            if doubt.kind == "resonance_bias" and near:
                return "the lines are too far apart for this resonance: the damping ratio is read too high"
            if doubt.kind == "sweep":
                return "a window over a sweep or a pulse: frequency and damping ratio are off, or the mode is not there"
    return ""
