"""Figures of a report: drawn by matplotlib, letters as paths, in colours that a page may replace by its own.

matplotlib is loaded here and by nobody else: a second, in the process that writes the report.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from api.services.reports.model import Figure, clean

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawn

Curve = npt.NDArray[np.float64]

INK, QUIET, RULE = "#1c2733", "#5b6773", "#dfe4ea"
#: Those of web/src/shared/plots/palette.ts, on light paper; dashes tell curves apart without them.
COLORS = ("#0b5c8f", "#b84a00", "#007a5a", "#a8447f", "#24292e", "#8424d8")
_DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 2.5)),
    (0, (2, 2)),
    (0, (6, 2, 2, 2)),
    (0, (1.5, 1.5)),
    (0, (8, 2, 2, 2, 2, 2)),
)
_WIDTH = 7.1
"""Inches: that of the text on a page of A4."""
_LABEL = 60
_MOST_POINTS = 2000
"""Of a curve: more than a page has dots across."""
_SETTINGS: Mapping[Any, Any] = {
    "svg.fonttype": "path",
    "svg.hashsalt": "servotune",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8.5,
    "text.color": INK,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.labelsize": 8.5,
    "axes.labelcolor": QUIET,
    "axes.edgecolor": QUIET,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": RULE,
    "grid.linewidth": 0.6,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "xtick.minor.size": 0,
    "ytick.minor.size": 0,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.4,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "path.simplify_threshold": 0.5,
}


@dataclass(frozen=True, slots=True)
class Line:
    """A curve with its name; gaps are NaN."""

    label: str
    x: Curve
    y: Curve


@dataclass(frozen=True, slots=True)
class Panel:
    """Curves over one axis; ``steps`` holds each value until the next, ``end`` is where the axis ends before the curves do."""

    title: str
    x: str
    y: str
    lines: Sequence[Line]
    logarithmic: bool = False
    steps: bool = False
    end: float | None = None


def numbers(values: Any) -> Curve:
    """Return numbers of a result as an array; null is NaN, and what is not there is empty."""
    if isinstance(values, np.ndarray):
        return values.astype(float)
    return np.array([np.nan if value is None else value for value in (() if values is None else values)], dtype=float)


def thinned(x: Curve, y: Curve) -> tuple[Curve, Curve]:
    """Return a curve with no more than `_MOST_POINTS`: of each of many short stretches its lowest and its highest point.

    Gaps within a stretch are closed, a stretch of nothing but gaps stays one.
    """
    if x.size <= _MOST_POINTS:
        return x, y
    ends = np.linspace(0, x.size, _MOST_POINTS // 2 + 1).astype(int)
    lowest, highest = np.where(np.isnan(y), np.inf, y), np.where(np.isnan(y), -np.inf, y)
    kept = sorted(
        {
            place
            for a, b in pairwise(ends)
            for place in (a + int(np.argmin(lowest[a:b])), a + int(np.argmax(highest[a:b])))
        }
    )
    return x[kept], y[kept]


def text(given: str) -> str:
    """Return what somebody wrote as matplotlib draws it letter by letter: a dollar sign begins no formula."""
    return clean(given, _LABEL).replace("$", r"\$")


def panels(drawn: Sequence[Panel], caption: str, *, columns: int = 2, height: float = 2.1) -> Figure:
    """Return panels beside and below each other, each curve in the colour of its name."""
    across = min(columns, len(drawn))
    down = -(-len(drawn) // across)
    names = list(dict.fromkeys(line.label for panel in drawn for line in panel.lines))

    def draw(figure: Drawn) -> None:
        grid = figure.subplots(down, across, squeeze=False).ravel()
        handles: dict[str, Any] = {}
        for axes, panel in zip(grid, drawn, strict=False):
            _draw(axes, panel, names, handles)
        for axes in grid[len(drawn) :]:
            axes.set_axis_off()
        if len(names) > 1:
            labels = [text(name) for name in handles]
            figure.legend(list(handles.values()), labels, loc="outside upper left", ncols=4, handlelength=2.6)

    return figure_of(draw, caption, (_WIDTH, down * height + 0.35 * (len(names) > 1)))


def _draw(axes: Axes, panel: Panel, names: Sequence[str], handles: dict[str, Any]) -> None:
    for line in panel.lines:
        number = names.index(line.label)
        look: dict[str, Any] = {"color": COLORS[number % len(COLORS)], "linestyle": _DASHES[number % len(_DASHES)]}
        if panel.steps:
            look["drawstyle"] = "steps-post"
        if line.x.size == 1:
            look |= {"marker": "o", "markersize": 3}
        (handles[line.label],) = axes.plot(*thinned(line.x, line.y), **look)
    axes.set(title=text(panel.title), xlabel=text(panel.x), ylabel=text(panel.y))
    axes.margins(x=0.01)
    if panel.logarithmic:
        axes.set_xscale("log")
    _number(axes)
    if panel.end is not None:
        axes.set_xlim(right=panel.end)


def _number(axes: Axes) -> None:
    """Write the numbers of both axes as letters: formulas took longer than the curves."""
    from api.services.reports.ticks import numbered  # noqa: PLC0415 - as below

    numbered(axes.xaxis)
    numbered(axes.yaxis)


def bars(rows: Sequence[tuple[str, float]], label: str, caption: str) -> Figure:
    """Return numbers as horizontal bars, the first on top."""

    def draw(figure: Drawn) -> None:
        axes = figure.subplots()
        places = np.arange(len(rows))
        values = [value for _, value in rows]
        axes.barh(places, values, height=0.62, color=[COLORS[0] if value >= 0 else COLORS[1] for value in values])
        axes.set_yticks(places, [text(name) for name, _ in rows])
        axes.invert_yaxis()
        axes.axvline(0, color=QUIET, linewidth=0.7)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel(text(label))
        _number(axes)

    return figure_of(draw, caption, (_WIDTH, 0.7 + 0.2 * len(rows)))


def figure_of(draw: Callable[[Drawn], None], caption: str, size: tuple[float, float]) -> Figure:
    """Return what a function draws on a figure of this size, inches."""
    with _style():
        from matplotlib.figure import Figure as Drawn  # noqa: PLC0415 - costs a second: this process alone pays it

        figure = Drawn(figsize=size, layout="constrained")
        draw(figure)
        out = io.StringIO()
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None, "Type": None, "Format": None})
    return Figure(svg=_bare(out.getvalue()), caption=caption, width=72 * size[0], height=72 * size[1])


@contextmanager
def _style() -> Iterator[None]:
    import matplotlib as mpl  # noqa: PLC0415 - as above

    with mpl.rc_context(dict(_SETTINGS)):
        yield


def _bare(drawn: str) -> str:
    """Return the SVG element alone, without comments, in which matplotlib repeats texts, and without metadata."""
    element = drawn[drawn.index("<svg") :]
    element = re.sub(r"<!--.*?-->\s*", "", element, flags=re.DOTALL)
    return re.sub(r"<metadata>.*?</metadata>\s*", "", element, flags=re.DOTALL)
