"""Transfer functions with a delay that simulate best: the numerator by regression, the denominator by Gauss and Newton.

    ŷ = q^-d B(q)/F(q) u + X(q)/F(q) δ + c,   minimise over F  ||(1 - Q Qᵀ) y||²

B, the initial state X and the constant c enter linearly: for each F they are a regression, whose columns Q spans.

References
----------
L. Ljung, "System Identification: Theory for the User", 2nd ed., Prentice Hall 1999, section 10.2 (output error).
K. Steiglitz, L. McBride, "A technique for the identification of linear systems", IEEE Trans. Autom. Control 10 (1965) 461-464
(the start).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from optimizers.black_box.continuous import Discrete
from optimizers.estimation.filters import filtered
from optimizers.estimation.tall import solved, triangle
from optimizers.methods.least_squares import minimize_squares

Samples = npt.NDArray[np.float64]

_REPEATED = 12
_SETTLED = 1e-7
"""A start that moves less than this is one that repeating does not make better."""
_REGULAR = 1e-2
"""Part of the strongest line's power below which a line tells little of the impulse response."""
_EVALUATIONS = 40
_FAST = 0.3


class OutputError:
    """One path: a recorded input and output.

    Parameters
    ----------
    u : ndarray, shape (lead + samples,)
    y : ndarray, shape (samples,)
    offset : bool
        Whether the output has an unknown constant.
    lead : int
        Samples of the input from before the output's: what is heard later.
    check : callable
        Asked before every step of a search; may end it by an error of its own.
    """

    def __init__(
        self, u: Samples, y: Samples, *, offset: bool, lead: int = 0, check: Callable[[], None] = lambda: None
    ) -> None:
        self._u, self._y, self._offset, self._lead, self._check = u, y, offset, lead, check
        self._spread = float(np.linalg.norm(y - y.mean()))

    @property
    def samples(self) -> int:
        """Number of samples of the output."""
        return self._y.size

    def started(self, order: int, delay: int) -> tuple[Samples, float]:
        """Return the denominator (order,) without its leading 1 that Steiglitz and McBride come to, and what it leaves."""
        f = np.zeros(order)
        best, least = f, np.inf
        u, y = self._late(delay), self._y
        for _ in range(_REPEATED):
            self._check()
            whole = np.append(1.0, f)
            uf, yf = filtered([1.0], whole, u), filtered([1.0], whole, y)
            recursion = [-_shifted(yf, k) for k in range(1, order + 1)]
            table = np.stack([*recursion, *(_shifted(uf, k) for k in range(order + 1)), np.ones(y.size)], axis=1)
            if not self._offset:
                table = table[:, :-1]
            # the first samples begin from a state that is not in the regression
            joint = np.concatenate([table[order:], yf[order:, None]], axis=1)
            before, f = f, _reflected(solved(triangle(joint), table.shape[1])[0][:order, 0])
            left = self.left(f, delay)
            if left < least:
                best, least = f, left
            if np.abs(f - before).max(initial=0.0) < _SETTLED:
                break
        return best, least

    def left(self, f: Samples, delay: int) -> float:
        """Return what the best numerator leaves of the output, relative to its spread."""
        return float(np.linalg.norm(self._solved(f, delay)[1])) / self._spread

    def onset(self, most: int) -> int:
        """Return the delay, at most so many samples, from which on the output follows the input by their impulse response.

        That is estimated in the frequency domain, where the input is strong; its onset is where it first reaches half of its peak.
        """
        size = 2 * self._y.size
        u, y = (np.fft.rfft(np.diff(signal), size) for signal in (self._late(0), self._y))
        power = np.abs(u) ** 2
        response = np.fft.irfft(np.conj(u) * y / (power + _REGULAR * power.max()), size)[: most + 1]
        return int(np.argmax(np.abs(response) >= 0.5 * np.abs(response).max()))

    @staticmethod
    def extended(f: Samples) -> Samples:
        """Return a denominator with one fast pole more: where a higher order may begin without being worse."""
        return np.convolve(np.append(1.0, f), [1.0, -_FAST])[1:]

    def nearest(self, f: Samples, delay: int, most: int) -> int:
        """Return the delay at or beside the given one, up to ``most``, from which no next one leaves less."""
        least = self.left(f, delay)
        for step in (-1, 1):
            while 0 <= delay + step <= most and (own := self.left(f, delay + step)) < least:
                delay, least = delay + step, own
        return delay

    def polished(self, f: Samples, delay: int, *, most: int = _EVALUATIONS) -> Samples:
        """Return the denominator at the nearest minimum of the simulation's error."""
        rows = 3 * f.size + 2 + self._offset  # of a triangle: nothing is as long as the recording

        def errors(x: Samples) -> tuple[Samples, Samples]:
            self._check()
            if np.abs(np.roots(np.append(1.0, x))).max(initial=0.0) >= 1:
                return np.full(2 * rows, np.inf), np.zeros((2 * rows, x.size))
            table = self._columns(x, delay)
            found, _ = self._solved(x, delay, table)
            simulated = table @ found - (found[-1] if self._offset else 0.0)
            moved = filtered([1.0], np.append(1.0, x), simulated)
            jacobian = [_shifted(moved, k) for k in range(1, x.size + 1)]
            joint = np.concatenate([table, np.stack([*jacobian, self._y], axis=1)], axis=1)
            _, left = solved(triangle(joint), table.shape[1])
            left = np.pad(left / self._spread, ((0, 2 * rows - len(left)), (0, 0)))
            return left[:, -1], left[:, :-1]

        free = np.full(f.size, np.inf)
        found = minimize_squares(errors, f[None], lower=-free, upper=free, max_evaluations=most)
        return f if found is None else found.x

    def model(self, f: Samples, delay: int) -> tuple[Discrete, float]:
        """Return the model behind its delay, in observer form, and the constant."""
        found = self._solved(f, delay)[0]
        n = f.size
        b, x0 = found[: n + 1], found[n + 1 : 2 * n + 1]
        a = np.diag(np.ones(n - 1), 1) if n else np.zeros((0, 0))
        a[:, 0] = -f
        # y = x_1 + b_0 u, x_i+ = -f_i y' ...: numerator B - b_0 F drives, and 1/F filters the initial state
        c = np.zeros((1, n))
        c[0, :1] = 1.0
        model = Discrete(a=a, b=(b[1:] - b[0] * f)[:, None], c=c, d=np.array([[b[0]]]), x0=x0)
        return model, float(found[-1]) if self._offset else 0.0

    def _solved(self, f: Samples, delay: int, table: Samples | None = None) -> tuple[Samples, Samples]:
        """Return the best coefficients of the regressors, and a short vector of the size of what they leave."""
        table = self._columns(f, delay) if table is None else table
        found, left = solved(triangle(np.concatenate([table, self._y[:, None]], axis=1)), table.shape[1])
        return found[:, 0], left[:, 0]

    def _late(self, delay: int) -> Samples:
        """Return the input later; before it was recorded it was 0."""
        if delay <= self._lead:
            return self._u[self._lead - delay : self._lead - delay + self._y.size]
        return _shifted(self._u[self._lead :], delay)

    def _columns(self, f: Samples, delay: int) -> Samples:
        """Return the regressors of B, of the initial state and of the constant."""
        whole = np.append(1.0, f)
        driven = filtered([1.0], whole, self._late(delay))
        impulse = np.zeros(self._y.size)
        impulse[0] = 1.0
        free = filtered([1.0], whole, impulse)
        columns = [_shifted(driven, k) for k in range(f.size + 1)]
        columns += [_shifted(free, k) for k in range(f.size)]
        return np.stack([*columns, np.ones(self._y.size)] if self._offset else columns, axis=1)


def _shifted(signal: Samples, samples: int) -> Samples:
    """Return a signal later; before it begins it has been 0."""
    return np.concatenate([np.zeros(samples), signal[: signal.size - samples]]) if samples else signal


def _reflected(f: Samples) -> Samples:
    """Return a denominator whose roots outside the unit circle are mirrored into it."""
    roots = np.roots(np.append(1.0, f))
    outside = np.abs(roots) >= 1
    if not outside.any():
        return f
    roots[outside] = 0.999 / np.conj(roots[outside])
    return np.asarray(np.poly(roots).real[1:])
