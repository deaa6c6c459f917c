"""Response of a linear system to a recorded input, exact for inputs that are held, linear or splines between their samples.

    y(t_k) = g u_k + Σ_j Σ_i a_{j,i} D_{k-j,i}

    held           a_j = u_j - u_{j-1}                                D_m = s(mh) - g
    polynomials    h u' = Σ_i a_{j,i} φ^i from t_{j-1} to t_j         D_{m,i} = ∫_0^1 φ^i (s((m + 1 - φ) h) - g) dφ

s is the exact step response, right-continuous, and g the static gain: a held input is a train of steps, and between two
samples of any other the response to its rate is a mean of step responses. D dies out with the slowest pole, so that a long recording costs
one short exact response and one fast convolution. The input is taken to have had its first value for ever: the response
starts at that equilibrium. Where there is none (the path integrates) g is 0, D lasts as long as the recording, and the
system starts at t = 0 from its initial state. Nothing is discretised: a delay need not be a multiple of h, and no lag is
faster than the samples allow. Where a held input jumps at the instant of a sample, what feeds through at once shows its
new value, y_k = C x_k + D u_k.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.exact.frequency.dc_gain import static_gain
from engine.exact.frequency.path import connected, path
from engine.exact.frequency.poles import poles
from engine.exact.time.at_samples import moments, values_at
from engine.exact.time.propagate import exponentials
from engine.exact.time.short_delay import lifted
from engine.exact.time.trajectory import respond
from engine.model.between_samples import BetweenSamples, polynomials, told
from engine.model.linear_system import LaneSystem, LinearSystem
from engine.model.tangent import slopes
from engine.model.verdicts import Verdict
from engine.signals import make

if TYPE_CHECKING:
    from engine.model.linear_system import Array

Samples = npt.NDArray[np.float64]

SETTLED = 1e-11
"""What may be left of a transient, relative to its largest value, where its tail is cut off."""

_STEP = make("step", {})

AFTER, AFTER_LIFTED = 1e-9, 1.5e-4
"""Parts of a sample within which a jump behind it is one at it: rounding, or a delay of 0 that was lifted."""

GROWTH_LIMIT = 1e100
"""Responses that grow beyond this multiple are no numbers a user can read: they come out as infinity."""


def simulate_sampled(
    system: LinearSystem,
    inputs: Samples,
    sample_time: float,
    *,
    outputs: Sequence[str] | None = None,
    between: Mapping[str, BetweenSamples] | BetweenSamples = BetweenSamples.LINEAR,
) -> Samples:
    """Return the outputs at the samples of a recorded input.

    Parameters
    ----------
    system : LinearSystem
        Real; delays of any length.
    inputs : ndarray, shape (inputs, samples)
        Values at t = 0, h, 2h, ...; each had its first value before t = 0.
    sample_time : float
        h in s.
    outputs : sequence of str, optional
        Which outputs, in which order; all of the system's when absent.
    between : BetweenSamples, or mapping of input to BetweenSamples
        What the inputs do between their samples; linear where nothing is said.

    Returns
    -------
    ndarray, shape (outputs, samples)
        Infinite where an unstable path could grow beyond 1e100 times within the recording.

    Raises
    ------
    ValueError
        For inputs of the wrong shape, without a sample, or not finite; for a sample time <= 0.
    """
    if outputs is not None:
        rows = [system.outputs.index(name) for name in outputs]
        system = replace(system, c1=system.c1[rows], d11=system.d11[rows], d12=system.d12[rows], outputs=tuple(outputs))
    return Drive(inputs, sample_time, between=told(between, system.inputs)).respond(LaneSystem.of([system]))[0]


class Drive:
    """A recorded input, ready to drive many systems of one structure (the trials of an identification).

    Parameters
    ----------
    inputs, sample_time
        As for :func:`simulate_sampled`.
    between : sequence of BetweenSamples, optional
        What each input does between its samples; linear by default.
    growth_limit : float
        An output that an unstable pole could make grow by more than this is infinite, and not computed.
    """

    def __init__(
        self,
        inputs: Samples,
        sample_time: float,
        *,
        between: Sequence[BetweenSamples] | None = None,
        growth_limit: float = GROWTH_LIMIT,
    ) -> None:
        if inputs.ndim != 2 or inputs.shape[1] == 0:
            raise ValueError(f"inputs must be rows of samples, got an array of shape {inputs.shape}")
        if not np.isfinite(inputs).all():
            raise ValueError("inputs must be finite numbers, got NaN or infinity")
        if not sample_time > 0:
            raise ValueError(f"sample_time must be > 0 s, got {sample_time}")
        self._inputs = inputs
        self._between = tuple(between or (BetweenSamples.LINEAR,) * len(inputs))
        if len(self._between) != len(inputs):
            raise ValueError(
                f"inputs must be {len(self._between)} rows of samples, got an array of shape {inputs.shape}"
            )
        self._rates = [_rates(row, way) for row, way in zip(inputs, self._between, strict=True)]
        self._h = sample_time
        self._instants: Samples = sample_time * np.arange(inputs.shape[1], dtype=np.float64)
        self._growth_limit = growth_limit
        # how many intervals the last system's transient took: a neighbour's takes about as long
        self._settled: dict[tuple[int, int], int] = {}

    def respond(self, system: LaneSystem) -> tuple[Samples, Samples]:
        """Return the outputs at the samples, with their exact derivatives along every lane.

        Parameters
        ----------
        system : LaneSystem
            All lanes share the real part.

        Returns
        -------
        values : ndarray, shape (outputs, samples)
        tangents : ndarray, shape (lanes, outputs, samples)
            Zero for lanes without an imaginary part.
        """
        if system.n_in != len(self._inputs):
            raise ValueError(
                f"inputs must be {system.n_in} rows of samples, got an array of shape {self._inputs.shape}"
            )
        lanes = system.lanes
        system, moves = lifted(system, self._h)
        values, tangents = self._respond(system, AFTER_LIFTED if moves.size else AFTER)
        for move, tangent in zip(moves, tangents[lanes:], strict=True):
            values = values + move * tangent
        return values, tangents[:lanes]

    def _respond(self, system: LaneSystem, after: float) -> tuple[Samples, Samples]:
        samples = self._inputs.shape[1]
        rest = replace(system, x0=np.zeros_like(system.x0))
        values = np.zeros((system.n_out, samples))
        tangents = np.zeros((system.lanes, system.n_out, samples))
        for output in range(system.n_out):
            settles = True
            for source in range(system.n_in):
                if not (self._inputs[source].any() or system.x0.any()):
                    continue  # silent inputs drive nothing
                kernel = self._kernel(rest, source, output, after * self._h)
                if kernel is None:
                    values[output] = np.inf
                    continue
                value, tangent = kernel.drive(self._inputs[source], self._rates[source])
                values[output] += value
                tangents[:, output] += tangent
                settles &= kernel.step is None
            if not settles and system.x0.any():
                free = values_at(respond(path(system, [], [output]), [], self._h * samples).output(0), self._instants)
                values[output] += free[0].real
                tangents[:, output] += slopes(free)
        return values, tangents

    def _kernel(self, system: LaneSystem, source: int, output: int, after: float) -> _Kernel | None:
        """Return the kernel from one input to one output, None when it grows beyond the limit."""
        h, samples = self._h, self._inputs.shape[1]
        way = Way(way=self._between[source], rows=len(self._rates[source]), h=h, after=after)
        connection = connected(system, [source], [output])
        part = balanced(connection)
        if guess := self._settled.get((source, output)):
            kernel = _settled(part, way, guess)
            if kernel is not None:
                return kernel
        part = balanced(path(connection, [0], [0]))
        found = poles(part.value)
        if found.verdict is Verdict.UNSTABLE:
            growth = np.inf if found.neutral else float(found.values.real.max()) * h * samples
            if growth > np.log(self._growth_limit):
                return None
        if found.verdict is not Verdict.OK:
            step, transient = way.step(part, samples)
            return _Kernel(gain=np.zeros(part.lanes), transient=transient, step=step())
        duration = -np.log(SETTLED) / found.slowest + float(part.delays[0].real.sum())
        count = int(np.ceil(1.2 * duration / h)) + 4
        while count < samples:
            kernel = _settled(part, way, count)
            if kernel is not None:
                self._settled[source, output] = count
                return kernel
            count *= 2
        return way.kernel(part, static_gain(part)[:, 0, 0], samples)


def _rates(u: Samples, way: BetweenSamples) -> Samples:
    """Return what a kernel is convolved with, (rows, samples): steps of a held input, else h u' in powers of φ."""
    if way is BetweenSamples.HOLD:
        return np.diff(u, prepend=u[0])[None]
    powers = polynomials(u, way)[1:]
    rates = np.zeros((len(powers), u.size))
    rates[:, 1:] = powers * np.arange(1, len(powers) + 1)[:, None]
    return rates


