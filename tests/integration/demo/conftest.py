"""The demonstration is run twice: on the recording as it is, and on one whose measured channel comes later."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

import servotune
from examples.demo import report
from examples.demo.__main__ import Narrator, run
from examples.demo.findings import Findings
from examples.demo.measuring import DATA
from examples.demo.service import own_service

LATER = 3
"""Samples (1 ms each) by which the changed recording's measured channel comes later."""


@dataclass(frozen=True)
class Demonstration:
    """What a run found, and its report."""

    findings: Findings
    page: str


@pytest.fixture(scope="session")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[servotune.Client]:
    with own_service(tmp_path_factory.mktemp("service")) as client:
        yield client


def demonstrate(client: servotune.Client, recording: Path, folder: Path) -> Demonstration:
    findings = run(client, recording, Narrator())
    path = folder / "report.html"
    report.write(findings, path)
    return Demonstration(findings, path.read_text(encoding="utf-8"))


@pytest.fixture(scope="session")
def original(client: servotune.Client, tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    return demonstrate(client, DATA / "0A.txt", tmp_path_factory.mktemp("original"))


@pytest.fixture(scope="session")
def changed(client: servotune.Client, tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    folder = tmp_path_factory.mktemp("changed")
    return demonstrate(client, delayed(DATA / "0A.txt", folder / "0A.txt"), folder)


def delayed(source: Path, target: Path) -> Path:
    """Copy a recording with its first channel `LATER` samples late, every other character as it was."""
    lines = source.read_text().splitlines(keepends=True)
    head, rows = lines[:7], [line.split(",") for line in lines[7:]]
    measured = [row[2] for row in rows]
    for row, value in zip(rows, measured[:1] * LATER + measured[:-LATER], strict=True):
        row[2] = value
    target.write_text("".join(head + [",".join(row) for row in rows]))
    return target
