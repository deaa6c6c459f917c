"""What goes with a release: every part of the image with its version and its licence, in a format that others read."""

from __future__ import annotations

import json
import re
import runpy
import subprocess
from pathlib import Path
from typing import Any

import pytest
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

ROOT = Path(__file__).parents[2]
RELEASE = runpy.run_path(str(ROOT / "distributions" / "release.py"))


@pytest.fixture(scope="module")
def bill() -> dict[str, Any]:
    return dict(RELEASE["bill"]())


def test_the_bill_has_every_part_of_the_image_in_its_version(bill) -> None:
    lock = (ROOT / "requirements-image.lock").read_text()
    locked = {
        name.lower().replace("_", "-"): version for name, version in re.findall(r"^(\S+?)==(\S+)", lock, re.MULTILINE)
    }
    found = {
        entry["name"].lower().replace("_", "-").replace(".", "-"): entry["version"] for entry in bill["components"]
    }
    assert found == {name.replace(".", "-"): version for name, version in locked.items()}
    assert len(found) > 80
    assert all(entry["purl"].startswith("pkg:pypi/") for entry in bill["components"])


def test_it_is_what_the_format_says(bill) -> None:
    assert JsonStrictValidator(SchemaVersion.V1_6).validate_str(json.dumps(bill)) is None


def test_the_licence_of_every_part_is_known_and_lets_it_be_passed_on(bill) -> None:
    found = {entry["name"]: RELEASE["licence"](entry) for entry in bill["components"]}
    assert not [name for name, licence in found.items() if not licence or "UNKNOWN" in licence.upper()]
    assert not [name for name, licence in found.items() if re.search(r"\bA?GPL", licence)]  # LGPL is of a library
    page = RELEASE["licences"](bill)
    assert all(f"| {name} |" in page for name in found)
    needless = set(RELEASE["STATED"]) - {name.lower() for name in found}
    assert not needless


def test_sums_are_those_that_sha256sum_reads(tmp_path) -> None:
    (tmp_path / "a.whl").write_bytes(b"wheel")
    (tmp_path / "SHA256SUMS").write_text(RELEASE["sums"](tmp_path))
    checked = subprocess.run(
        ["sha256sum", "--check", "SHA256SUMS"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (checked.returncode, checked.stdout) == (0, "a.whl: OK\n")
    (tmp_path / "a.whl").write_bytes(b"another")
    assert RELEASE["sums"](tmp_path) != (tmp_path / "SHA256SUMS").read_text()