@dataclass(frozen=True, kw_only=True, eq=False)
class _Kernel:
    """From one input to one output: static gain, transient D (lanes, rows, m), step response where nothing settles."""

    gain: Array
    transient: Array
    step: Array | None

    def drive(self, u: Samples, rates: Samples) -> tuple[Samples, Samples]:
        """Return the response to the samples ``u`` and its tangents, shapes (samples,) and (lanes, samples)."""
        import scipy.fft  # noqa: PLC0415 - a twentieth of a second

        n = u.size
        size = scipy.fft.next_fast_len(n + self.transient.shape[-1] - 1, real=True)
        spectrum = scipy.fft.rfft(rates, size)

        def convolved(means: Samples) -> Samples:
            return np.asarray(scipy.fft.irfft((spectrum * scipy.fft.rfft(means, size)).sum(axis=-2), size)[..., :n])

        # real and infinitesimal parts are convolved apart: a complex transform would round one into the other
        value = self.gain[0].real * u + convolved(self.transient[0].real)
        # lane by lane: the transforms of all of them would need many times the memory
        tangent = np.stack([
            gain * u + convolved(slopes(moves)) for gain, moves in zip(slopes(self.gain), self.transient, strict=True)
        ])  # fmt: skip
        if self.step is not None:
            value = value + u[0] * self.step[0].real
            tangent = tangent + u[0] * slopes(self.step)
        return value, tangent


