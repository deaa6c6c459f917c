"""The page of the Python library: its blocks are one script, which runs."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt

PAGE = Path(__file__).parents[3] / "docs" / "python.md"


def test_the_page_of_the_library_is_a_script_that_runs(capsys) -> None:
    mpl.use("agg")
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL)
    assert len(blocks) >= 8
    script = "\n".join(blocks)
    names: dict[str, object] = {"__name__": "page"}
    exec(compile(script, str(PAGE), "exec"), names)
    plt.close("all")
    printed = capsys.readouterr().out
    assert "/variants/0/kd" in printed
    assert "True" in printed
