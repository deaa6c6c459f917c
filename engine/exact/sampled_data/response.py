"""Frequency responses of sampled systems: what comes back at the frequency that goes in, of all that the samplers make of it.

In the frame that turns with the input, ξ = e^{jωt} x, the response is periodic: x(P) = x(0), and its mean is the fundamental.

A place that samplers read, or that holds write, carries a sequence: its response is that of the sequence, at one rate the
usual L(e^{jωT}). Any other signal is followed between the samples, and its fundamental is the mean over the period.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
import numpy.typing as npt

from engine.exact.frequency.poles import Poles
from engine.exact.frequency.response import FrequencyResponse
from engine.exact.sampled_data.poles import autonomous
from engine.exact.sampled_data.system import Event
from engine.exact.time.propagate import exponentials
from engine.model.errors import UnresolvedError
from engine.model.tangent import INFINITESIMAL

if TYPE_CHECKING:
    from engine.exact.frequency.response import Shape
    from engine.exact.sampled_data.loop import Margin, SampledLoop
    from engine.exact.sampled_data.system import SampledSystem
    from engine.model.linear_system import Array

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

_CHUNK: Final = 200_000
"""Numbers in one block of matrices of an evaluation."""
_FAINT: Final = 1e-9
"""A response below this part of 1, and of its largest value, is not followed any closer."""
_NODES: Final = 24
_REACH: Final = 12.0
"""Nodes of a quadrature, and how far an exponent may reach within them: 6^48/48! is below rounding."""
_MOST_PANELS: Final = 1024


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cut:
    """A system with one input and one output and the events of its period; ``read_at`` are those at which the sequence is read.

    Empty where the signals are followed between the samples.
    """

    system: SampledSystem
    events: tuple[Event, ...]
    read_at: tuple[int, ...]
    length: Array
    memory: dict[Any, Any] = field(default_factory=dict)

    @cached_property
    def value(self) -> _Cut:
        """The common real part alone, as one lane."""
        events = [Event(time=e.time[:1].real, jump=e.jump[:1].real, entering=e.entering[:1].real) for e in self.events]
        return replace(self, system=self.system.value, events=tuple(events), length=self.length[:1].real, memory={})


class SampledResponse(FrequencyResponse):
    """The response of a sampled system with one input and one output, below the Nyquist frequency.

    Parameters
    ----------
    system : SampledSystem
        One input, one output, at least one sampler.
    found : Poles
        Where the scan looks closely.
    sign : float
        -1 for an open loop, so that 1 + L = 0 is the characteristic equation.
    loop : SampledLoop, optional
        What knows the margins of an open loop.
    sequence : bool
        Whether the input may be taken as a sequence: at the two ends of a cut it is the same signal.
    """

    def __init__(
        self,
        system: SampledSystem,
        found: Poles,
        *,
        sign: float = 1.0,
        loop: SampledLoop | None = None,
        sequence: bool = False,
    ) -> None:
        corners = found.values[~found.at_zero]
        super().__init__(autonomous(np.zeros((system.lanes, 0, 0))), corners=corners)
        self._sign = sign
        self.loop = loop
        self._cut = _cut(system, sequence=sequence)

    @property
    def nyquist(self) -> float:
        """The Nyquist frequency of the place, rad/s: of a path that of the fastest sampler."""
        cut = self._cut
        if cut.read_at:
            return float(np.pi * len(cut.read_at) / cut.length[0].real)
        return float(np.pi / min(float(s.period[0].real) for s in cut.system.samplings))

    def __call__(self, frequencies: Real) -> Complex:
        """Return the response at ``frequencies``, rad/s, shape (k,); of a sequence NaN beyond the Nyquist frequency."""
        step = max(1, _CHUNK // (2 * self._cut.system.n + 3) ** 2)
        parts = [self._at(frequencies[k : k + step]) for k in range(0, len(frequencies), step)]
        found = np.concatenate([re + 1j * im for re, im in parts]) if parts else np.zeros(0, complex)
        beyond = bool(self._cut.read_at) & (frequencies > self.nyquist * (1 + 1e-9))
        return np.where(beyond, complex(np.nan, np.nan), found)

    def _at(self, frequencies: Array) -> tuple[Array, Array]:
        return _fundamental(self._cut.value, np.asarray(frequencies), self._sign)

    def pair(self, frequency: Array) -> tuple[Array, Array]:
        """Return (Re G, Im G) at one frequency, each of shape (lanes,) with its infinitesimals."""
        lanes = self._cut.system.lanes
        return _fundamental(self._cut, np.broadcast_to(np.asarray(frequency), (lanes,)), self._sign)

    def slope(self, shape: Shape, frequencies: Real) -> Real:
        """Return the derivative of ``shape`` of the real response with respect to ω, shape (k,)."""
        re, im = self._at(frequencies + 1j * INFINITESIMAL)
        return np.asarray(np.imag(shape(re, im)) / INFINITESIMAL)

    @cached_property
    def direct(self) -> Array:
        """The response at the Nyquist frequency, where the axis ends, shape (lanes,)."""
        return self.pair(np.asarray(self.nyquist))[0]

    @property
    def corner_frequencies(self) -> Complex:
        """The poles below the Nyquist frequency."""
        return self._corners[np.abs(self._corners.imag) < self.nyquist]

    @cached_property
    def _scan(self) -> tuple[Real, Complex, float]:
        corners, top = self.corner_frequencies, self.nyquist
        low = 1e-3 * min([*np.abs(corners), top])
        for _ in range(6):
            ends = np.abs(self(np.array([low, 10 * low])))
            if ends[0] > 10 or not ends[0] > 3 * ends[1]:
                break
            low /= 10
        omega = np.geomspace(low, top, int(np.clip(30 * np.log10(top / low), 60, 600)))
        for corner in corners:
            width = max(abs(corner.real), 1e-9 * abs(corner))
            around = abs(corner.imag) + width * np.array([-8, -4, -2, -1, -0.5, 0, 0.5, 1, 2, 4, 8])
            omega = np.concatenate([omega, around[(around > low) & (around < top)]])
        omega = np.append(np.unique(omega[omega < top * (1 - 1e-9)]), top)
        omega = omega[np.diff(omega, prepend=0.0) > 1e-12 * omega]
        values = self(omega)
        # where holds let nothing through, between multiples of the rate, only rounding is left
        self._silent = _FAINT * min(1.0, float(np.abs(values[np.isfinite(values)]).max(initial=0.0)))
        return *self._refined(omega, values), np.inf

    @property
    def gain_margins(self) -> tuple[list[Margin], float]:
        """Every gain margin; see :class:`SampledLoop`."""
        assert self.loop is not None
        return self.loop.gain_margins if self.loop.closes else ([], 1e-9)

    @property
    def phase_margins(self) -> list[Margin]:
        """Every phase margin."""
        assert self.loop is not None
        return self.loop.phase_margins if self.loop.closes else []

    @property
    def delay_margins(self) -> list[Margin]:
        """Every delay margin; :func:`engine.exact.sampled_data.delayed.delay_margins` tells what is raised."""
        assert self.loop is not None
        return self.loop.delay_margins if self.loop.closes else []

    @classmethod
    def of_loop(cls, loop: SampledLoop, found: Poles) -> Self:
        """Return L of a loop that has been cut."""
        ends = [len(loop.whole.inputs) - 1], [len(loop.whole.outputs) - 1]
        return cls(loop.whole.between(*ends), found, sign=-1.0, loop=loop, sequence=True)


def _cut(system: SampledSystem, *, sequence: bool) -> _Cut:
    """Return a system with its events; where the cut carries a sequence, with the events at which it is read.

    Where samplers read what a hold has written, the slower of both makes the sequence.
    """
    events, length = system.events(), system.period
    followed = _Cut(system=system, events=tuple(events), read_at=(), length=length)
    if not sequence or np.any(system.direct):
        return followed
    sampled = [] if np.any(system.driven) else [k for k, event in enumerate(events) if np.any(event.entering)]
    flows = np.any(system.read @ system.flow) or np.any(system.read @ system.driven)
    changed = [k for k, event in enumerate(events) if np.any(system.read @ (event.jump - np.eye(system.n)))]
    written = [] if flows else changed
    if written and (not sampled or len(written) < len(sampled)):
        return _holding(system, events, written, length)
    return replace(followed, read_at=tuple(sampled))


def _holding(system: SampledSystem, events: list[Event], written: list[int], length: Array) -> _Cut:
    """Return the system with a hold in front of its input, which takes the sequence whenever the output has changed."""
    lanes, n = system.lanes, system.n

    def grown(matrix: Array, column: Array) -> Array:
        found = np.zeros((lanes, n + 1, n + 1), dtype=np.result_type(matrix, column))
        found[:, :n, :n], found[:, :n, n:] = matrix, column
        return found

    nothing, taking = np.zeros((lanes, n + 1, 1)), np.zeros((lanes, n + 1, 1))
    taking[:, n] = 1.0
    held = np.diag([*np.zeros(n), 1.0])
    listed: list[Event] = []
    read_at = []
    for k, event in enumerate(events):
        listed.append(Event(time=event.time, jump=grown(event.jump, event.entering) + held, entering=nothing))
        if k in written:
            read_at.append(len(listed))
            listed.append(
                Event(time=event.time, jump=np.zeros((lanes, n + 1, n + 1)) + np.eye(n + 1) - held, entering=taking)
            )
    read = np.concatenate([system.read, np.zeros((lanes, 1, 1))], axis=2)
    whole = replace(system, flow=grown(system.flow, system.driven), driven=nothing, read=read)
    return _Cut(system=whole, events=tuple(listed), read_at=tuple(read_at), length=length)


def _fundamental(cut: _Cut, omega: Array, sign: float) -> tuple[Array, Array]:
    """Return real and imaginary part of the fundamental at each ω of shape (k,) or (lanes,), infinitesimals following.

    The turning frame is carried as real and imaginary part one after the other, so that both keep their infinitesimals;
    behind them come the input, 1, and of signals that are followed between samples the two parts of their integral.
    """
    s, n = cut.system, cut.system.n
    count = max(len(omega), s.lanes)
    kind = np.result_type(s.flow, omega, cut.length, *(e.time for e in cut.events), *(e.jump for e in cut.events),
                          *(e.entering for e in cut.events), s.read)  # fmt: skip
    size = 2 * n + 3
    before: Array = np.zeros(s.lanes)
    whole = np.broadcast_to(np.eye(size), (count, size, size)).astype(kind)
    flows: dict[bytes, Array] = {}
    total = np.zeros((count, 2, size), dtype=kind)
    for number, event in enumerate([*cut.events, None]):
        time = cut.length if event is None else event.time
        width = time - before
        before = time
        key = np.ascontiguousarray(width).tobytes()
        if key not in flows:
            flows[key] = _flow(cut, omega, width, kind)
        whole = flows[key] @ whole
        if event is None:
            break
        if number in cut.read_at:
            for part in range(2):
                total[:, part] += (s.read @ whole[:, part * n : (part + 1) * n])[:, 0] / len(cut.read_at)
        jump = np.zeros((s.lanes, size, size), dtype=kind) + np.eye(size)
        jump[:, :n, :n] = jump[:, n : 2 * n, n : 2 * n] = event.jump
        jump[:, :n, 2 * n] = event.entering[:, :, 0]
        whole = jump @ whole
    # x(P) = x(0), the input being 1 and the integrals beginning at 0
    start = _solved(np.eye(2 * n) - whole[:, : 2 * n, : 2 * n], whole[:, : 2 * n, 2 * n])
    begun = np.concatenate([start, np.ones((count, 1)), np.zeros((count, 2))], axis=1)
    if cut.read_at:
        found = (total @ begun[:, :, None])[:, :, 0]
    else:
        found = (whole[:, 2 * n + 1 :] @ begun[:, :, None])[:, :, 0] / cut.length[:, None]
    return np.asarray(sign * found[:, 0]), np.asarray(sign * found[:, 1])


def _flow(cut: _Cut, omega: Array, width: Array, kind: np.dtype[Any]) -> Array:
    """Return what happens over ``width`` (lanes,) in the turning frame, shape (k, 2 N + 3, 2 N + 3)."""
    s, n = cut.system, cut.system.n
    count = max(len(omega), s.lanes)
    found = np.zeros((count, 2 * n + 3, 2 * n + 3), dtype=kind)
    found[:, 2 * n :, 2 * n :] = np.eye(3)
    key = np.ascontiguousarray(width).tobytes()
    if key not in cut.memory:
        cut.memory[key] = exponentials(width[:, None, None] * s.flow)
    own = cut.memory[key]
    cos, sin = (np.asarray(f(omega * width))[:, None, None] for f in (np.cos, np.sin))
    found[:, :n, :n] = found[:, n : 2 * n, n : 2 * n] = cos * own
    found[:, :n, n : 2 * n], found[:, n : 2 * n, :n] = sin * own, -sin * own
    if cut.read_at:  # between events the input does not act
        return found
    within = _within(cut, float(np.abs(omega).max(initial=0.0)), width)
    cos, sin = (within.weights[:, :, None] * f(omega * within.instants)[:, :, None] for f in (np.cos, np.sin))
    found[:, :n, 2 * n] = (cos * within.driven).sum(axis=0)
    found[:, n : 2 * n, 2 * n] = -(sin * within.driven).sum(axis=0)
    re, im = (cos * within.read).sum(axis=0), -(sin * within.read).sum(axis=0)
    found[:, 2 * n + 1, :n], found[:, 2 * n + 1, n : 2 * n] = re, -im
    found[:, 2 * n + 2, :n], found[:, 2 * n + 2, n : 2 * n] = im, re
    left = (width - within.instants)[:, :, None] * within.through[:, :, None]
    found[:, 2 * n + 1, 2 * n] = (cos * left).sum(axis=0)[:, 0] + s.direct[:, 0, 0] * width
    found[:, 2 * n + 2, 2 * n] = -(sin * left).sum(axis=0)[:, 0]
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class _Within:
    """Nodes of a quadrature over a stretch, all (nodes, lanes, ...): e^{Mσ} B, C e^{Mσ} and C e^{Mσ} B at each instant σ."""

    instants: Array
    weights: Array
    driven: Array
    read: Array
    through: Array


def _within(cut: _Cut, fastest: float, width: Array) -> _Within:
    """Return nodes so dense that integrals of e^{(M - jω)σ} are exact to rounding for ω up to ``fastest``, rad/s."""
    s = cut.system
    reach = (float(np.abs(s.flow[0].real).sum(axis=1).max(initial=0.0)) + fastest) * abs(float(width[0].real))
    panels = 1 << max(0, int(np.ceil(np.log2(max(reach / _REACH, 1e-300)))))
    if panels > _MOST_PANELS:
        raise UnresolvedError(
            f"the response between two samples must be followed in at most {_MOST_PANELS} steps, got {panels}: the fastest "
            "state is much faster than the samples"
        )
    key = (panels, np.ascontiguousarray(width).tobytes())
    if key not in cut.memory:
        x, w = np.polynomial.legendre.leggauss(_NODES)
        parts = ((np.arange(panels)[:, None] + 0.5 * (x + 1)) / panels).ravel()
        instants = parts[:, None] * width
        grown = exponentials(instants[:, :, None, None] * s.flow)
        driven = (grown @ s.driven)[..., 0]
        cut.memory[key] = _Within(
            instants=instants, weights=np.tile(0.5 * w / panels, panels)[:, None] * width, driven=driven,
            read=(s.read @ grown)[:, :, 0], through=(s.read @ driven[..., None])[:, :, 0, 0],
        )  # fmt: skip
    found: _Within = cut.memory[key]
    return found


def _solved(matrix: Array, right: Array) -> Array:
    """Solve for a stack, (k, n, n) and (k, n), exact to first order in the infinitesimals; NaN where it is singular."""
    try:
        if not np.iscomplexobj(matrix):
            return np.asarray(np.linalg.solve(matrix, right[:, :, None])[:, :, 0])
        value = np.linalg.solve(matrix.real, right.real[:, :, None])
        moved = np.linalg.solve(matrix.real, right.imag[:, :, None] - matrix.imag @ value)
        return np.asarray((value + 1j * moved)[:, :, 0])
    except np.linalg.LinAlgError:
        if len(matrix) == 1:
            return np.full_like(right, np.nan)
        return np.concatenate([_solved(m[None], r[None]) for m, r in zip(matrix, right, strict=True)])
