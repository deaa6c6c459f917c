"""What metrics and the places where they are measured are called."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from api.services.reports.common import written
from api.services.reports.language import said_of, say
from engine.metrics import catalogue
from optimizers.problem import Goal


def title(metric: str) -> str:
    """Return what a metric is called."""
    known = catalogue().get(metric)
    return said_of(metric, metric.replace("_", " ") if known is None else known.title)


def place_of(found: Mapping[str, Any], goal: Goal | None) -> str:
    """Return where a goal is measured: an output under its experiment, a path, or an opened loop."""
    if goal is not None and goal.open_at is not None:
        return say("loop at {place}", place=written(goal.open_at))
    if goal is not None and goal.source is not None:
        return f"{goal.source} → {goal.target}"
    return " · ".join(str(one) for one in (found.get("output"), found.get("experiment")) if one)
