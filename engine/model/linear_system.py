"""A linear system with internal delays, in the form that every exact response starts from.

x' = A x + B1 u + B2 w,   y = C1 x + D11 u + D12 w,   z = C2 x + D21 u + D22 w,   w_i(t) = z_i(t - delay_i)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack

Array = npt.NDArray[Any]
"""float64, or complex128 where a parameter carries an infinitesimal in its imaginary part."""


def balancing(matrix: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the powers of two t that balance diag(1/t) M diag(t)."""
    if not len(matrix):
        return np.ones(0)
    return np.asarray(lapack.dgebal(matrix, scale=1, permute=0)[3])


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearSystem:
    """State space with delay channels (n states, m delays, named inputs and outputs).

    Shapes: ``a`` (n, n), ``b1`` (n, inputs), ``b2`` (n, m), ``c1`` (outputs, n), ``c2`` (m, n), ``d11``
    (outputs, inputs), ``d12`` (outputs, m), ``d21`` (m, inputs), ``d22`` (m, m), ``delays`` (m,) in s, all > 0, ``x0`` (n,).

    References
    ----------
    The linear fractional form of delay systems: P. Gahinet and L. Shampine, "Software for modeling and
    analysis of linear systems with delays", American Control Conference 2004.
    """

    a: Array
    b1: Array
    b2: Array
    c1: Array
    c2: Array
    d11: Array
    d12: Array
    d21: Array
    d22: Array
    delays: Array
    x0: Array
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @property
    def states(self) -> int:
        """Number of states."""
        return int(self.a.shape[0])

    @classmethod
    def delay_free(
        cls,
        a: Array,
        b: Array,
        c: Array,
        d: Array,
        *,
        inputs: tuple[str, ...] = ("u",),
        outputs: tuple[str, ...] = ("y",),
    ) -> LinearSystem:
        """Return x' = A x + B u, y = C x + D u as a system without delay channels, from rest."""
        n, n_in, n_out = a.shape[0], d.shape[1], d.shape[0]
        return cls(
            a=a, b1=b, c1=c, d11=d,
            b2=np.zeros((n, 0)), c2=np.zeros((0, n)), d12=np.zeros((n_out, 0)), d21=np.zeros((0, n_in)),
            d22=np.zeros((0, 0)), delays=np.zeros(0), x0=np.zeros(n), inputs=inputs, outputs=outputs,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneSystem:
    """One system with its infinitesimal neighbours: the arrays of :class:`LinearSystem` with a lane axis in front.

    All lanes share the real part; lane k carries the derivative with respect to parameter k in its imaginary part.
    """

    a: Array
    b1: Array
    b2: Array
    c1: Array
    c2: Array
    d11: Array
    d12: Array
    d21: Array
    d22: Array
    delays: Array
    x0: Array
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @classmethod
    def of(cls, systems: Sequence[LinearSystem]) -> LaneSystem:
        """Stack systems that share their real part."""
        first = systems[0]
        stacked = {name: np.stack([getattr(s, name) for s in systems]) for name in ARRAYS}
        return cls(**stacked, inputs=first.inputs, outputs=first.outputs)

    @property
    def lanes(self) -> int:
        """Number of lanes."""
        return int(self.a.shape[0])

    @property
    def n(self) -> int:
        """Number of states."""
        return int(self.a.shape[1])

    @property
    def m(self) -> int:
        """Number of delay channels."""
        return int(self.delays.shape[1])

    @property
    def n_in(self) -> int:
        """Number of inputs."""
        return int(self.d11.shape[2])

    @property
    def n_out(self) -> int:
        """Number of outputs."""
        return int(self.d11.shape[1])

    @property
    def dtype(self) -> type[np.float64 | np.complex128]:
        """float64, or complex128 when a lane carries infinitesimals."""
        return np.complex128 if any(np.iscomplexobj(getattr(self, name)) for name in ARRAYS) else np.float64

    def balanced(self, like: LaneSystem | None = None) -> LaneSystem:
        """Return the system with states scaled by powers of two, so that rounding does not depend on the units.

        In SI a pressure is 1e5 where a position is 1e-3; unscaled, exponentials would lose those eight digits. Where how
        the states act on each other is spread over channels, ``like`` is the system that has it in one matrix.
        """
        return self.scaled(balancing((self if like is None else like).a[0].real))

    def scaled(self, scale: Array) -> LaneSystem:
        """Return the system in the states x/scale, ``scale`` of shape (n,)."""
        return replace(
            self,
            a=self.a * (scale[None, :] / scale[:, None]), b1=self.b1 / scale[:, None], b2=self.b2 / scale[:, None],
            c1=self.c1 * scale, c2=self.c2 * scale, x0=self.x0 / scale,
        )  # fmt: skip

    def part(self, states: npt.NDArray[Any], channels: npt.NDArray[Any]) -> LaneSystem:
        """Return the system of these states and delay channels alone; indices, or what is True for each that is kept."""
        x, w = states, channels
        return replace(
            self,
            a=self.a[:, x][:, :, x], b1=self.b1[:, x], b2=self.b2[:, x][:, :, w], c1=self.c1[:, :, x],
            c2=self.c2[:, w][:, :, x], d12=self.d12[:, :, w], d21=self.d21[:, w], d22=self.d22[:, w][:, :, w],
            delays=self.delays[:, w], x0=self.x0[:, x],
        )  # fmt: skip

    @property
    def value(self) -> LaneSystem:
        """The common real part alone, as one lane."""
        if self.lanes == 1 and self.dtype is np.float64:
            return self
        real = {name: getattr(self, name)[:1].real for name in ARRAYS}
        return replace(self, **real)


ARRAYS = ("a", "b1", "b2", "c1", "c2", "d11", "d12", "d21", "d22", "delays", "x0")


@dataclass(frozen=True, kw_only=True, eq=False)
class StackedSystem:
    """Many systems of one structure: every array of `LinearSystem` with a leading batch axis (B, ...).

    ``valid`` (B,) is False for members that do not exist (ill-posed loop, value out of bounds): their matrices are 0. ``zeros``
    (B, numbers) is True where a number of the batch is exactly 0, so that a state may stand for none: unseen, it has a pole of its own.
    """

    a: Array
    b1: Array
    b2: Array
    c1: Array
    c2: Array
    d11: Array
    d12: Array
    d21: Array
    d22: Array
    delays: Array
    x0: Array
    valid: npt.NDArray[np.bool_]
    zeros: npt.NDArray[np.bool_]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def member(self, index: int) -> LinearSystem:
        """Return one of the systems."""
        arrays = {name: getattr(self, name)[index] for name in ARRAYS}
        return LinearSystem(**arrays, inputs=self.inputs, outputs=self.outputs)
