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
from engine.signals import changed
from engine.spectra.fourier import Complex, Real, transform
from engine.verdicts import Verdict

if TYPE_CHECKING:
    from engine.diagram import Diagram
    from engine.linear.curve import Curve
    from engine.linear.system import Array
    from engine.signals import Signal


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
        If the path does not settle, or a command does not end.
    """
    evaluation = Evaluation(diagram, overrides)
    response = evaluation.time_response(signals, [output])
    verdict = response.verdicts[output]
    if verdict is not Verdict.OK or response.joint is None:
        raise SpectrumError(
            f"output must settle to have a spectrum, got {output}, whose path is {verdict}", at=("output",)
        )
    final = response.finals[output]
    if final is None:
        msg = "signal must end for a response to have a Fourier integral, got one that goes on for ever"
        raise SpectrumError(msg, at=("input",))
    initial = response.initials[output]
    return response.joint.output(response.columns[output]) + -initial, final - initial


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
