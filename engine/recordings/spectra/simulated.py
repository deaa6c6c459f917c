"""Exact spectra of simulated responses, and how they change with the command.

    Y(jω) of an output's whole response; a waterfall is |Y(jω)| over ω and over one parameter of the command

A programmed delay τ with equal shares puts the factor |cos(ωτ/2)| on the spectrum: its zeros are to be laid on the
structure's resonances.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from engine.analysis.evaluation import Evaluation
from engine.exact.frequency.energy import quadrature
from engine.exact.frequency.fourier import Complex, Real, transform
from engine.exact.frequency.harmonics import Harmonics, harmonics_of_curve
from engine.exact.time.chebyshev import interior
from engine.exact.time.curve import Curve
from engine.metrics._base import NEGLIGIBLE
from engine.model.errors import SpectrumError
from engine.model.failures import numerical
from engine.model.verdicts import Verdict
from engine.signals import changed

if TYPE_CHECKING:
    from engine.diagram.diagram import Diagram
    from engine.metrics._base import TimeSubject
    from engine.signals import Signal

_LIFETIMES = 18.0
"""So many time constants of the slowest mode leave e^-36 of its energy."""

_WIDEST = 1e6
_FAINT = 1e-5
"""Where a spectrum is looked at unless told: up to so many times its lowest frequency, and down to so little of its peak."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Waterfall:
    """|Y(jω)| of an output (unit of the output, times s), shape (values, frequencies)."""

    values: Real
    frequency: Real
    magnitude: Real


@dataclass(frozen=True, kw_only=True, eq=False)
class Transient:
    """The spectrum of a whole response that settles.

    ``at`` gives Y(jω) of the output's departure from its initial value, unit of the output times s, at frequencies > 0 in
    rad/s. ``length`` is how long the response lasts, s; ``stays_away`` says that it does not return to where it began.
    """

    at: Callable[[Real], Complex]
    length: float
    stays_away: bool

    def energy(self, low: float, high: float) -> float:
        """Return the energy between two angular frequencies, in (unit of the output)² s.

        Raises
        ------
        SpectrumError
            If the band begins at 0 and the response stays away.
        UnresolvedError
            If the band is too wide for the length of the response.
        """
        if self.stays_away and low == 0:
            msg = "band must begin above 0 rad/s for an output that stays away from where it began, got 0"
            raise SpectrumError(msg, at=("band", 0))
        frequencies, weights = quadrature(low, high, self.length)
        return float(weights @ np.abs(self.at(frequencies)) ** 2)

    def telling_frequencies(self, count: int = 400) -> Real:
        """Return frequencies, even on a log axis, from the length of the response up to where nothing is left."""
        low = 2 * np.pi / self.length
        scan = low * np.geomspace(1.0, _WIDEST, count)
        size = np.abs(self.at(scan))
        loud = np.flatnonzero(size > _FAINT * size.max())
        return np.asarray(np.geomspace(low, scan[max(int(loud[-1]), 1)] if loud.size else 10 * low, count))


