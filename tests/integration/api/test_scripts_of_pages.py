"""Pages whose blocks of Python are one script: it runs, in a process and with an engine of its own, as its reader runs it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
#: Page -> its number of blocks at least, and what the script prints among other things.
SCRIPTS: dict[str, tuple[int, tuple[str, ...]]] = {
    "README.md": (1, ("Metric 0.24",)),
    "docs/coming-from.md": (2, ()),
    "docs/python.md": (8, ("/variants/0/kd", "True")),
}


@pytest.mark.parametrize("page", SCRIPTS)
def test_a_page_is_a_script_that_runs(page: str, tmp_path: Path) -> None:
    least, said = SCRIPTS[page]
    blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(), flags=re.MULTILINE | re.DOTALL)
    assert len(blocks) >= least
    script = tmp_path / "page.py"
    script.write_text("\n".join(blocks))
    done = subprocess.run(
        [sys.executable, str(script)],
        cwd=tmp_path,
        env={**os.environ, "MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    for words in said:
        assert words in done.stdout
