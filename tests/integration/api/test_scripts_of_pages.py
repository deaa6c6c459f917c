"""Pages whose blocks of Python are one script: it runs, in a process and with an engine of its own, as its reader runs it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.integration.api.conftest import Service
from tests.integration.api.rigs import AGENT, RIG, deliver, samples

ROOT = Path(__file__).parents[3]
#: Page -> its number of blocks at least, and what the script prints among other things.
SCRIPTS: dict[str, tuple[int, tuple[str, ...]]] = {
    "README.md": (1, ("Metric 0.24",)),
    "docs/coming-from.md": (2, ()),
    "docs/python.md": (8, ("/variants/0/kd", "True")),
}


def blocks_of(page: str) -> list[str]:
    """Return the blocks of Python of a page, in their order."""
    return re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(), flags=re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("page", SCRIPTS)
def test_a_page_is_a_script_that_runs(page: str, tmp_path: Path) -> None:
    least, said = SCRIPTS[page]
    blocks = blocks_of(page)
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


def test_the_script_of_a_measurement_runs_on_a_rig(sqlite_service: Service, tmp_path: Path) -> None:
    (block,) = [block for block in blocks_of("docs/agent.md") if "acquisitions.start" in block]
    with sqlite_service.client("acquire") as agent:
        output = RIG["outputs"][0] | {"slew": 5000}  # a step of 1 V from one sample to the next
        document = RIG | {"understands": ["commanded"], "outputs": [output]}
        identifier = agent.post("/v1/agents", json=AGENT | {"document": document}).json()["id"]
        script = subprocess.Popen(
            [sys.executable, "-c", block],
            cwd=tmp_path,
            env={**os.environ, "SERVOTUNE_URL": sqlite_service.url, "SERVOTUNE_KEY": sqlite_service.keys["run"]},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        claim = None
        while claim is None and script.poll() is None:
            reply = agent.post(f"/v1/agents/{identifier}/claim", params={"wait": 5})
            claim = reply.json() if reply.status_code == 200 else None
        if claim is not None:
            assert (claim["request"]["channels"], claim["request"]["commanded"]) == (["position"], True)
            deliver(agent, claim, identifier, samples()).raise_for_status()
        said, complaint = script.communicate()
    assert (script.returncode, said) == (0, "done ['calibration of position was due on 2021-01-01']\n"), complaint
