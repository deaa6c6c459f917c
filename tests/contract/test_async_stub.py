"""Type checkers are told the truth about `AsyncClient`: its stub is that of the client, and catches what is wrong."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from tests.support.stub import STUB, Stub

SCRIPT = """
import asyncio

import servotune
from servotune.replies import Optimization, Simulation


async def main() -> None:
    async with servotune.AsyncClient("http://127.0.0.1:8000", key="st_1", timeout=5.0) as client:
        stored = await client.systems.create({"name": "axis"})
        simulated: Simulation = await client.simulate(stored.id, input={"port": "r", "signal": {"kind": "step"}})
        job = await client.optimize(stored.id, variables=[{"parameter": "kp"}], goals=[])
        found: Optimization = await job.wait(timeout=10.0)
        print(simulated, found, job.progress, client.url)
        async for one in client.systems.list():
            print(one.name)
        async for event in job.events():
            print(event.name)


asyncio.run(main())
"""
#: Line that is put into `main` -> what is said about it.
WRONG = {
    "await client.simulat(stored.id)": "attr-defined",
    "await client.simulate(stored.id)": "call-arg",
    "await client.systems.get(3)": "arg-type",
    "length: int = await client.systems.etag(stored.id)": "assignment",
    "forgotten: Simulation = client.simulate(stored.id, input={})": "assignment",
    "[one async for one in job.result()]": "attr-defined",
    "servotune.AsyncClient(adress='http://127.0.0.1')": "call-arg",
}


#: As where the client is alone: it brings none of these, and to read what describes them is most of the work.
CONFIGURATION = """
[mypy]
strict = True
[mypy-matplotlib.*,numpy.*,pandas.*,xarray.*]
follow_imports = skip
follow_imports_for_stubs = True
"""


def checked(tmp_path: Path, script: str) -> str:
    file, configuration = tmp_path / "script.py", tmp_path / "mypy.ini"
    file.write_text(script)
    configuration.write_text(CONFIGURATION)
    command = [sys.executable, "-m", "mypy", f"--config-file={configuration}", f"--cache-dir={tmp_path / 'cache'}"]
    return subprocess.run(
        [*command, str(file)], capture_output=True, text=True, check=False, cwd=STUB.parents[1]
    ).stdout


def test_the_stub_is_current() -> None:
    assert STUB.read_text() == Stub().text(), "run `make stub`"


def test_a_right_script_passes_and_each_wrong_line_is_found(tmp_path: Path) -> None:
    last = "            print(event.name)\n"
    script = SCRIPT.replace(last, last + "".join(f"        {line}\n" for line in WRONG))
    begin = script[: script.index(next(iter(WRONG)))].count("\n") + 1
    found = re.findall(r"script\.py:(\d+): error: .*\[([a-z-]+)\]$", checked(tmp_path, script), flags=re.MULTILINE)
    assert {int(line): code for line, code in found} == dict(enumerate(WRONG.values(), begin))
