"""The front of an optimisation of several objectives: what can be had of one for giving up another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from api.services.reports.drawing import COLORS, figure_of, numbers, text
from api.services.reports.kinds.naming import place_of, title
from api.services.reports.language import say
from api.services.reports.model import Figure, Part, Section, Sentence, table
from api.services.reports.origins import Asked
from api.services.reports.quantities import measured, plain
from api.services.reports.responses import named

_MOST_COLUMNS = 8


def front(asked: Asked) -> Iterator[Section]:
    """Yield a section for a search that has found a front."""
    points = asked.result.get("front") or []
    if not points:
        return
    knee = asked.result.get("knee")
    goals = asked.result["goals"]
    wanted = [i for i, goal in enumerate(asked.request.get("goals", [])) if goal.get("sense")]
    parts: list[Part] = [
        Sentence(say("{count} points of which none is better than another in every objective.", count=len(points)))
    ]
    if len(wanted) > 1:
        parts.append(_drawn(points, wanted[:2], goals, knee))
    names = list(points[0]["parameters"])
    left = max(_MOST_COLUMNS - len(wanted), 1)
    rows = (
        (
            str(i + 1) + (f" ({say('knee')})" if i == knee else ""),
            *(measured(goals[k]["metric"], point["goals"][k]) for k in wanted),
            *(plain(point["parameters"][name], 5) for name in names[:left]),
        )
        for i, point in enumerate(points)
    )
    columns = (say("Point"), *(f"{title(goals[k]['metric'])} {place_of(goals[k], None)}".strip() for k in wanted))
    columns = (*columns, *names[:left])
    parts.append(table(columns, rows, numeric=range(1, len(columns)), total=len(points)))
    if len(names) > left:
        parts.append(
            Sentence(say("{count} more variables are left out; the result holds them.", count=len(names) - left))
        )
    yield Section(say("Front"), parts)


def _drawn(
    points: Sequence[Mapping[str, Any]], pair: Sequence[int], goals: Sequence[Mapping[str, Any]], knee: int | None
) -> Figure:
    """Return the points over two objectives, in SI."""
    across, up = (numbers([point["goals"][k].get("value") for point in points]) for k in pair)
    labels = [named(goals[k]["metric"], points[0]["goals"][k].get("unit", "")) for k in pair]

    def draw(figure: Any) -> None:
        axes = figure.subplots()
        axes.plot(across, up, "o", color=COLORS[0], markersize=4)
        if knee is not None:
            axes.plot(
                across[knee : knee + 1], up[knee : knee + 1], "o", color=COLORS[1], markersize=8, fillstyle="none"
            )
        axes.set(xlabel=text(labels[0]), ylabel=text(labels[1]))

    told = say("The front over two objectives.")
    if knee is not None:
        told = say("The front over two objectives, the knee in a circle.")
    return figure_of(draw, told, (7.1, 3.0))
