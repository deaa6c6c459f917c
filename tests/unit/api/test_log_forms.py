"""Whatever ends up in the log of a process is an object on one line: of the job engine, of uvicorn, warnings, and errors that nobody caught."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
import logging, sys, threading, warnings
from api.telemetry import logs
logs.configure("info", form=sys.argv[1])
from dbos import DBOS
DBOS(config={"name": "test", "system_database_url": "sqlite:///" + sys.argv[2]})
logging.getLogger("dbos").warning("of the engine")
logging.getLogger("uvicorn.error").warning("of uvicorn")
warnings.warn("of a library")
thread = threading.Thread(target=lambda: 1 / 0, name="crash")
thread.start()
thread.join()
raise ValueError("of nobody")
"""
SAID = ["of the engine", "of uvicorn", "of a library", "thread crash ends by an error", "the process ends by an error"]


@pytest.mark.parametrize("form", ["json", "text"])
def test_every_line_has_our_form(form: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, form, str(tmp_path / "engine.db")],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 1
    if form == "json":
        messages = [json.loads(line)["message"] for line in done.stderr.splitlines()]
        told = messages[-len(SAID) :]  # the engine says before that it begins
        assert all(said in message for said, message in zip(SAID, told, strict=True))
        assert "ValueError: of nobody" in json.loads(done.stderr.splitlines()[-1])["traceback"]
        return
    assert " WARNING dbos: of the engine" in done.stderr
    assert "(dbos:" not in done.stderr
    assert " WARNING py.warnings: " in done.stderr
    assert " CRITICAL api.telemetry.logs: the process ends by an error" in done.stderr
