"""Response of a linear system to a recorded input, exact for inputs that are linear between their samples.

    y(t_k) = g u_k + Σ_j (u_j - u_{j-1}) D_{k-j},    D_m = (1/h) ∫_{mh}^{(m+1)h} (s(t) - g) dt

s is the exact step response and g the static gain: between two samples the input is a ramp, and a ramp's response is the
mean of step responses. D dies out with the slowest pole, so that a long recording costs one short exact response and one
fast convolution. The input is taken to have had its first value for ever: the response starts at that equilibrium.
Where there is none (the path integrates) g is 0, D lasts as long as the recording, and the system starts at t = 0 from
its initial state. Nothing is discretised: a delay need not be a multiple of h, and no lag is faster than the samples allow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.linear.chebyshev import integration_matrix, weights
from engine.linear.path import connected, path
from engine.linear.poles import poles
from engine.linear.propagate import exponentials
from engine.linear.rest import static_gain
from engine.linear.short_delay import lifted
from engine.linear.system import LaneSystem, LinearSystem
from engine.linear.tangent import slopes
from engine.linear.trajectory import respond
from engine.signals import make
from engine.verdicts import Verdict

if TYPE_CHECKING:
    from engine.linear.curve import Curve
    from engine.linear.system import Array

Samples = npt.NDArray[np.float64]

SETTLED = 1e-11
"""What may be left of a transient, relative to its largest value, where its tail is cut off."""

_STEP = make("step", {})

GROWTH_LIMIT = 1e100
"""Responses that grow beyond this multiple are no numbers a user can read: they come out as infinity."""


def simulate_sampled(
    system: LinearSystem, inputs: Samples, sample_time: float, *, outputs: Sequence[str] | None = None
) -> Samples:
    """Return the outputs at the samples of a recorded input.

    Parameters
    ----------
    system : LinearSystem
        Real; delays of any length.
    inputs : ndarray, shape (inputs, samples)
        Values at t = 0, h, 2h, ...; linear in between; each had its first value before t = 0.
    sample_time : float
        h in s.
    outputs : sequence of str, optional
        Which outputs, in which order; all of the system's when absent.

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
    return Drive(inputs, sample_time).respond(LaneSystem.of([system]))[0]


class Drive:
    """A recorded input, ready to drive many systems of one structure (the trials of an identification).

    Parameters
    ----------
    inputs, sample_time
        As for :func:`simulate_sampled`.
    growth_limit : float
        An output that an unstable pole could make grow by more than this is infinite, and not computed.
    """

    def __init__(self, inputs: Samples, sample_time: float, *, growth_limit: float = GROWTH_LIMIT) -> None:
        if inputs.ndim != 2 or inputs.shape[1] == 0:
            raise ValueError(f"inputs must be rows of samples, got an array of shape {inputs.shape}")
        if not np.isfinite(inputs).all():
            raise ValueError("inputs must be finite numbers, got NaN or infinity")
        if not sample_time > 0:
            raise ValueError(f"sample_time must be > 0 s, got {sample_time}")
        self._inputs = inputs
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
        values, tangents = self._respond(system)
        for move, tangent in zip(moves, tangents[lanes:], strict=True):
            values = values + move * tangent
        return values, tangents[:lanes]

    def _respond(self, system: LaneSystem) -> tuple[Samples, Samples]:
        samples = self._inputs.shape[1]
        rest = replace(system, x0=np.zeros_like(system.x0))
        values = np.zeros((system.n_out, samples))
        tangents = np.zeros((system.lanes, system.n_out, samples))
        for output in range(system.n_out):
            settles = True
            for source in range(system.n_in):
                if not (self._inputs[source].any() or system.x0.any()):
                    continue  # silent inputs drive nothing
                kernel = self._kernel(rest, source, output)
                if kernel is None:
                    values[output] = np.inf
                    continue
                value, tangent = kernel.drive(self._inputs[source])
                values[output] += value
                tangents[:, output] += tangent
                settles &= kernel.step is None
            if not settles and system.x0.any():
                free = _values(respond(path(system, [], [output]), [], self._h * samples).output(0), self._instants)
                values[output] += free[0].real
                tangents[:, output] += slopes(free)
        return values, tangents

    def _kernel(self, system: LaneSystem, source: int, output: int) -> _Kernel | None:
        """Return the kernel from one input to one output, None when it grows beyond the limit."""
        h, samples = self._h, self._inputs.shape[1]
        connection = connected(system, [source], [output])
        part = _balanced(connection)
        if guess := self._settled.get((source, output)):
            kernel = _settled(part, h, guess)
            if kernel is not None:
                return kernel
        part = _balanced(path(connection, [0], [0]))
        found = poles(part.value)
        if found.verdict is Verdict.UNSTABLE:
            growth = np.inf if found.neutral else float(found.values.real.max()) * h * samples
            if growth > np.log(self._growth_limit):
                return None
        if found.verdict is not Verdict.OK:
            step, transient = _step(part, h, samples)
            return _Kernel(gain=np.zeros(part.lanes), transient=transient, step=step)
        duration = -np.log(SETTLED) / found.slowest + float(part.delays[0].real.sum())
        count = int(np.ceil(1.2 * duration / h)) + 4
        while count < samples:
            kernel = _settled(part, h, count)
            if kernel is not None:
                self._settled[source, output] = count
                return kernel
            count *= 2
        gain = static_gain(part)[:, 0, 0]
        return _Kernel(gain=gain, transient=_step(part, h, samples)[1] - gain[:, None], step=None)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Kernel:
    """From one input to one output: static gain, transient means D (lanes, m), step response where nothing settles."""

    gain: Array
    transient: Array
    step: Array | None

    def drive(self, u: Samples) -> tuple[Samples, Samples]:
        """Return the response to the samples ``u`` and its tangents, shapes (samples,) and (lanes, samples)."""
        import scipy.fft  # noqa: PLC0415 - a twentieth of a second

        n = u.size
        size = scipy.fft.next_fast_len(n + self.transient.shape[1] - 1, real=True)
        spectrum = scipy.fft.rfft(np.diff(u, prepend=u[0]), size)

        def convolved(means: Samples) -> Samples:
            return np.asarray(scipy.fft.irfft(spectrum * scipy.fft.rfft(means, size), size)[..., :n])

        # real and infinitesimal parts are convolved apart: a complex transform would round one into the other
        value = self.gain[0].real * u + convolved(self.transient[0].real)
        tangent = slopes(self.gain)[:, None] * u + convolved(slopes(self.transient))
        if self.step is not None:
            value = value + u[0] * self.step[0].real
            tangent = tangent + u[0] * slopes(self.step)
        return value, tangent


