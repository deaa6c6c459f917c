"""The demonstration is run whole on the recording as it is, and what understands a recording also on one that comes later."""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import pytest

import servotune
from examples.demo import __main__ as demo
from examples.demo import report
from examples.demo.findings import Findings, Understanding
from examples.demo.measuring import DATA

LATER = 3
"""Samples (1 ms each) by which the changed recording's measured channel comes later."""


@dataclass(frozen=True)
class Demonstration:
    """What a run said, found and wrote."""

    code: int
    said: str
    findings: Findings
    page: str


def demonstrate(recording: Path, folder: Path) -> Demonstration:
    """Run the command as a person does, and keep the findings that its report was written from."""
    written: list[Findings] = []
    original_write = report.write

    def write(findings: Findings, path: Path) -> None:
        written.append(findings)
        original_write(findings, path)

    path, said = folder / "report.html", io.StringIO()
    arguments = ["--recording", str(recording), "--report", str(path), "--workdir", str(folder / "work")]
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(said):
        patch.setattr(report, "write", write)
        code = demo.main(arguments)
    assert written, said.getvalue()
    return Demonstration(code, said.getvalue(), written[0], path.read_text(encoding="utf-8"))


@pytest.fixture(scope="session")
def original(tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    return demonstrate(DATA / "0A.txt", tmp_path_factory.mktemp("original"))


@dataclass(frozen=True)
class Understood:
    """What the steps before the searches said and found."""

    said: str
    found: Understanding


@pytest.fixture(scope="session")
def changed(tmp_path_factory: pytest.TempPathFactory) -> Understood:
    folder, said = tmp_path_factory.mktemp("changed"), io.StringIO()
    recording = delayed(DATA / "0A.txt", folder / "0A.txt")
    with servotune.local(folder / "work") as client, redirect_stdout(said):
        found = demo.understand(client, recording, demo.Narrator())
    return Understood(said.getvalue(), found)


def delayed(source: Path, target: Path) -> Path:
    """Copy a recording with its first channel `LATER` samples late, every other character as it was."""
    lines = source.read_text().splitlines(keepends=True)
    head, rows = lines[:7], [line.split(",") for line in lines[7:]]
    measured = [row[2] for row in rows]
    for row, value in zip(rows, measured[:1] * LATER + measured[:-LATER], strict=True):
        row[2] = value
    target.write_text("".join(head + [",".join(row) for row in rows]))
    return target
