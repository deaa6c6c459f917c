"""A model beside one measured frequency response: errors at each line over their standard deviation, with slopes.

    r_k = (H_k - G(jω_k; p)) / σ_k,   real and imaginary part
    dG = dC z + y (dR + dM z) - y jω e^{jωτ} dτ z + dD,   F z = R,  Fᵀ y = Cᵀ     (F: see :mod:`engine.exact.frequency.response`)

Slopes of linear diagrams are exact, those of delays included. From sample to sample, of loops with samplers, and of the
linear part of nonlinear diagrams they are central differences of the exact response.

References
----------
R. Pintelon, J. Schoukens, "System Identification: A Frequency Domain Approach", 2nd ed., Wiley 2012, section 9.4 (the
weighted least squares of complex errors), 9.11 (what the least cost tells of model errors).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from time import monotonic
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from engine.analysis.evaluation import Evaluation
from engine.exact.frequency.path import connected
from engine.exact.frequency.sampled_frequency import sampled_frequency_response
from engine.model.between_samples import BetweenSamples
from engine.model.errors import EngineError
from engine.model.tangent import INFINITESIMAL, evened, slopes
from engine.recordings.fit import examine_residuals
from optimizers.identification.comparison import Errors
from optimizers.identification.result import JudgedResponse
from optimizers.recorded.measured_response import FrequencyExperiment, MeasuredResponse

if TYPE_CHECKING:
    from engine.diagram.diagram import Diagram
    from engine.model.linear_system import LaneSystem
    from optimizers.recorded.recording import Unknown

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

_DIFFERENCE: Final = 1e-5
"""Of central differences, relative: their own error is its square."""
_AT_ONCE: Final = 1 << 21
"""Complex numbers of one evaluation."""
_CHANCE: Final = 2.326
"""Standard deviations that chance exceeds in 1 of 100."""


class FrequencyComparison:
    """One measured response with its model, asked by :class:`Search` as a recording is; ``clock`` may end it by an error of its own."""

    states = 0

    def __init__(
        self,
        experiment: FrequencyExperiment,
        diagram: Diagram,
        unknowns: Sequence[Unknown],
        *,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self.experiment, self._clock = experiment, clock
        self._diagram, self._unknowns = diagram, tuple(unknowns)
        self._way = experiment.between_samples
        if diagram.sampled or self._way is None:
            self._way = BetweenSamples.BAND_LIMITED
        self._exact = self._way is BetweenSamples.BAND_LIMITED and not diagram.nonlinear
        responses = experiment.responses.values()
        self.signals = [(2, one.lines) for one in responses]
        # relative to the whole of each output, as a recording's errors are to its spread
        self._weights = [1.0 / (one.deviation * np.linalg.norm(one.value / one.deviation)) for one in responses]

    def errors(self, values: Mapping[str, float], _deviation: Real, slope: Real) -> Errors | None:
        """Return errors and slopes, None where the model has no response at a line."""
        residuals, moves = [], []
        answers = self._with_slopes(values)
        for measured, weight, (model, gradient) in zip(
            self.experiment.responses.values(), self._weights, answers, strict=True
        ):
            if not np.isfinite(model).all():
                return None
            error, move = (measured.value - model) * weight, -gradient * slope[:, None] * weight
            residuals += [error.real, error.imag]
            moves += [move.real, move.imag]
        return Errors(residuals=np.concatenate(residuals), jacobian=np.concatenate(moves, axis=1).T)

    def widths(self) -> list[float]:
        """Return how much wider each output's errors let the intervals be, since its weights are estimates.

        Weights of ν degrees of freedom cost (ν - 2)/(ν - 4) in variance: E[σ̂⁻⁴] / E[σ̂⁻²]².
        """
        found = []
        for one in self.experiment.responses.values():
            nu = one.freedom
            found.append(math.sqrt((nu - 2) / (nu - 4)) if 4 < nu < math.inf else 1.0)
        return found

    def pairs(self, values: Mapping[str, float]) -> dict[str, tuple[Complex, Complex]]:
        """Return measured and modelled responses by output; nothing where there is no model at these values."""
        try:
            answers = self._values(values)
        except EngineError:
            return {}
        named = zip(self.experiment.responses.items(), answers, strict=True)
        return {name: (one.value, model) for (name, one), model in named if np.isfinite(model).all()}

    def judged(self, values: Mapping[str, float]) -> dict[str, JudgedResponse]:
        """Return how the model stands to each output.

        Raises
        ------
        EngineError
            Where there is no model at these values.
        """
        answers = self._values(values)
        return {
            name: _judged(one, model)
            for (name, one), model in zip(self.experiment.responses.items(), answers, strict=True)
        }

    def _with_slopes(self, values: Mapping[str, float]) -> list[tuple[Complex, Complex]]:
        if self._exact:
            lanes = self._diagram.realize_lanes(
                dict.fromkeys(values, INFINITESIMAL), {**self.experiment.values, **values}
            )
            return list(self._on_paths(lanes))
        own = self._values(values)
        gradients: list[list[Complex]] = []
        for unknown in self._unknowns:
            at = values[unknown.parameter]
            step = _DIFFERENCE * (abs(at) or abs(unknown.start) or min(unknown.upper - unknown.lower, 1.0))
            ends = max(at - step, unknown.lower), min(at + step, unknown.upper)
            low, high = (self._values({**values, unknown.parameter: end}) for end in ends)
            gradients.append([(b - a) / (ends[1] - ends[0]) for a, b in zip(low, high, strict=True)])
        return [
            (value, np.array(slopes_of)) for value, slopes_of in zip(own, zip(*gradients, strict=True), strict=True)
        ]

    def _values(self, values: Mapping[str, float]) -> list[Complex]:
        """Return the responses of all outputs at their lines."""
        evaluation = Evaluation(self._diagram, {**self.experiment.values, **values})
        source = self.experiment.source
        self._clock()
        if self._diagram.sampled:
            return [
                np.asarray(evaluation.path(source, name).response(one.frequency), dtype=complex)
                for name, one in self.experiment.responses.items()
            ]
        if self._way is BetweenSamples.BAND_LIMITED:
            return [value for value, _ in self._on_paths(evaluation.system)]
        assert self._way is not None
        return [
            sampled_frequency_response(
                evaluation.system,
                (self._diagram.inputs.index(source), self._diagram.outputs.index(name)),
                one.frequency,
                sample_time=self.experiment.sample_time,
                way=self._way,
            )
            for name, one in self.experiment.responses.items()
        ]

    def _on_paths(self, system: LaneSystem) -> Iterator[tuple[Complex, Complex]]:
        source = self._diagram.inputs.index(self.experiment.source)
        for name, one in self.experiment.responses.items():
            part = connected(system.balanced(), [source], [self._diagram.outputs.index(name)])
            yield response_with_slopes(part, one.frequency)


def response_with_slopes(system: LaneSystem, frequencies: Real) -> tuple[Complex, Complex]:
    """Return G(jω) and its slopes by each lane, shapes (frequencies,) and (lanes, frequencies); NaN at a pole on the axis.

    Parameters
    ----------
    system : LaneSystem
        One input, one output.
    frequencies : ndarray, shape (frequencies,)
        rad/s.
    """
    size = system.n + system.m
    width = max(1, _AT_ONCE // max(1, size * (size + system.lanes)))
    parts = [_at(system, frequencies[k : k + width]) for k in range(0, len(frequencies), width)]
    return np.concatenate([g for g, _ in parts]), np.concatenate([dg for _, dg in parts], axis=1)


def _at(s: LaneSystem, omega: Real) -> tuple[Complex, Complex]:
    n, m, through = s.n, s.m, s.d11[:, 0, 0]
    inner = np.block([[s.a, s.b2], [s.c2, s.d22]])
    right, read = np.concatenate([s.b1, s.d21], axis=1)[..., 0], np.concatenate([s.c1, s.d12], axis=2)[:, 0]
    turns = np.exp(1j * omega[:, None] * s.delays[0].real)
    f = np.zeros((omega.size, n + m, n + m), dtype=complex)
    places = np.arange(n + m)
    f[:, places[:n], places[:n]] = 1j * omega[:, None]
    f[:, places[n:], places[n:]] = turns
    f -= inner[0].real
    rows = evened(f)
    try:
        z = np.linalg.solve(rows * f, rows * right[0].real[:, None])[..., 0]
        # scaled rows divide the solution of the transposed equations
        y = np.linalg.solve((rows * f).swapaxes(1, 2), np.broadcast_to(read[0].real[:, None], (*z.shape, 1)))[..., 0]
    except np.linalg.LinAlgError:
        nothing = np.full((1 + s.lanes, omega.size), complex(np.nan, np.nan))
        return nothing[0], nothing[1:]
    y *= rows[..., 0]
    value = z @ read[0].real + through[0].real
    moved = slopes(inner) @ z.T + slopes(right)[:, :, None]
    gradient = slopes(read) @ z.T + np.einsum("ki,lik->lk", y, moved) + slopes(through)[:, None]
    late = y[:, n:] * (1j * omega[:, None] * turns) * z[:, n:]
    return value, gradient - slopes(s.delays) @ late.T


def _judged(one: MeasuredResponse, model: Complex) -> JudgedResponse:
    """Return the fit in the complex plane, and what the errors over their deviations say."""
    error, spread = one.value - model, float(np.linalg.norm(one.value - one.value.mean()))
    size = float(np.linalg.norm(one.value))
    scaled = error / one.deviation
    scatter = limit = None
    if one.freedom > 4:
        scatter = float(np.mean(np.abs(scaled) ** 2)) / 2
        limit = _limit(one)
    apart = max(1, math.ceil(2 * one.line_width))  # lines so far apart share no window
    parts = (scaled.real[::apart], scaled.imag[::apart])
    alone = np.zeros((0, parts[0].size))
    return JudgedResponse(
        fit_percent=100 * (1 - float(np.linalg.norm(error)) / spread) if spread > 1e-14 * size else None,
        relative_error_percent=100 * float(np.linalg.norm(error)) / size if size else None,
        lines=one.lines,
        lines_left_out=one.left_out,
        band=(float(one.frequency[0]), float(one.frequency[-1])),
        scatter=scatter,
        scatter_limit=limit,
        white=all(examine_residuals(part, alone, lags=max(1, part.size // 4)).white for part in parts)
        if parts[0].size >= 8
        else None,
    )


def _limit(one: MeasuredResponse) -> float:
    """Return what the mean square of errors over their deviations seldom exceeds where the model is right: F of 2 and ν.

    Taken as normal it is exceeded by 1 in 100; of five averages, whose F is skew, by some 7 in 100.
    """
    nu = one.freedom
    mean, variance = (1.0, 1.0) if math.isinf(nu) else (nu / (nu - 2), nu**3 / ((nu - 2) ** 2 * (nu - 4)))
    return mean + _CHANCE * math.sqrt(variance * one.line_width / one.lines)