@numerical()
def transient(
    diagram: Diagram, signals: Mapping[str, Signal], output: str, *, overrides: Mapping[str, float] | None = None
) -> Transient:
    """Return the spectrum of an output's response.

    Where the system is linear and starts from rest and the commands are polynomials in pieces, Y = Σ G(jω) U(jω), both in
    closed form; otherwise it is the Fourier integral of the response.

    Parameters
    ----------
    diagram : Diagram
    signals : mapping of input name to Signal
    output : str
    overrides : mapping, optional
        Parameter values, SI.

    Raises
    ------
    SpectrumError
        If the output does not settle, or a command does not end.
    """
    if any(signal.final() is None or signal.end() is None for signal in signals.values()):
        msg = "signal must end for a response to have a Fourier integral, got one that goes on for ever"
        raise SpectrumError(msg, at=("input",))
    evaluation = Evaluation(diagram, overrides)
    closed = not diagram.nonlinear and all(signal.degree() is not None for signal in signals.values())
    if closed and evaluation.poles.verdict is Verdict.OK and not np.any(evaluation.system.x0):
        return _product(evaluation, signals, output)
    subject = _settled(diagram, signals, output, overrides)
    if subject.final is None:
        msg = f"output must settle to have a spectrum, got {output}, which settles nowhere"
        raise SpectrumError(msg, at=("output",), verdict=str(Verdict.NOT_SETTLED))
    curve, final = subject.curve + -subject.initial, subject.final - subject.initial
    largest = float(np.abs(curve.values[:, :, 0].real).max())
    away = abs(float(final[0].real)) > NEGLIGIBLE * largest
    return Transient(
        at=lambda w: transform(curve, w, final=final if away else None).value,
        length=curve.end - float(curve.times[0]),
        stays_away=away,
    )


def _product(evaluation: Evaluation, signals: Mapping[str, Signal], output: str) -> Transient:
    """Return Σ G U."""
    paths = {port: evaluation.path(port, output) for port in signals}
    curves = {port: command_curve(signal) for port, signal in signals.items()}

    def at(w: Real) -> Complex:
        total = np.zeros(len(w), dtype=np.complex128)
        for port, signal in signals.items():
            final, last = float(signal.final() or 0.0), signal.breakpoints()[-1]
            curve = curves[port]
            held = final * np.exp(-1j * w * last) / (1j * w)
            total += paths[port].response(w) * (held if curve is None else held + transform(curve, w).value)
        return total

    ends = max(float(signal.end() or 0.0) for signal in signals.values())
    slowest = evaluation.pace.slowest
    length = ends + float(evaluation.system.delays.sum()) + (_LIFETIMES / slowest if np.isfinite(slowest) else 0.0)
    length = length or 1.0
    final = sum(
        float(path.static[0].real) * float(signals[port].final() or 0.0)
        for port, path in paths.items()
        if path.static is not None
    )
    # what an output that returns to where it began passes on at rest is rounding beside what it passes on at all
    scan = 2 * np.pi / length * np.geomspace(1.0, _WIDEST, 50)
    away = abs(final) > NEGLIGIBLE * float(np.abs(at(scan) * scan).max())
    return Transient(at=at, length=length, stays_away=away)


def command_curve(signal: Signal) -> Curve | None:
    """Return a command that is a polynomial in pieces as a curve up to its last break; None for a single step."""
    edges = np.array(signal.breakpoints())
    if len(edges) < 2:
        return None
    inside, to_nodes = interior()
    width = np.diff(edges)
    values = signal.value(edges[:-1, None] + width[:, None] * inside) @ to_nodes.T
    return Curve(edges=edges[:, None], values=values[:, :, None])


def _settled(
    diagram: Diagram, signals: Mapping[str, Signal], output: str, overrides: Mapping[str, float] | None
) -> TimeSubject:
    """Return the whole response of an output that becomes steady."""
    subject = Evaluation(diagram, overrides).time_subject(signals, output)
    if subject.verdict is not Verdict.OK or subject.y is None:
        msg = f"output must settle to have a spectrum, got {output}, which is {subject.verdict}"
        raise SpectrumError(msg, at=("output",), verdict=str(subject.verdict))
    return subject


@numerical()
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
        period = signal.repeats_after()
        times = 0.0 if period is None else 2 * np.pi / (fundamental * period)
        if times < 0.5 or abs(times - round(times)) > 1e-9 * times:
            msg = f"fundamental must be that of the commands to look at a steady state, got {fundamental:g} rad/s"
            raise SpectrumError(msg, at=("fundamental",))
    return harmonics_of_curve(_settled(diagram, signals, output, overrides).curve, fundamental, count)


@numerical()
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
    return transient(diagram, signals, output, overrides=overrides).at(frequencies)


@numerical()
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
