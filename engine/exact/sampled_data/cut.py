"""Loops cut open beside a pure delay: the same loop cut on the other side of it, where all signals are known.

A pure delay and the gain, phase or delay that a margin puts into the cut change places, and the loop stays the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import numpy as np

from engine.exact.sampled_data.transport import held_channels

if TYPE_CHECKING:
    from engine.model.linear_system import Array

_ENTER = {"b1": "b2", "d11": "d12", "d21": "d22", "d31": "d32"}
"""What an input enters by, and what a channel enters by."""
_SAY = {"c1": "c2", "d11": "d21", "d12": "d22", "d13": "d23"}
"""What an output is made of, and what a channel takes."""
_CLOSES: Final = {"b1": {"a": "c1", "b2": "d12", "b3": "d13"}, "d21": {"c2": "c1", "d22": "d12", "d23": "d13"}}
"""What the last input enters by: which matrix a closed loop adds to, and by which one the last output is made."""
_ANY_GAIN: Final = float(np.sqrt(2))


def cut_beside_delays(m: Mapping[str, Array]) -> dict[str, Array]:
    """Return the matrices of an opened loop, its cut out of the way of pure delays.

    Parameters
    ----------
    m : mapping
        Matrices of the fractional form; the last input and output are the ends of the cut.
    """
    moved = {name: np.array(matrix) for name, matrix in m.items()}
    for _ in range(moved["delays"].shape[-1]):
        channel = _behind(moved)
        if channel is not None:
            _put_behind(moved, channel)
    for _ in range(moved["delays"].shape[-1]):
        channel = _in_front(moved)
        if channel is not None:
            moved = _put_in_front(moved, channel)
    return moved


def _behind(m: Mapping[str, Array]) -> int | None:
    """Return the channel that alone takes the last input, and nothing else, and goes on to what is no sampler."""
    taken = np.flatnonzero(np.any(m["d21"][:, :, -1] != 0, axis=0))
    if len(taken) != 1 or any(np.any(m[name][..., -1]) for name in ("b1", "d11", "d31")):
        return None
    j = int(taken[0])
    others = np.any(m["d21"][:, j, :-1]) or any(np.any(m[name][:, j]) for name in ("c2", "d22", "d23"))
    goes_on = np.any(m["b2"][..., j]) or np.any(m["d22"][..., j])
    return j if goes_on and not others else None


def _put_behind(m: dict[str, Array], j: int) -> None:
    """Let the last input enter where a channel did, and the channel carry what the last output says."""
    factor = m["d21"][:, j, -1, None].copy()
    m["d21"][:, j] = 0.0
    for enters, channel in _ENTER.items():
        m[enters] = m[enters].astype(np.result_type(m[enters], m[channel], factor))
        m[enters][..., -1] = factor * m[channel][..., j]
        m[channel][..., j] = 0.0
    for output, channel in _SAY.items():
        m[channel] = m[channel].astype(np.result_type(m[channel], m[output]))
        m[channel][:, j] = m[output][:, -1]
        m[output][:, -1] = 0.0
    m["d12"][:, -1, j] = 1.0


def _in_front(m: Mapping[str, Array]) -> int | None:
    """Return the channel that the last output is, one that flows; other inputs do not matter to a loop."""
    seen = np.flatnonzero(np.any(m["d12"][:, -1] != 0, axis=0))
    if len(seen) != 1 or any(np.any(m[name][:, -1]) for name in ("c1", "d13")) or np.any(m["d11"][:, -1, -1]):
        return None
    j = int(seen[0])
    return j if j not in held_channels(m) else None


def _put_in_front(m: Mapping[str, Array], j: int) -> dict[str, Array]:
    """Let the last output be what a channel takes, and the last input enter through a channel of its own, as late."""
    factor = m["d12"][:, -1, j, None].copy()
    grown = arriving_later(m, m["delays"][:, j])
    for output, channel in _SAY.items():
        row = factor * grown[channel][:, j]
        grown[output] = grown[output].astype(np.result_type(grown[output], row))
        grown[output][:, -1] = row
    return grown


def arriving_later(m: Mapping[str, Array], later: Array) -> dict[str, Array]:
    """Return the matrices of an opened loop whose last input arrives ``later`` (lanes,), s: through a channel of its own."""
    grown = {name: np.array(matrix) for name, matrix in m.items()}
    grown["delays"] = np.concatenate([m["delays"], np.broadcast_to(later, (len(m["delays"]),))[:, None]], axis=1)
    for enters, channel in _ENTER.items():
        column = m[enters][..., -1:]
        grown[channel] = np.concatenate([m[channel], column], axis=2)
        grown[enters] = np.concatenate([m[enters][..., :-1], np.zeros_like(column)], axis=2)
    for channel in ("c2", "d21", "d22", "d23"):
        lanes, _, columns = grown[channel].shape
        grown[channel] = np.concatenate([grown[channel], np.zeros((lanes, 1, columns))], axis=1)
    grown["d21"][:, -1, -1] = 1.0
    return grown


def closed_by_any_gain(m: Mapping[str, Array]) -> dict[str, Array]:
    """Return what states and channels of an opened loop follow when it is closed: by a gain with which nothing cancels."""
    found = dict(m)
    for enters, closes in _CLOSES.items():
        for name, output in closes.items():
            found[name] = m[name] + _ANY_GAIN * m[enters][:, :, -1:] @ m[output][:, -1:]
    return found
