"""One common period of a sampled system: the map from its start to its end, with a loop closed by any gain.

Φ(κ) = Π (J + κ K C) e^{(M + κ B C) h},   u = κ y at the place where the loop is cut
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.exact.time.propagate import exponentials
from engine.model.tangent import slopes

if TYPE_CHECKING:
    from engine.exact.sampled_data.system import Event, SampledSystem
    from engine.model.linear_system import Array

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]


class Period:
    """One common period of a system.

    Parameters
    ----------
    system : SampledSystem
        With at least one sampler; of its inputs and outputs the last are the two ends of the cut.
    marks : iterable of float
        Further instants, s, in [0, period), at which :meth:`passage` looks at the state.
    events : sequence of Event, optional
        In place of those of the system's samplers.
    """

    def __init__(
        self, system: SampledSystem, marks: Iterable[float] = (), events: Sequence[Event] | None = None
    ) -> None:
        self.system = system
        self.length: Array = system.period
        self.events = system.events() if events is None else list(events)
        lanes = system.lanes
        stops: list[tuple[Array, int | None]] = [(event.time, k) for k, event in enumerate(self.events)]
        stops += [(np.full(lanes, mark), None) for mark in marks]
        stops.sort(key=lambda stop: float(stop[0][0].real))
        self._stops = [number for _, number in stops]
        times = [np.zeros(lanes), *(time for time, _ in stops), self.length]
        self._widths = [after - before for before, after in pairwise(times)]
        same: dict[bytes, int] = {}
        self._kinds = [same.setdefault(np.ascontiguousarray(w).tobytes(), len(same)) for w in self._widths]
        self._distinct = [self._widths[self._kinds.index(k)] for k in range(len(same))]

    @cached_property
    def _ends(self) -> tuple[Array, Array, Array]:
        """What the cut drives of the states (lanes, N, 1), what is read there (lanes, 1, N), and its direct gain (lanes,)."""
        s = self.system
        return s.driven[:, :, -1:], s.read[:, -1:], s.direct[:, -1, -1]

    @cached_property
    def _fixed(self) -> list[Array] | None:
        """The flows of the common real part, None where the gain at the cut changes them."""
        b, c, _ = self._ends
        if np.any(b) and np.any(c):
            return None
        return [exponentials(width[0].real * self.system.flow[:1].real) for width in self._distinct]

    def maps(self, gains: Complex | Real | None = None) -> Complex | Real:
        """Return Φ(κ) of the common real part for gains of shape (k,), shape (k, N, N); the cut open where there are none."""
        closed = np.zeros(1) if gains is None else self._factors(np.asarray(gains), self._through[0])
        flow, b, c = self.system.flow[0].real, *(end[0].real for end in self._matrices)
        with np.errstate(all="ignore"):
            flows = self._fixed or [
                exponentials(width[0].real * (flow + closed[:, None, None] * (b @ c))) for width in self._distinct
            ]
            found = np.broadcast_to(np.eye(self.system.n), (len(closed), *flow.shape))
            for kind, number in zip(self._kinds, [*self._stops, None], strict=True):
                found = flows[kind] @ found
                if number is not None:
                    event = self.events[number]
                    back = event.entering[0, :, -1:].real @ c
                    found = (event.jump[0].real + closed[:, None, None] * back) @ found
        return np.asarray(found)

    @property
    def _matrices(self) -> tuple[Array, Array]:
        return self._ends[0], self._ends[1]

    @property
    def _through(self) -> Real:
        return np.asarray(self._ends[2].real)

    @staticmethod
    def _factors(gains: Array, through: Array | float) -> Array:
        """Return κ / (1 - κ d): a direct gain at the cut closes a loop of its own."""
        return np.asarray(gains / (1 - gains * through))

    def passage(self, start: Complex, gain: complex) -> tuple[Real, Complex]:
        """Return the instants (k,) and the states (k, N) behind each stop of one that begins the period at ``start``."""
        s, (b, c) = self.system, (end[0].real for end in self._matrices)
        factor = complex(self._factors(np.asarray(gain), float(self._through[0])))
        widths = np.array([float(width[0].real) for width in self._distinct])
        flows = exponentials(widths[:, None, None] * (s.flow[0].real + factor * (b @ c)))
        time, state = 0.0, start.astype(complex)
        times, states = [], []
        for kind, width, number in zip(self._kinds, self._widths, self._stops, strict=False):
            time, state = time + float(width[0].real), flows[kind] @ state
            if number is not None:
                event = self.events[number]
                state = (event.jump[0].real + factor * (event.entering[0, :, -1:].real @ c)) @ state
            times.append(time)
            states.append(state)
        return np.array(times), np.array(states)

    def whole(self) -> Array:
        """Return Φ with the cut open and all infinitesimals, shape (lanes, N, N)."""
        return self._joint(np.zeros(1), np.zeros(1))[:, : self.system.n, : self.system.n]

    def motion(self, re: Array, im: Array) -> Complex:
        """Return the derivative of Φ(κ) along every lane, shape (lanes, N, N).

        Parameters
        ----------
        re, im : ndarray, shape (lanes,) or (1,)
            Real and imaginary part of κ, with their infinitesimals.
        """
        n = self.system.n
        found = slopes(self._joint(re, im, pair=True))
        return np.asarray(found[:, :n, :n] + 1j * found[:, n:, :n])

    def _joint(self, re: Array, im: Array, *, pair: bool = False) -> Array:
        """Return Φ; of a ``pair`` as one real map of real and imaginary part, so that both carry their infinitesimals."""
        s, (b, c, d) = self.system, self._ends
        # κ / (1 - κ d) by its real and imaginary part
        below = (1 - re * d) ** 2 + (im * d) ** 2
        factor_re, factor_im = (re * (1 - re * d) - im * im * d) / below, im / below

        def closed(matrix: Array, column: Array) -> Array:
            back = column @ c
            own = matrix + factor_re[:, None, None] * back
            if not pair:
                return np.asarray(own)
            other = factor_im[:, None, None] * back
            own, other = np.broadcast_arrays(own, other)
            return np.concatenate([np.concatenate([own, -other], axis=2), np.concatenate([other, own], axis=2)], axis=1)

        flow = closed(s.flow, b)
        flows = [exponentials(width[:, None, None] * flow) for width in self._distinct]
        found = flows[self._kinds[0]]
        for kind, number in zip(self._kinds[1:], self._stops, strict=True):
            if number is not None:
                event = self.events[number]
                found = closed(event.jump, event.entering[:, :, -1:]) @ found
            found = flows[kind] @ found
        return found
