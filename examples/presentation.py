"""How every study of this folder is run and shown: a service is asked, tables are printed, one figure is written."""

from __future__ import annotations

import argparse
import io
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import servotune
from servotune.replies import Metric

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Study = Callable[[servotune.Client], "Figure"]
"""Asks a service, prints what it answers and returns the figure."""

RESOLUTION, PALETTE = 100, 256
"""Dots per inch and colours of a figure: good on a page, and a file below 100 kB."""

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#000000", "#e69f00")
DASHES = ("-", (0, (6, 2)), (0, (2, 1.2)), (0, (6, 1.5, 1.5, 1.5)), (0, (1, 1)), (0, (5, 1.2, 1, 1.2, 1, 1.2)))
"""Of the curves in a panel, in their order: told apart by any eye and in print, M. Okabe and K. Ito, Color Universal Design (2008)."""


def run(study: Study, arguments: Sequence[str] | None) -> int:
    """Run a study as a script: connect, ask, write the figure; return the exit code."""
    script = sys.modules[study.__module__]
    name = Path(str(script.__file__)).stem.replace("_", "-")
    parser = argparse.ArgumentParser(description=script.__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--url", default="http://127.0.0.1:8000")
    parser.add_argument("--key", required=True)
    parser.add_argument("--figure", type=Path, default=Path(f"{name}.png"))
    options = parser.parse_args(arguments)
    try:
        with servotune.connect(options.url, key=options.key) as client:
            figure = study(client)
    except servotune.ServotuneError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    save(figure, options.figure)
    print(f"\nFigure: {options.figure}")
    return 0


def save(figure: Figure, path: Path) -> None:
    """Write a figure as a PNG file with a palette: a third of the size, with no difference to be seen."""
    from PIL import Image  # noqa: PLC0415 -- matplotlib brings it, and only a script that draws needs it

    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=RESOLUTION)
    Image.open(drawn).convert("RGB").quantize(PALETTE, dither=Image.Dither.NONE).save(path, "PNG", optimize=True)


def show(metric: Metric, factor: float, unit: str) -> str:
    """Return a metric in another unit, or the verdict why there is none."""
    return metric["verdict"] if metric["value"] is None else f"{factor * metric['value']:.3g} {unit}".strip()


def scaled(values: Sequence[float | None], factor: float) -> list[float]:
    """Return a curve in another unit, with a gap where there is no value."""
    return [math.nan if value is None else factor * value for value in values]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows below a head, the first column to the left and the others to the right."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    for row in (head, *rows):
        first, *others = (
            f"{cell:<{width}}" if place == 0 else f"{cell:>{width}}"
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        print("  ".join((first, *others)))


def panels(rows: int, columns: int, *, size: tuple[float, float]) -> tuple[Figure, list[Axes]]:
    """Return an empty figure of this size (inches) and its panels, row by row."""
    from matplotlib.figure import Figure  # noqa: PLC0415 -- costs a second, and only a script that draws needs it

    figure = Figure(figsize=size, layout="constrained")
    drawn = list(figure.subplots(rows, columns, squeeze=False).flat)
    for panel in drawn:
        panel.set_prop_cycle(color=COLOURS, linestyle=DASHES)
    return figure, drawn


def label(panel: Axes, *, title: str, x: str, y: str, legend: bool = True, **limits: Any) -> None:
    """Give a panel its title, axes with units, grid and legend."""
    panel.set(title=title, xlabel=x, ylabel=y, **limits)
    panel.grid(visible=True, which="major", color="0.9")
    if legend:
        panel.legend(fontsize="small", handlelength=3)