def balanced(part: LaneSystem) -> LaneSystem:
    """Return a path with states of like size, where it has any."""
    return part.balanced() if part.n else part


@dataclass(frozen=True, kw_only=True)
class Way:
    """What an input does between samples h apart; its rate is given by so many ``rows``.

    What jumps within ``after`` (s) behind a sample has jumped at it.
    """

    way: BetweenSamples
    rows: int
    h: float
    after: float

    def kernel(self, part: LaneSystem, gain: Array, count: int) -> _Kernel:
        """Return the kernel of a path with a static gain (lanes,) over so many intervals."""
        return _Kernel(gain=gain, transient=self.step(part, count)[1] - self._of_a_constant(gain), step=None)

    def _of_a_constant(self, gain: Array) -> Array:
        """Return the moments of a constant, (lanes, rows, 1)."""
        return gain[:, None, None] / np.arange(1, self.rows + 1)[:, None]

    def step(self, part: LaneSystem, count: int) -> tuple[Callable[[], Array], Array]:
        """Return what gives the step response at 0, h, ..., (lanes, count), and what each interval contributes, (lanes, rows, count).

        The former takes as long as the latter, and few ask for it.
        """
        held = self.way is BetweenSamples.HOLD
        if not part.m:
            values, forced = _step_without_delays(part, self.h, count, 0 if held else self.rows)
            return lambda: values, values[:, None] if held else forced
        curve = respond(part, [_STEP], self.h * count).output(0)
        instants = self.h * np.arange(count, dtype=np.float64)
        at_samples = partial(values_at, curve, instants, after=self.after)
        return at_samples, at_samples()[:, None] if held else moments(curve, self.h, count, self.rows)


def _settled(part: LaneSystem, way: Way, count: int) -> _Kernel | None:
    """Return the kernel of a path that stands still within ``count`` intervals, None when it does not."""
    try:
        gain = static_gain(part)[:, 0, 0]
    except np.linalg.LinAlgError:
        return None
    kernel = way.kernel(part, gain, count)
    size = np.abs(kernel.transient[0].real)
    tail = float(size[:, -max(4, count // 20) :].max())
    still = tail <= SETTLED * max(float(size.max()), abs(float(gain[0].real)))
    return kernel if still else None


def interval(part: LaneSystem, h: float, rows: int) -> tuple[Array, Array]:
    """Return how the step response of a path without delays goes on: z_{k+1} = A z_k from z_0 = (0, 1), and what is read of it.

    q_1' = y, q_{i+1}' = q_i, all 0 at the start of each interval: at its end q_{i+1} = ∫_0^1 φ^i/i! y dφ.

    Returns
    -------
    advance : ndarray, shape (lanes, n + 1, n + 1)
        One matrix exponential, however fast the lags are.
    read : ndarray, shape (lanes, rows + 1, n + 1)
        Of y at the sample, and of its moments over the interval behind it.
    """
    n = part.n
    joint = np.zeros((part.lanes, n + 1 + rows, n + 1 + rows), dtype=part.dtype)
    joint[:, :n, :n] = h * part.a
    joint[:, :n, n : n + 1] = h * part.b1
    output = np.concatenate([part.c1, part.d11], axis=2)
    # the exponential is one of numbers of like size
    size = max(float(np.abs(output[0].real).max()), 1e-300)
    if rows:
        joint[:, n + 1 : n + 2, : n + 1] = output / size
        joint[:, np.arange(n + 2, n + 1 + rows), np.arange(n + 1, n + rows)] = 1.0
    grown = exponentials(joint)
    factorials = size * np.cumprod(np.maximum(np.arange(rows, dtype=np.float64), 1.0))
    return grown[:, : n + 1, : n + 1], np.concatenate(
        [output, grown[:, n + 1 :, : n + 1] * factorials[:, None]], axis=1
    )


def _step_without_delays(part: LaneSystem, h: float, count: int, rows: int) -> tuple[Array, Array]:
    """Return the step response at the samples, (lanes, count), and its moments, (lanes, rows, count)."""
    advance, read = interval(part, h, rows)
    states = np.zeros((part.lanes, part.n + 1, count), dtype=part.dtype)
    states[:, part.n, 0] = 1.0
    known = 1
    while known < count:  # twice as many each time: one product instead of a step for each sample
        more = min(known, count - known)
        states[:, :, known : known + more] = advance @ states[:, :, :more]
        advance, known = advance @ advance, known + more
    found = read @ states
    return found[:, 0], found[:, 1:]
