"""What a scan of a response remembers: in which interval the last or highest event of every kind lies, and what is in doubt."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import compiled
from engine.batch.kernels.vector import load, magnitude, select, store

Real = npt.NDArray[np.float64]

RISE: Final = 1
SETTLE_2: Final = 2
SETTLE_5: Final = 4
HIGHEST: Final = 8
LOWEST: Final = 16
WHEN: Final = 32
"""What a metric needs of a response; HIGHEST is the furthest in the direction of the final value, WHEN also asks for its instant,
however little it stands out."""

ROWS: Final = 4
COLUMNS: Final = 4
PER_PASS: Final = ROWS * COLUMNS
"""A pass has so many samples: four states, each read four times."""
SURE: Final = 4.0
"""How much larger than estimated an error of interpolation may be."""
SLIGHT: Final = 1e-7
"""An overshoot below this part of the final value counts as none, where its instant does not matter."""

# Fields of the state of a scan, each with LANES entries. A reading's bracket is the step at which it begins and its level:
# it is 2^level steps long. The lists of tops and lows hold the three furthest.
(
    Y, D, Y2, D2, BIG, N10, L10, N90, L90,
    N2, L2, POKE2, SIDE2, GRAZE2, N5, L5, POKE5, SIDE5, GRAZE5,
    TOP, TOP_N, TOP_L, TOP_E, TOP2, TOP2_N, TOP2_L, TOP2_E, TOP3, TOP3_N, TOP3_L, TOP3_E, TOP4,
    LOW, LOW_N, LOW_L, LOW_E, LOW2, LOW2_N, LOW2_L, LOW2_E, LOW3, LOW3_N, LOW3_L, LOW3_E, LOW4,
    ERROR, MIXED, UP, DOWN,
) = range(49)  # fmt: skip
FIELDS: Final = 49
RANKS: Final = 3
ENTRY: Final = 4
"""Fields of an entry: height, step, level, error of the height. Behind the entries is the most that any other tip reaches."""
NONE: Final = -1.0
EDGE: Final = -2.0
NOWHERE: Final = -1e300
NEVER: Final = 1e300

DUE, APART, DOUBLED, LAST, PACES = range(5)
"""How a lane goes through its octaves of time: whether it is its turn, how many steps apart the samples of the octave before were, how
often those of this one are doubled, and in how many passes it is followed."""


@compiled
def begin(state: Real, start: Real, slope: Real, final: Real) -> None:
    """Start a scan at t = 0+, where the output is ``start`` below its final value (all LANES,)."""
    for field in range(FIELDS):
        store(state, 0.0, field)
    away, goal = load(start, 0), load(final, 0)
    size, value = magnitude(goal), away + goal
    way = select(goal >= 0.0, 1.0, -1.0)
    progress = way * value
    store(state, away, Y)
    store(state, away, Y2)
    store(state, load(slope, 0), D)
    store(state, load(slope, 0), D2)
    store(state, magnitude(value), BIG)
    store(state, select(progress >= 0.1 * size, EDGE, NONE), L10)
    store(state, select(progress >= 0.9 * size, EDGE, NONE), L90)
    store(state, select(magnitude(away) > 0.02 * size, 0.0, NONE), L2)
    store(state, select(magnitude(away) > 0.05 * size, 0.0, NONE), L5)
    side = select(away > 0.0, -1.0, 1.0)
    store(state, side, SIDE2)
    store(state, side, SIDE5)
    for first in (TOP, LOW):
        for rank in range(RANKS):
            store(state, NOWHERE, first + ENTRY * rank)
            store(state, NONE, first + ENTRY * rank + 2)
        store(state, NOWHERE, first + ENTRY * RANKS)
        store(state, way * away if first == TOP else -(way * away), first)
        store(state, EDGE, first + 2)
