"""The notebooks of the examples run from top to bottom, each value at the end of a cell shown as a notebook shows it."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest

FOLDER = Path(__file__).parents[3] / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def test_the_notebooks_are_found() -> None:
    assert {"dc_motor", "recording_to_controller"} <= {path.stem for path in NOTEBOOKS}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mpl.use("agg")
    monkeypatch.chdir(path.parent)
    names: dict[str, Any] = {"__name__": "__main__"}
    drawn = 0
    for number, cell in enumerate(json.loads(path.read_text())["cells"]):
        if cell["cell_type"] == "code":
            assert not cell["outputs"], "what cells print is not committed"
            shown = executed("".join(cell["source"]), f"{path.name}, cell {number}", names)
            html = getattr(shown, "_repr_html_", None)
            if html is not None:
                assert re.search(r"<t[dh]", html())
            assert len(repr(shown)) < 5_000
            drawn += len(plt.get_fignums())
            plt.close("all")
    assert drawn >= 2


def executed(source: str, where: str, names: dict[str, Any]) -> Any:
    """Execute a cell and return the value of its last line, None where that is no expression or ends with a semicolon."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, where, "exec"), names)
    if last is None:
        return None
    value = eval(compile(ast.Expression(last.value), where, "eval"), names)
    return None if source.rstrip().endswith(";") else value
