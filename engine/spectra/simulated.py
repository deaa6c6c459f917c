"""Exact spectra of simulated responses, and how they change with the command.

    Y(jω) of an output's whole response; a waterfall is |Y(jω)| over ω and over one parameter of the command

A programmed delay τ with equal shares puts the factor |cos(ωτ/2)| on the spectrum: its zeros are to be laid on the
structure's resonances.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from engine.errors import SpectrumError
from engine.evaluation import Evaluation
from engine.metrics._base import NEGLIGIBLE
from engine.signals import changed
from engine.spectra.energy import band_energy
from engine.spectra.fourier import Complex, Real, transform
from engine.spectra.harmonics import Harmonics, harmonics_of_curve
from engine.verdicts import Verdict

if TYPE_CHECKING:
    from engine.diagram import Diagram
    from engine.linear.curve import Curve
    from engine.linear.system import Array
    from engine.metrics._base import TimeSubject
    from engine.signals import Signal

_WIDEST = 1e6
_FAINT = 1e-5
"""Where a spectrum is looked at unless told: up to so many times its lowest frequency, and down to so little of its peak."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Waterfall:
    """|Y(jω)| of an output (unit of the output, times s), shape (values, frequencies)."""

    values: Real
    frequency: Real
    magnitude: Real


def whole_response(
    diagram: Diagram, signals: Mapping[str, Signal], output: str, *, overrides: Mapping[str, float] | None = None
) -> tuple[Curve, Array]:
    """Return the departure of an output from its initial value, and where it settles.

    Raises
    ------
    SpectrumError
        If the output does not settle, or a command does not end.
    """
    subject = _settled(diagram, signals, output, overrides)
    if subject.final is None:
        msg = "signal must end for a response to have a Fourier integral, got one that goes on for ever"
        raise SpectrumError(msg, at=("input",))
    return subject.curve + -subject.initial, subject.final - subject.initial


def _settled(
    diagram: Diagram, signals: Mapping[str, Signal], output: str, overrides: Mapping[str, float] | None
) -> TimeSubject:
    """Return the whole response of an output that becomes steady."""
    subject = Evaluation(diagram, overrides).time_subject(signals, output)
    if subject.verdict is not Verdict.OK or subject.y is None:
        msg = f"output must settle to have a spectrum, got {output}, which is {subject.verdict}"
        raise SpectrumError(msg, at=("output",), verdict=str(subject.verdict))
    return subject


def steady_harmonics(
    diagram: Diagram,
    signals: Mapping[str, Signal],
    output: str,
    *,
    fundamental: float,
    count: int,
    overrides: Mapping[str, float] | None = None,
) -> Harmonics:
    """Return the harmonics of an output's steady state under periodic commands, without sampling.

    Parameters
    ----------
    diagram : Diagram
    signals : mapping of input name to Signal
        Every one periodic, with a period that is a whole part of the fundamental's.
    output : str
    fundamental : float
        rad/s.
    count : int
        Highest order.
    overrides : mapping, optional
        Parameter values, SI.

    Raises
    ------
    SpectrumError
        If the output does not become steady, or a command does not repeat with the fundamental.
    """
    for signal in signals.values():
        period = signal.period()
        times = 0.0 if period is None else 2 * np.pi / (fundamental * period)
        if times < 0.5 or abs(times - round(times)) > 1e-9 * times:
            msg = f"fundamental must be that of the commands to look at a steady state, got {fundamental:g} rad/s"
            raise SpectrumError(msg, at=("fundamental",))
    return harmonics_of_curve(_settled(diagram, signals, output, overrides).curve, fundamental, count)


def telling_frequencies(curve: Curve, final: Array, count: int = 400) -> Real:
    """Return angular frequencies, even on a log axis, from the length of a response up to where nothing is left."""
    low = 2 * np.pi / (curve.end - float(curve.times[0]))
    scan = low * np.geomspace(1.0, _WIDEST, count)
    size = np.abs(transform(curve, scan, final=final).value)
    loud = np.flatnonzero(size > _FAINT * size.max())
    return np.asarray(np.geomspace(low, scan[max(int(loud[-1]), 1)] if loud.size else 10 * low, count))


def energy_in_band(curve: Curve, final: Array, band: tuple[float, float]) -> float:
    """Return the energy between two angular frequencies, in (unit of the curve)² s.

    Raises
    ------
    SpectrumError
        If the band begins at 0 and the response does not return to where it began.
    """
    largest = float(np.abs(curve.values[:, :, 0].real).max())
    stays_away = abs(float(final[0].real)) > NEGLIGIBLE * largest
    if stays_away and band[0] == 0:
        msg = "band must begin above 0 rad/s for an output that stays away from where it began, got 0"
        raise SpectrumError(msg, at=("band", 0))
    return float(band_energy(curve, *band, final=final if stays_away else None)[0].real)


def response_spectrum(
    diagram: Diagram,
    signals: Mapping[str, Signal],
    output: str,
    frequencies: Real,
    *,
    overrides: Mapping[str, float] | None = None,
) -> Complex:
    """Return Y(jω) of an output's departure from its initial value.

    Parameters
    ----------
    diagram : Diagram
    signals : mapping of input name to Signal
    output : str
    frequencies : ndarray, shape (frequencies,)
        rad/s, > 0.
    overrides : mapping, optional
        Parameter values, SI.

    Returns
    -------
    ndarray of complex, shape (frequencies,)
        Unit of the output, times s.

    Raises
    ------
    SpectrumError
        If the path does not settle, or a command does not end.
    """
    curve, final = whole_response(diagram, signals, output, overrides=overrides)
    return transform(curve, frequencies, final=final).value


def waterfall(
    diagram: Diagram,
    signals: Mapping[str, Signal],
    output: str,
    frequencies: Real,
    *,
    port: str,
    parameter: str,
    values: Sequence[float],
    overrides: Mapping[str, float] | None = None,
) -> Waterfall:
    """Return the spectra of an output for several values of one parameter of the command at ``port``.

    Parameters
    ----------
    parameter : str
        ``delay``; ``command.max_velocity`` for one of an inner command.
    values : sequence of float
        SI.

    Other parameters and raised errors are those of :func:`response_spectrum`; SignalError for a value that the
    command refuses.
    """
    rows = [
        np.abs(
            response_spectrum(
                diagram,
                {**signals, port: changed(signals[port], parameter, float(value))},
                output,
                frequencies,
                overrides=overrides,
            )
        )
        for value in values
    ]
    magnitude = np.array(rows).reshape(len(rows), len(frequencies))
    return Waterfall(values=np.asarray(values, dtype=np.float64), frequency=frequencies, magnitude=magnitude)
