"""The gain of one path over frequency, solved for one frequency at a time on a grid that refines itself.

G(jω) = C1 x + D12 w + D11,   [jω I - A, -B2; -C2, diag(e^{jω τ}) - D22] [x; w] = [B1; D21]
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar

from optimizers.independent_check.passage import passage

if TYPE_CHECKING:
    from engine.model.linear_system import LinearSystem
    from optimizers.independent_check.march import Real

Complex = npt.NDArray[np.complex128]
Height = Callable[[Complex, "Real"], "Real"]
"""A real quantity of gains at frequencies."""

_PER_DECADE = 40
_BENT = 0.5
_FADED = 1e-4
_MOST = 20_000
_CHUNK = 400
_CLOSE = 0.9
_MOST_SUMMITS = 12


class Sweep:
    """One path of a system.

    Parameters
    ----------
    system : LinearSystem
    source, target : int
        Indices of the input and the output.
    sign : float
        -1 turns an opened loop into L, of which 1 + L = 0 is the characteristic equation.
    """

    def __init__(self, system: LinearSystem, source: int, target: int, sign: float = 1.0) -> None:
        self._system = system
        self._right = np.concatenate([system.b1[:, source], system.d21[:, source]]).astype(complex)
        self._read = sign * np.concatenate([system.c1[target], system.d12[target]])
        self._direct = sign * float(system.d11[target, source])
        self.frequencies = self._grid()
        self.gains = self(self.frequencies)
        self._refine()

    def __call__(self, frequencies: Real) -> Complex:
        """Return the gains at angular frequencies (k,)."""
        s = self._system
        n, m = s.states, len(s.delays)
        found = np.empty(len(frequencies), dtype=complex)
        for first in range(0, len(frequencies), _CHUNK):
            w = frequencies[first : first + _CHUNK]
            matrix = np.zeros((len(w), n + m, n + m), dtype=complex)
            matrix[:, :n, :n] = -s.a
            matrix[:, range(n), range(n)] += 1j * w[:, None]
            matrix[:, :n, n:], matrix[:, n:, :n], matrix[:, n:, n:] = -s.b2, -s.c2, -s.d22
            matrix[:, range(n, n + m), range(n, n + m)] += np.exp(1j * w[:, None] * s.delays)
            inner = np.linalg.solve(matrix, np.broadcast_to(self._right[:, None], (len(w), n + m, 1)))[:, :, 0]
            found[first : first + _CHUNK] = inner @ self._read + self._direct
        return found

    def _grid(self) -> Real:
        s = self._system
        closed = s.a
        if len(s.delays):  # the loop as if its delays were none: its poles say where to look
            through = np.eye(len(s.delays)) - s.d22
            if abs(np.linalg.det(through)) > 1e-9:
                closed = s.a + s.b2 @ np.linalg.solve(through, s.c2)
        poles = np.concatenate([np.linalg.eigvals(s.a), np.linalg.eigvals(closed)])
        sizes = np.abs(poles)
        sizes = np.concatenate([sizes[sizes > 1e-9 * sizes.max(initial=0.0)], 1 / s.delays])
        low, high = (1e-4 * sizes.min(), 1e4 * sizes.max()) if len(sizes) else (1e-4, 1e4)
        points = [np.geomspace(low, high, int(_PER_DECADE * np.log10(high / low)) + 2)]
        for pole in poles:
            width = max(abs(pole.real), 1e-10 * abs(pole))
            points.append(abs(pole.imag) + width * np.array([-3, -1, -0.3, 0, 0.3, 1, 3]))
        if len(s.delays):
            points.append(np.arange(1, 2000) * 0.15 / float(s.delays.sum()))
        every = np.unique(np.concatenate(points))
        # beyond both ends only limits are approached
        ends = low * np.array([1e-6, 1e-4, 1e-2]), high * np.array([1e2, 1e4])
        return np.concatenate([ends[0], every[(every >= low) & (every <= high)], ends[1]])

    def _refine(self) -> None:
        """Halve intervals on which ln G or ln (1 + G) is not straight."""
        while len(self.frequencies) < _MOST:
            w, g = self.frequencies, self.gains
            middle = np.sqrt(w[:-1] * w[1:])
            bent = np.zeros(len(middle), dtype=bool)
            with np.errstate(all="ignore"):
                for shift in (0.0, 1.0):
                    change = np.log((g[1:] + shift) / (g[:-1] + shift))
                    bent |= np.abs(change.real) > _BENT
                    # behind a delay a gain that has faded turns for ever, and it matters no more
                    bent |= (np.abs(change.imag) > _BENT) & (np.abs(g[1:]) > _FADED)
            bent &= (w[1:] / w[:-1] > 1 + 1e-10) & (w[1:] / w[:-1] < 50)
            if not bent.any():
                return
            new = middle[bent][: _MOST - len(w)]
            order = np.argsort(np.concatenate([w, new]), kind="stable")
            self.frequencies = np.concatenate([w, new])[order]
            self.gains = np.concatenate([g, self(new)])[order]

    def highest(self, height: Height, marks: Real | None = None, span: tuple[float, float] = (0.0, np.inf)) -> float:
        """Return the greatest ``height`` within a span of frequencies; ``marks`` are looked at besides."""
        extra = np.zeros(0) if marks is None else marks
        w = np.unique(np.concatenate([self.frequencies, extra]))
        w = w[(w >= span[0]) & (w <= span[1])]
        heights = height(self(w), w)
        best = float(heights.max())
        padded = np.concatenate([[-np.inf], heights, [-np.inf]])
        summits = np.flatnonzero((heights >= padded[:-2]) & (heights >= padded[2:]) & (heights >= _CLOSE * best))
        for k in summits[np.argsort(-heights[summits], kind="stable")][:_MOST_SUMMITS]:
            for a, b in ((k - 1, k), (k, k + 1)):
                if a >= 0 and b < len(w):
                    found = minimize_scalar(
                        lambda x: -float(height(self(np.array([np.exp(x)])), np.array([np.exp(x)]))[0]),
                        bounds=(np.log(w[a]), np.log(w[b])), method="bounded", options={"xatol": 1e-11},
                    )  # fmt: skip
                    best = max(best, -float(found.fun))
        return best

    def crossings(self, height: Height) -> list[float]:
        """Return every frequency at which ``height`` passes 0, rising."""

        def at(x: float) -> float:
            point = np.array([x])
            return float(height(self(point), point)[0])

        w = self.frequencies
        values = height(self.gains, w)
        turns = [(turn, at(turn)) for turn in self._turns(values, at)]
        w, values = np.append(w, [turn for turn, _ in turns]), np.append(values, [there for _, there in turns])
        order = np.argsort(w, kind="stable")
        w, values = w[order], values[order]
        changes = np.flatnonzero((values[1:] < 0) != (values[:-1] < 0))
        return [passage(at, float(w[k]), float(w[k + 1]), xtol=1e-14 * w[k], rtol=1e-14) for k in changes]

    def _turns(self, values: Real, at: Callable[[float], float]) -> list[float]:
        """Return where a quantity with these values on the grid comes nearest to 0 between points, if it may pass it twice there."""
        w, sizes = self.frequencies, np.abs(values)
        left, here, right = sizes[:-2], sizes[1:-1], sizes[2:]
        alike = (np.sign(values[:-2]) == np.sign(values[1:-1])) & (np.sign(values[1:-1]) == np.sign(values[2:]))
        # a parabola through three points goes less far beyond the lowest one than that is below the others
        near = alike & (here <= left) & (here <= right) & (2 * here <= np.maximum(left, right))
        found = []
        for k in np.flatnonzero(near) + 1:
            sign = float(np.sign(values[k]))
            lowest = minimize_scalar(
                lambda x, sign=sign: sign * at(float(np.exp(x))), bounds=(np.log(w[k - 1]), np.log(w[k + 1])),
                method="bounded", options={"xatol": 1e-11},
            )  # fmt: skip
            found.append(float(np.exp(lowest.x)))
        return found
