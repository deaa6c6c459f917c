"""What every nonlinear element is: a law between its inputs and outputs, smooth inside a mode, with guards between modes.

x' = f(t, x, z; mode),   y = g(t, x, z; mode),   mode changes where a guard h(t, x, z, z', y; mode) becomes positive

A law is analytic inside a mode, so that the complex step gives its exact slopes; what is not smooth (a limit reached, a
mass that sticks, a sample taken) is a change of the mode, located in time by the simulation. Decisions look at real
parts only.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from engine.elements._base import Array, Element, Ports, Realization, Values
from engine.elements._limiting import Limiting
from engine.model.parameters import Scalar

Mode = int
Signals = Sequence[Any]
"""One array (lanes, instants) for each state, input or output; all of them broadcast against each other."""

Pattern = npt.NDArray[np.bool_]

STEP = 1e-40
"""Imaginary step of a slope: far below rounding, so that the slope is exact."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moment:
    """What a law sees: time ``t`` (s), its states ``x``, inputs ``z``, their ``slope`` in time, its outputs ``y``.

    ``slope`` is empty where it is not known (in the instant of a jump), ``y`` where the outputs are being asked for.
    """

    t: Any
    x: Signals = ()
    z: Signals = ()
    slope: Signals = ()
    y: Signals = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Change:
    """A new mode, with new values of the states (None: as they were)."""

    mode: Mode
    x: Signals | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Slopes:
    """Partial derivatives of a law at N instants.

    Shapes: ``fx`` (N, states, states), ``fz`` (N, states, inputs), ``gx`` (N, outputs, states), ``gz`` (N, outputs, inputs).
    """

    fx: Array
    fz: Array
    gx: Array
    gz: Array


