"""How far metrics are from their exact values."""

from __future__ import annotations

from collections.abc import Mapping


def worst(found: Mapping[str, float], exact: Mapping[str, float]) -> float:
    """Return the largest relative error of the metrics found; absolute for what may be 0: overshoot and static error."""
    return max(abs(value - exact[name]) / _scale(name, exact[name]) for name, value in found.items() if name in exact)


def _scale(name: str, exact: float) -> float:
    return 1.0 if name in {"overshoot", "steady_state_error"} else abs(exact)
