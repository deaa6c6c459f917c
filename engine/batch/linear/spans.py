"""Candidates that are followed by the same thread."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final

import numpy as np
import numpy.typing as npt

FOLLOWED: Final = 32
"""Neighbours that are followed by the same thread."""


def in_spans(
    members: npt.NDArray[Any], work: Callable[[slice], None], threads: int, together: int = FOLLOWED
) -> None:  # fmt: skip
    """Work on members (rising), cut where others ``together`` begin: who stands beside whom does not depend on how many there are."""
    ends = [0, *(np.flatnonzero(np.diff(members // together)) + 1).tolist(), len(members)]
    spans = [slice(first, last) for first, last in itertools.pairwise(ends)]
    if len(spans) == 1 or threads == 1:
        for span in spans:
            work(span)
        return
    with ThreadPoolExecutor(min(len(spans), threads)) as pool:
        list(pool.map(work, spans))