class NonlinearElement(Element):
    """A kind of block whose law is not linear.

    The mode 0 is the one in which the element works around rest, unless :meth:`start` says otherwise.
    """

    states: ClassVar[tuple[str, ...]] = ()
    """Their names, where these do not follow from the values; :meth:`initial` tells how many there are."""
    modes: ClassVar[tuple[Mode, ...]] = (0,)
    """The modes; one stands for all others where they are numbered through (intervals, levels)."""
    continuous: ClassVar[bool] = False
    """Whether the output does not jump between modes, and all guards are distances in the unit of the only input."""
    product: ClassVar[bool] = False
    """Whether what jumps does so with the sign of a product whose factors the guards are: each matters as far as the others are from 0."""
    note: ClassVar[str] = ""
    """What stands for the slope where the law has none: said wherever the element is linearised."""

    @classmethod
    def initial(cls, values: Values) -> Signals:
        """Return the states at t = 0; rest by default."""
        return [0.0] * len(cls.states)

    @classmethod
    def feed_through(cls, values: Values) -> Pattern:
        """Return which outputs (rows) follow which inputs (columns) at once, in any mode; all by default."""
        ports = cls.ports(values)
        return np.ones((len(ports.outputs), len(ports.inputs)), dtype=bool)

    @classmethod
    def start(cls, m: Moment, values: Values) -> Mode:
        """Return the mode at t = 0; the guards correct it where it does not fit."""
        return 0

    @classmethod
    def rates(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the time derivative of each state."""
        return ()

    @classmethod
    def unrest(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return what is 0 for each state when the block is at rest: the rates, unless the state only follows in jumps."""
        return cls.rates(m, mode, values)

    @classmethod
    @abstractmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the outputs; one that is held (see :meth:`held`) may be anything."""

    @classmethod
    def limits(cls, values: Values) -> Sequence[tuple[Any, Any]]:
        """Return (least, greatest) of each output, for outputs that never leave them; none by default."""
        return ()

    @classmethod
    def limiting(cls, values: Values) -> Limiting | None:
        """Return what is made of the output of its linear part, of a sampler, or of the only input of a law without memory; None: nothing such."""
        return None

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return what ends the mode as soon as it becomes positive."""
        return ()

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return what follows when guard number ``guard`` has become positive."""
        raise NotImplementedError

    @classmethod
    def release(cls, m: Moment, mode: Mode, values: Values) -> Change:
        """Return the mode and states before the inputs jump away from ``m``; the guards then choose anew."""
        return Change(mode=mode)

    @classmethod
    def held(cls, mode: Mode) -> int | None:
        """Return the output that is whatever keeps :meth:`surface` at 0, None in modes that hold nothing."""
        return None

    @classmethod
    def idle(cls, mode: Mode) -> bool:
        """Return whether the mode only stands for one that holds, where something else keeps :meth:`surface` at 0."""
        return False

    @classmethod
    def surface(cls, m: Moment, mode: Mode, values: Values) -> Any:
        """Return what a mode that holds keeps at 0: a linear function of the inputs, by default the first of them."""
        return m.z[0]

    @classmethod
    def unheld(cls, m: Moment, mode: Mode, values: Values, *, before: Mode) -> Change:
        """Return what follows where in ``mode`` the output of :meth:`held` has no influence on the rate of the surface.

        ``before`` is the mode before the law began to hold; ``mode`` itself where it has held until now.
        """
        return Change(mode=before)

    @classmethod
    def jumps(cls, values: Values) -> bool:
        """Return whether an infinitesimal would make it another law, whose response has no derivative here that could be carried along."""
        return False

    @classmethod
    def across(cls, guard: int, mode: Mode, values: Values) -> Mode | None:
        """Return the mode beyond a guard where an output or a rate may jump on the way, None where it does not."""
        return None

    @classmethod
    def stays(cls, mode: Mode) -> bool:
        """Return whether a mode is the right one where a guard that it may jump at is exactly 0 and rests there."""
        return True

    @classmethod
    def period(cls, values: Values) -> Scalar | None:
        """Return the time between samples (s) of an element that samples, else None."""
        return None

    @classmethod
    def offset(cls, values: Values) -> Scalar:
        """Return when the first sample is taken, s."""
        return 0.0

    @classmethod
    def latency(cls, values: Values) -> Scalar:
        """Return the time (s) from a sample until the output follows it."""
        return 0.0

    @classmethod
    def sample(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the states after a sample has been taken."""
        raise NotImplementedError

    @classmethod
    def update(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the states after the latency has passed since the last sample."""
        return m.x

    @classmethod
    def affine(cls, mode: Mode, values: Values) -> bool:
        """Return whether rates, outputs and surface are linear functions plus constants in this mode, whatever the time."""
        return False

    @classmethod
    def alike(cls, mode: Mode) -> Mode:
        """Return a mode that differs in its constants only, the same one for all that do; asked for where affine."""
        return mode

    @classmethod
    def describing_function(cls, amplitude: Array, values: Values) -> Array | None:
        """Return the fundamental of the output over the sine at the input, complex, for real values; None: not known.

        ``amplitude`` > 0, unit of the input. Only of laws with one input and one output that do not depend on how fast
        the input moves.
        """
        return None

    @classmethod
    def small_signal(cls, m: Moment, mode: Mode, values: Values) -> Realization | None:
        """Return the linear block that stands for the law around ``m`` where its slopes do not, else None.

        ``values`` are as in :meth:`realize`.
        """
        return None

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the linear block that stands for the law around its initial state with all inputs 0."""
        ports = cls.ports(values)
        lanes = {name: _lanes(value) for name, value in values.items()}
        start = [np.reshape(np.asarray(v), (-1, 1)) for v in cls.initial(lanes)]
        rest = Moment(t=np.zeros((1, 1)), x=start, z=[np.zeros((1, 1))] * len(ports.inputs))
        return linearized(cls, rest, cls.start(rest, lanes), lanes)


def magnitude(value: Any) -> Any:
    """Return |value| of the real part, the infinitesimal following."""
    return np.where(np.real(value) < 0, -1.0, 1.0) * value


def first(value: Any) -> float:
    """Return the real part of the first entry: what a decision looks at."""
    return float(np.ravel(value)[0].real)


def by_sign(value: Any, positive: Any, otherwise: Any) -> Any:
    """Return one of two modes by the sign of the real part of the first entry.

    Of a number that is traced the choice itself, which is taken later.
    """
    above = np.real(value) > 0
    if isinstance(above, bool | np.bool_ | np.ndarray):
        return positive if np.ravel(above)[0] else otherwise
    return np.where(above, positive, otherwise)


def stacked(signals: Signals, shape: tuple[int, ...]) -> Array:
    """Return signals as one array (*shape, number of signals)."""
    kind = complex if any(np.iscomplexobj(signal) for signal in signals) else float
    result = np.empty((*shape, len(signals)), dtype=kind)
    for k, signal in enumerate(signals):
        result[..., k] = signal
    return result


def slopes(element: type[NonlinearElement], m: Moment, mode: Mode, values: Values, *, resting: bool = False) -> Slopes:
    """Return the exact slopes of a law at real instants, by the complex step.

    Parameters
    ----------
    element : NonlinearElement
    m : Moment
        Arrays (1, N).
    mode : int
    values : mapping
        Real values.
    resting : bool
        Slopes of :meth:`NonlinearElement.unrest` in place of the rates.
    """
    n, p, q = len(m.x), len(m.z), len(element.ports(values).outputs)
    count = np.shape(m.t)[-1]
    step = 1j * STEP * np.eye(n + p)[:, :, None]
    x = [m.x[k] + step[k] for k in range(n)]
    z = [m.z[k] + step[n + k] for k in range(p)]
    moved = Moment(t=m.t, x=x, z=z)
    shape = (n + p, count)
    rates = element.unrest if resting else element.rates
    f = stacked(rates(moved, mode, values), shape).imag / STEP
    g = stacked(element.outputs(moved, mode, values), shape).imag / STEP
    f, g = f.transpose(1, 2, 0), g.transpose(1, 2, 0)
    assert f.shape[1:] == (n, n + p)
    assert g.shape[1:] == (q, n + p)
    return Slopes(fx=f[..., :n], fz=f[..., n:], gx=g[..., :n], gz=g[..., n:])


def surface_slopes(element: type[NonlinearElement], m: Moment, mode: Mode, values: Values) -> Array:
    """Return the exact slopes (N, inputs) of what a law holds, as :func:`slopes` does."""
    p = len(m.z)
    step = 1j * STEP * np.eye(p)[:, :, None]
    moved = Moment(t=m.t, x=m.x, z=[m.z[k] + step[k] for k in range(p)])
    found = np.broadcast_to(element.surface(moved, mode, values), (p, np.shape(m.t)[-1]))
    return np.asarray(found.imag.T / STEP)


def guard_slopes(element: type[NonlinearElement], m: Moment, guard: int, mode: Mode, values: Values) -> Array:
    """Return the exact slopes (states + inputs,) of one guard at a real instant, as :func:`slopes` does; 0 where there are none."""
    n, p = len(m.x), len(m.z)
    step = 1j * STEP * np.eye(n + p)[:, :, None]
    x, z = [m.x[k] + step[k] for k in range(n)], [m.z[k] + step[n + k] for k in range(p)]
    moved = Moment(t=m.t, x=x, z=z, slope=m.slope, y=m.y)
    found = np.broadcast_to(element.guards(moved, mode, values)[guard], (n + p, 1))
    return np.asarray(np.nan_to_num(found[:, 0].imag / STEP))


def linearized(element: type[NonlinearElement], m: Moment, mode: Mode, values: Values) -> Realization:
    """Return the law's slopes around ``m``, arrays (lanes, 1), as a block; lanes become the batch axis.

    A lane that carries an infinitesimal gets the derivative of the slope: slopes are then central differences of fourth
    order over complex values, exact where the law is a polynomial of degree 4 or less around ``m``.
    """
    own = element.small_signal(m, mode, {name: _flat(value) for name, value in values.items()})
    if own is not None:
        return own
    with np.errstate(all="ignore"):  # a slope that does not exist, as that of 0/0, counts as 0
        found = _by_slopes(element, m, mode, values)
    return Realization(**{name: np.nan_to_num(getattr(found, name), posinf=0.0, neginf=0.0) for name in "abcd"})


def _by_slopes(element: type[NonlinearElement], m: Moment, mode: Mode, values: Values) -> Realization:
    n, p = len(m.x), len(m.z)
    lanes = max(np.shape(entry)[0] for entry in (*m.x, *m.z, *entries(values)) if np.ndim(entry))
    if lanes == 1 and not any(np.iscomplexobj(v) for v in (*m.x, *m.z, *entries(values))):
        single = slopes(element, m, mode, values)
        d = Realization(a=single.fx[0], b=single.fz[0], c=single.gx[0], d=single.gz[0])
        return d if n else Realization.static(single.gz[0])
    f = np.zeros((lanes, n, n + p), dtype=complex)
    g = np.zeros((lanes, len(element.ports(values).outputs), n + p), dtype=complex)
    for k in range(n + p):
        given = [*m.x, *m.z]
        width = 1e-3 * max(1e-3, abs(first(given[k])))
        for factor, weight in ((2, -1 / 12), (1, 8 / 12), (-1, -8 / 12), (-2, 1 / 12)):
            moved = [entry + factor * width * (j == k) for j, entry in enumerate(given)]
            at = Moment(t=m.t, x=moved[:n], z=moved[n:])
            f[:, :, k] += weight / width * stacked(element.rates(at, mode, values), (lanes, 1))[:, 0]
            g[:, :, k] += weight / width * stacked(element.outputs(at, mode, values), (lanes, 1))[:, 0]
    if not n:
        return Realization.static(g)
    return Realization(a=f[..., :n], b=f[..., n:], c=g[..., :n], d=g[..., n:])


def _lanes(value: Any) -> Any:
    """Return a block's values with an axis for the instants behind that of the lanes."""
    if isinstance(value, list):
        return [_lanes(entry) for entry in value]
    return value[:, None] if isinstance(value, np.ndarray) else value


def _flat(value: Any) -> Any:
    """Return lanes (lanes, 1) as a block's values have them, (lanes,)."""
    if isinstance(value, list):
        return [_flat(entry) for entry in value]
    return np.ravel(value) if isinstance(value, np.ndarray) else value


def entries(value: Any) -> list[Any]:
    """Return the numbers and texts of a block's values, lists of whatever depth opened."""
    if isinstance(value, Mapping):
        return entries(list(value.values()))
    return [entry for one in value for entry in entries(one)] if isinstance(value, list) else [value]


def next_instant(t: float, period: float, latency: float) -> float:
    """Return the first instant after ``t`` of k·period + latency, k = 0, 1, ..."""
    k = max(0, math.floor((t - latency) / period * (1 + 1e-12)) + 1)
    return k * period + latency


__all__ = [
    "Change",
    "Mode",
    "Moment",
    "NonlinearElement",
    "Ports",
    "Signals",
    "Slopes",
    "by_sign",
    "entries",
    "first",
    "guard_slopes",
    "linearized",
    "magnitude",
    "slopes",
    "stacked",
    "surface_slopes",
]
