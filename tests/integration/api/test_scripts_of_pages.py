"""Pages whose blocks of Python are one script: it runs, with an engine of its own."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest

ROOT = Path(__file__).parents[3]
#: Page -> its number of blocks at least, and what the script prints among other things.
SCRIPTS: dict[str, tuple[int, tuple[str, ...]]] = {
    "README.md": (1, ("Metric 0.24",)),
    "docs/coming-from.md": (2, ()),
    "docs/python.md": (8, ("/variants/0/kd", "True")),
}


@pytest.mark.parametrize("page", SCRIPTS)
def test_a_page_is_a_script_that_runs(page: str, capsys) -> None:
    mpl.use("agg")
    least, said = SCRIPTS[page]
    blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(), flags=re.MULTILINE | re.DOTALL)
    assert len(blocks) >= least
    names: dict[str, object] = {"__name__": "page"}
    exec(compile("\n".join(blocks), page, "exec"), names)
    plt.close("all")
    printed = capsys.readouterr().out
    for words in said:
        assert words in printed
