"""State spaces from the row spaces of measured Hankel matrices (past outputs as instruments).

    Y_f = Γ_i X + H_i U_f + N:   range of Γ_i from Y_f / U_f⊥ [U_p; Y_p],   A from its shift,   then B, D, x_0 by linear regression

References
----------
M. Verhaegen, "Identification of the deterministic part of MIMO state space models given in innovations form from
input-output data", Automatica 30 (1994) 61-74 (PO-MOESP).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from optimizers.black_box.continuous import Discrete
from optimizers.estimation.tall import triangle

Matrix = npt.NDArray[np.float64]

_GROWN = 1e100
"""A model that grows beyond this within the recording is none."""
_COLUMNS = 1 << 14
"""Of a Hankel matrix at a time."""


class Subspace:
    """The decomposition of one recording, from which models of every order are made.

    Parameters
    ----------
    inputs : ndarray, shape (inputs, samples)
    outputs : ndarray, shape (outputs, samples)
    horizon : int
        Rows of blocks in past and future; larger than any order asked for.
    offset : bool
        Whether each output has an unknown constant.
    """

    def __init__(self, inputs: Matrix, outputs: Matrix, horizon: int, *, offset: bool) -> None:
        self._u, self._y, self._offset = inputs, outputs, offset
        width = 2 * horizon
        corner = np.zeros((0, 0))
        columns = inputs.shape[1] - width + 1
        for first in range(0, columns, _COLUMNS):
            part = slice(first, min(first + _COLUMNS, columns) + width - 1)
            u, y = _hankel(inputs[:, part], width), _hankel(outputs[:, part], width)
            (past_u, future_u), (past_y, future_y) = np.split(u, 2), np.split(y, 2)
            # constants are taken out of every row exactly, as the future inputs are
            known = np.concatenate([np.ones((1, u.shape[1])), future_u]) if offset else future_u
            stacked = np.concatenate([known, past_u, past_y, future_y]).T
            corner = triangle(np.concatenate([corner, stacked]) if len(corner) else stacked)
        lower = corner.T
        first = int(offset) + horizon * len(inputs)
        second = first + horizon * (len(inputs) + len(outputs))
        self._left, self.strengths, _ = np.linalg.svd(lower[second:, first:second], full_matrices=False)

    def model(self, order: int) -> tuple[Discrete, Matrix]:
        """Return the model of an order below ``horizon`` times the outputs, which may be unstable, and the constants."""
        outputs = len(self._y)
        gamma = self._left[:, :order] * np.sqrt(self.strengths[:order])
        a = np.linalg.lstsq(gamma[:-outputs], gamma[outputs:], rcond=None)[0]
        c = gamma[:outputs]
        b, d, x0, constants = self._driven(a, c)
        return Discrete(a=a, b=b, c=c, d=d, x0=x0), constants

    def _driven(self, a: Matrix, c: Matrix) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        """Return B, D, x_0 and the constants: the outputs are linear in them."""
        n, inputs, outputs = len(a), len(self._u), len(self._y)
        samples = self._u.shape[1]
        columns = np.zeros((samples, outputs, n * inputs + outputs * inputs + n))
        zero, still = np.zeros((outputs, 1)), np.zeros(n)
        with np.errstate(over="ignore", invalid="ignore"):  # an unstable one is told by its infinity
            for place in range(n * inputs):
                source, state = divmod(place, n)
                one = Discrete(a=a, b=np.eye(n)[:, [state]], c=c, d=zero, x0=still)
                columns[:, :, place] = one.simulate(self._u[[source]]).T
            columns[:, :, -n:] = c @ Discrete(a=a, b=a, c=c, d=zero, x0=still).powers(samples)
        direct = np.kron(self._u.T, np.eye(outputs)).reshape(samples, outputs, outputs * inputs)
        columns[:, :, n * inputs : -n] = direct
        table = columns.reshape(samples * outputs, -1)
        if not np.abs(table).max() < _GROWN:
            return np.zeros((n, inputs)), np.zeros((outputs, inputs)), np.zeros(n), np.zeros(outputs)
        if self._offset:
            table = np.concatenate([table, np.tile(np.eye(outputs), (samples, 1))], axis=1)
        scale = np.linalg.norm(table, axis=0)
        scale[scale == 0] = 1.0
        corner = triangle(np.concatenate([table / scale, self._y.T.reshape(-1, 1)], axis=1))
        found = np.linalg.lstsq(corner[:, :-1], corner[:, -1], rcond=1e-12)[0] / scale
        ends = np.cumsum([n * inputs, outputs * inputs, n])
        b, d, x0, constants = np.split(found, ends)
        return (
            b.reshape(inputs, n).T,
            d.reshape(inputs, outputs).T,
            x0,
            constants if self._offset else np.zeros(outputs),
        )


def _hankel(signals: Matrix, rows: int) -> Matrix:
    """Return blocks of the signals shifted by 0, 1, ... samples below each other."""
    columns = signals.shape[1] - rows + 1
    return np.concatenate([signals[:, k : k + columns] for k in range(rows)])
