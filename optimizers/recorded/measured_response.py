"""A measured frequency response as an experiment of an identification: its lines, and how certain each of them is.

    σ² = |H|² (1 - γ²) / (2 n γ²)     of the real and of the imaginary part alike

γ² is the coherence, n the number of independent averages.

References
----------
J. S. Bendat, A. G. Piersol, "Random Data", 4th ed., Wiley 2010, section 9.2.4 (random errors of gain and phase).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from engine.analysis.evaluation import Evaluation
from engine.exact.sampled_data.response import SampledResponse
from engine.model.between_samples import BetweenSamples
from engine.model.errors import Path
from engine.recordings.spectra.frf import Frf
from optimizers.problem import ProblemError

if TYPE_CHECKING:
    from engine.diagram.diagram import Diagram

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

LEAST_FREEDOM: Final = 6.0
"""Weights are estimates, too: with fewer degrees of freedom a line that looks certain by chance counts too much."""
_NO_COHERENCE: Final = 0.01
"""Probability with which a line without any coherence is taken for one that tells something."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredResponse:
    """The lines of one output over one input that tell something.

    Parameters
    ----------
    frequency : ndarray, shape (lines,)
        rad/s, rising, > 0.
    value : ndarray of complex, shape (lines,)
        SI.
    deviation : ndarray, shape (lines,)
        Standard deviation of the real part, and of the imaginary part; 1 at all lines where every line counts alike.
    freedom : float
        Degrees of freedom behind each deviation; 0 where every line counts alike, infinite where they are known.
    line_width : float
        Lines that share their random error.
    left_out : int
        Lines of the band that tell nothing.
    """

    frequency: Real
    value: Complex
    deviation: Real
    freedom: float = math.inf
    line_width: float = 1.0
    left_out: int = 0

    @property
    def lines(self) -> int:
        """Number of lines."""
        return int(self.frequency.size)


def measured_response(frf: Frf, *, least_coherence: float, weighted: bool) -> MeasuredResponse:
    """Return the lines of a frequency response function that can be compared with a model.

    Left out are rest, lines without input, lines whose coherence is below the limit, and lines whose coherence chance alone
    would give in 1 of 100: 1 - 0.01^(1/(n - 1)) of n averages.

    Parameters
    ----------
    frf : Frf
    least_coherence : float
    weighted : bool
        Whether each line counts by its random error; all of them alike otherwise.

    Raises
    ------
    ProblemError
        Where nothing tells the random error, or too few averages do, or no line is left.
    """
    told = np.isfinite(frf.value) & (frf.frequency > 0)
    limit = least_coherence
    if frf.coherence is not None:
        if frf.effective_averages > 1:
            limit = max(limit, 1.0 - _NO_COHERENCE ** (1.0 / (frf.effective_averages - 1.0)))
        told &= frf.coherence >= limit
    if weighted:
        if frf.magnitude_error is None or frf.freedom < LEAST_FREEDOM:
            raise ProblemError(
                f"segment must leave at least {1 + LEAST_FREEDOM / 2:g} independent averages for weights by coherence, got "
                f"{frf.effective_averages:.3g}: take shorter segments, or weights 'equal'",
                at=("segment",),
            )
        told &= np.isfinite(frf.magnitude_error)
    if not told.any():
        first, last = frf.frequency[0], frf.frequency[-1]
        raise ProblemError(
            f"band must hold lines with a coherence of at least {limit:.3g}, got none among {frf.frequency.size} from "
            f"{first:g} to {last:g} rad/s",
            at=("band",),
        )
    value = frf.value[told]
    deviation = np.ones(value.size)
    if weighted and frf.magnitude_error is not None:
        # where coherence is 1 to the last digit nothing is certain beyond rounding
        least = 1e-9 * float(np.abs(value).max())
        deviation = np.maximum(np.abs(value) * frf.magnitude_error[told], least)
    return MeasuredResponse(
        frequency=frf.frequency[told],
        value=value,
        deviation=deviation,
        freedom=frf.freedom if weighted else 0.0,
        line_width=frf.line_width,
        left_out=int(told.size - told.sum()),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyExperiment:
    """Measured responses of some outputs over one input, with what is known of this experiment alone.

    Parameters
    ----------
    source : str
        An input of the diagram.
    responses : mapping of str to MeasuredResponse
        By outputs of the diagram.
    sample_time : float
        Of the recording behind them, s.
    between_samples : BetweenSamples or None
        What the input does between its samples: BAND_LIMITED compares with G(jω), HOLD and LINEAR from sample to sample;
        None where every way is to be tried.
    name : str
        Different for each of several.
    values : mapping of str to float
        Parameters (SI) that had another value in this experiment than the diagram says.
    remarks : tuple of str
        Systematic errors of the measurement.
    at : tuple
        Where the experiment stands in its document, for messages.
    """

    source: str
    responses: Mapping[str, MeasuredResponse]
    sample_time: float
    between_samples: BetweenSamples | None = BetweenSamples.BAND_LIMITED
    name: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    at: Path = ()

    def with_undecided(self, way: BetweenSamples) -> FrequencyExperiment:
        """Return this experiment with one way for an input that is undecided."""
        return self if self.between_samples is not None else replace(self, between_samples=way)

    @property
    def lines(self) -> int:
        """Number of lines of all outputs."""
        return sum(one.lines for one in self.responses.values())

    def check(self, diagram: Diagram) -> None:
        """Refuse names that the diagram does not have.

        Raises
        ------
        ProblemError
        """
        if self.source not in diagram.inputs:
            raise ProblemError(
                f"inputs must be among {', '.join(diagram.inputs)}, got {self.source!r}", at=(*self.at, "inputs")
            )
        if not self.responses:
            raise ProblemError("outputs must name at least one measured signal, got none", at=(*self.at, "outputs"))
        for name in self.responses:
            if name not in diagram.outputs:
                raise ProblemError(
                    f"outputs must be among {', '.join(diagram.outputs)}, got {name!r}", at=(*self.at, "outputs", name)
                )
        if diagram.sampled and self.between_samples in {BetweenSamples.HOLD, BetweenSamples.LINEAR}:
            raise ProblemError(
                "between_samples must be band_limited (or auto) for a system with samplers, which has samples of its own, "
                f"got {self.between_samples}",
                at=(*self.at, "inputs", self.source),
            )
        if diagram.sampled:
            self._check_samplers(diagram)

    def _check_samplers(self, diagram: Diagram) -> None:
        evaluation = Evaluation(diagram, self.values)
        for name, one in self.responses.items():
            curve = evaluation.path(self.source, name).response
            if isinstance(curve, SampledResponse) and one.frequency[-1] > curve.nyquist:
                raise ProblemError(
                    f"band must end below {curve.nyquist:g} rad/s, half the rate of the slowest sampler on the way to {name}, "
                    f"got a line at {one.frequency[-1]:g}",
                    at=(*self.at, "band"),
                )