def _balanced(part: LaneSystem) -> LaneSystem:
    return part.balanced() if part.n else part


def _settled(part: LaneSystem, h: float, count: int) -> _Kernel | None:
    """Return the kernel of a path that stands still within ``count`` intervals, None when it does not."""
    try:
        gain = static_gain(part)[:, 0, 0]
    except np.linalg.LinAlgError:
        return None
    transient = _step(part, h, count)[1] - gain[:, None]
    size = np.abs(transient[0].real)
    tail = float(size[-max(4, count // 20) :].max())
    still = tail <= SETTLED * max(float(size.max()), abs(float(gain[0].real)))
    return _Kernel(gain=gain, transient=transient, step=None) if still else None


def _step(part: LaneSystem, h: float, count: int) -> tuple[Array, Array]:
    """Return the step response at 0, h, ... and its exact mean over each interval, both of shape (lanes, count)."""
    if not part.m:
        return _step_without_delays(part, h, count)
    horizon = h * count
    curve = respond(part, [_STEP], horizon).output(0)
    return _values(curve, h * np.arange(count, dtype=np.float64)), _means(curve, h, count)


def _step_without_delays(part: LaneSystem, h: float, count: int) -> tuple[Array, Array]:
    """Advance x and its mean from interval to interval by one matrix exponential, however fast the lags are."""
    n, lanes = part.n, part.lanes
    # x' = A x + B, q' = x / h with q = 0 at the start of each interval: q becomes the mean of x
    joint = np.zeros((lanes, 2 * n + 1, 2 * n + 1), dtype=part.dtype)
    joint[:, :n, :n] = h * part.a
    joint[:, :n, 2 * n :] = h * part.b1
    joint[:, n : 2 * n, :n] = np.eye(n)
    grown = exponentials(joint)
    advance, forced = grown[:, :n, :n], grown[:, :n, 2 * n :]
    states = np.zeros((count, lanes, n, 1), dtype=part.dtype)
    for k in range(1, count):
        states[k] = advance @ states[k - 1] + forced
    means = grown[:, n : 2 * n, :n] @ states + grown[:, n : 2 * n, 2 * n :]
    return (part.c1 @ states + part.d11)[:, :, 0, 0].T, (part.c1 @ means + part.d11)[:, :, 0, 0].T


def _located(curve: Curve, instants: Samples) -> tuple[npt.NDArray[np.intp], Array]:
    """Return the piece of each fixed instant and the interpolation weights there, shapes (k,) and (k, lanes, N + 1)."""
    edges = curve.times
    piece = np.clip(np.searchsorted(edges, instants, side="right") - 1, 0, len(edges) - 2)
    start = curve.edges[piece]
    # pieces move with the delays: a fixed instant then lies elsewhere in its piece, lane by lane
    theta = (instants[:, None] - start) / (curve.edges[piece + 1] - start)
    return piece, weights(theta)


def _values(curve: Curve, instants: Samples) -> Array:
    """Return the curve at fixed instants, shape (lanes, instants)."""
    piece, w = _located(curve, instants)
    return np.asarray(np.einsum("kpj,kjp->pk", w, curve.values[piece]))


def _means(curve: Curve, h: float, count: int) -> Array:
    """Return the exact mean of the curve over each of the first ``count`` intervals of length h, shape (lanes, count)."""
    width = np.diff(curve.edges, axis=0)
    primitive = np.einsum("jl,klp->kjp", integration_matrix(), curve.values) * width[:, None, :]
    before = np.concatenate([np.zeros((1, width.shape[1])), np.cumsum(primitive[:, -1], axis=0)])
    ends: Samples = h * np.arange(count + 1, dtype=np.float64)
    piece, w = _located(curve, ends)
    integral = before[piece] + np.einsum("kpj,kjp->kp", w, primitive[piece])
    return np.asarray(np.diff(integral, axis=0).T / h)
