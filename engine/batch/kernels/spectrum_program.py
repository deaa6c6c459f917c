"""What is asked of curves over frequency and read off them, and the program that a batch makes of a diagram for it."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.frequency_program import FrequencyProgram

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int32]

GAIN: Final = 1
PHASE: Final = 2
DELAY: Final = 4
SENSITIVITY: Final = 8
COMPLEMENTARY: Final = 16
BANDWIDTH: Final = 32
PEAK: Final = 64

(
    GAIN_MARGIN, PHASE_MARGIN, DELAY_MARGIN, MS, MT, FIRST_FALL, HIGHEST, AT_REST, DOUBT,
    GAIN_AT, PHASE_AT, DELAY_AT, MS_AT, MT_AT, HIGHEST_AT,
) = range(15)  # fmt: skip
READINGS: Final = 15
"""What is read off one curve, and at which frequency it is, rad/s; DOUBT is the sum of the bits above that are not vouched for.
Infinite where nothing crosses."""

CHUNK: Final = 16
"""Frequencies are done so many at a time, so that all functions of a program stay in the nearest cache."""
FALL: Final = 10.0**-0.3
SMALLEST: Final = 1e-3
"""A loop that is smaller than this passes no axis that is polished."""
FAINTEST: Final = 1e-9
"""A loop that is smaller than this passes no axis at all."""
FAINT: Final = -1.0
"""Stands for the place of a gain margin that only a loop below SMALLEST has: the exact path finds it."""


class SpectrumProgram(NamedTuple):
    """The scan with its tables (tables, frequencies) and the same functions without them; ``wants`` (curves,) bits above.

    The first and last frequency stand for 0 and infinity.
    """

    scan: FrequencyProgram
    points: FrequencyProgram
    frequencies: Real
    tables_re: Real
    tables_im: Real
    wants: Whole
