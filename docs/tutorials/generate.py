"""Write the tutorials' pages from the notebooks: text, code, what it prints and draws; `make tutorials` runs it.

A test holds the code of the pages against the notebooks, another one runs the notebooks.
"""

from __future__ import annotations

import ast
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt

HERE = Path(__file__).resolve().parent
NOTEBOOKS = HERE.parents[1] / "examples" / "notebooks"
NOTE = "<!-- Written by `make tutorials` from examples/notebooks: edit the notebook, not this page. -->\n"
LONGEST = 40  # lines of output that a page shows


def cells(notebook: Path) -> list[tuple[str, str]]:
    """Return kind and text of every cell."""
    return [(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(notebook.read_text())["cells"]]


def page(notebook: Path) -> str:
    """Execute a notebook and return its page; figures are written beside it."""
    mpl.use("agg")
    names: dict[str, Any] = {"__name__": "__main__"}
    parts, drawn = [NOTE], 0
    for kind, text in cells(notebook):
        if kind == "markdown":
            parts.append(f"{text}\n")
            continue
        parts.append(f"```python\n{text.removesuffix(';')}\n```\n")
        shown = executed(text, names)
        if plt.get_fignums():
            drawn += 1
            parts.append(figure(notebook.stem, drawn))
        elif shown is not None:
            lines = (shown.to_string() if hasattr(shown, "to_string") else repr(shown)).splitlines()
            parts.append("\n".join(["```text", *lines[:LONGEST], "```", ""]))
    return "\n".join(parts)


def executed(source: str, names: dict[str, Any]) -> Any:
    """Execute a cell and return the value of its last line, None where that is no expression or ends with a semicolon."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "notebook", "exec"), names)  # noqa: S102 -- our own notebooks
    if last is None:
        return None
    value = eval(compile(ast.Expression(last.value), "notebook", "eval"), names)  # noqa: S307 -- as above
    return None if source.rstrip().endswith(";") else value


def figure(stem: str, number: int) -> str:
    """Write the figure that is open, and return the line that shows it."""
    name = f"{stem.replace('_', '-')}-{number}.png"
    plt.gcf().savefig(HERE / name, dpi=110, bbox_inches="tight", metadata={"Software": None})
    plt.close("all")
    return f"![What the lines above draw]({name})\n"


def main(notebooks: Sequence[Path]) -> None:
    """Write the pages."""
    for notebook in notebooks:
        os.chdir(notebook.parent)
        (HERE / f"{notebook.stem}.md").write_text(page(notebook))


if __name__ == "__main__":
    main(sorted(NOTEBOOKS.glob("*.ipynb")))
