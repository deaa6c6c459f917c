"""What one march of some candidates shows, and whether the march with half the steps has shown the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from engine.batch.nonlinear.curves import Curves
from engine.batch.nonlinear.march import Pieces
from engine.batch.nonlinear.readings import INTEGRALS, RATIOS, TIMES

Real = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

TOLERANCE: Final = 1e-5
"""Largest difference of the curves of two marches, relative to the largest value."""
METRIC_TOLERANCE: Final = 1e-4
"""Largest relative difference of a metric; that of a ratio of the way is absolute."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """What one march shows.

    Attributes
    ----------
    curves : ndarray, shape (watched, samples, B)
    coarse : ndarray of int
        The samples that a march with steps twice as long has, too.
    finest : bool
        Whether smaller steps bring no more samples.
    values, doubtful, floors : ndarray, shape (B, R)
        Metrics, and differences of them that mean nothing.
    settled, steady, covered : ndarray of bool, shape (B,)
        Who has come to rest, who moves at a constant rate in the end, and who could be followed.
    """

    curves: Real
    coarse: npt.NDArray[np.intp]
    values: Real
    doubtful: Flags
    floors: Real
    settled: Flags
    steady: Flags
    covered: Flags
    finest: bool

    @classmethod
    def joined(cls, looks: Sequence[Look]) -> Look:
        """Return the looks at several parts as one."""
        if len(looks) == 1:
            return looks[0]
        return cls(
            curves=np.concatenate([look.curves for look in looks], axis=2), coarse=looks[0].coarse,
            values=np.concatenate([look.values for look in looks]),
            doubtful=np.concatenate([look.doubtful for look in looks]),
            floors=np.concatenate([look.floors for look in looks]),
            settled=np.concatenate([look.settled for look in looks]),
            steady=np.concatenate([look.steady for look in looks]),
            covered=np.concatenate([look.covered for look in looks]), finest=looks[0].finest,
        )  # fmt: skip

    def take(self, which: Flags) -> Look:
        """Return what it shows of some candidates."""
        return Look(
            curves=self.curves[:, :, which], coarse=self.coarse, values=self.values[which], doubtful=self.doubtful[which],
            floors=self.floors[which], settled=self.settled[which], steady=self.steady[which],
            covered=self.covered[which], finest=self.finest,
        )  # fmt: skip

    def agrees(self, before: Look) -> Flags:
        """Tell for whom halving the steps has changed nothing but what stays doubtful with the most samples, (B,)."""
        with np.errstate(all="ignore"):
            away = np.abs(self.curves[:, self.coarse] - before.curves).max(axis=1)
            agreed = (away <= TOLERANCE * np.abs(self.curves).max(axis=1)).all(axis=0)
            near = np.abs(self.values - before.values) <= METRIC_TOLERANCE * np.abs(self.values) + self.floors
            same = near | (np.isnan(self.values) & np.isnan(before.values))
            settled = self.doubtful if self.finest else np.zeros_like(self.doubtful)
            settled = settled | (same & ~self.doubtful)
        return np.asarray(agreed & settled.all(axis=1))


def floor(metric: str, curves: Curves) -> Real | float:
    """Return by how much a metric may change for nothing."""
    if metric in TIMES:
        return 1e-7 * float(curves.times[-1])
    if metric in RATIOS:
        return METRIC_TOLERANCE
    return 0.0 if metric in INTEGRALS else TOLERANCE * curves.size


def coarse(pieces: Pieces) -> npt.NDArray[np.intp]:
    """Return the samples that a march with steps twice as long has, too."""
    skip = 2 if pieces.stride == 1 else 1
    first = np.concatenate([[0], np.cumsum(pieces.samples + 1)[:-1]])
    return np.concatenate([f + np.arange(0, n + 1, skip) for f, n in zip(first, pieces.samples, strict=True)])
