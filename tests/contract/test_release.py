"""What goes with a release: every part of the image with its version and its licence, in a format that others read."""

from __future__ import annotations

import json
import re
import runpy
import subprocess
from pathlib import Path
from typing import Any

import pytest

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
    expected = {name.replace(".", "-"): version for name, version in locked.items()}
    removed = (ROOT / "Containerfile").read_text().split()
    left_out = {name for name in expected if f"{name}*" in removed}
    assert left_out == RELEASE["LEFT_OUT"]
    assert found == {name: version for name, version in expected.items() if name not in left_out}
    assert len(found) > 80
    assert all(entry["purl"].startswith("pkg:pypi/") for entry in bill["components"])


def test_it_is_what_the_format_says(bill) -> None:
    # Two seconds, which each process that collects the tests would take.
    from cyclonedx.schema import SchemaVersion
    from cyclonedx.validation.json import JsonStrictValidator

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


@pytest.fixture
def key(tmp_path: Path) -> Path:
    """A key for nothing but this test."""
    made = tmp_path / "keys" / "release"
    made.parent.mkdir()
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "", "-f", str(made)], check=True)
    return made


def verified(folder: Path, signers: Path) -> bool:
    """Return what the command says that CONTRIBUTING.md tells users."""
    (command,) = re.findall(
        r"^ +(ssh-keygen -Y verify .*) && sha256sum", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE
    )
    command = command.replace("-f allowed_signers", f"-f {signers}")
    done = subprocess.run(["sh", "-c", command], cwd=folder, capture_output=True, check=False)
    return done.returncode == 0


def test_sums_that_are_signed_are_held_against_the_public_half_of_the_key(tmp_path, key) -> None:
    signers = tmp_path / "keys" / "allowed_signers"
    signers.write_text(f"release@servotune {key.with_suffix('.pub').read_text()}")
    folder = tmp_path / "dist"
    folder.mkdir()
    (folder / "a.whl").write_bytes(b"wheel")
    for _ in range(2):  # a second release writes over the first
        (folder / "SHA256SUMS").write_text(RELEASE["sums"](folder))
        assert RELEASE["sign"](folder / "SHA256SUMS", key).name == "SHA256SUMS.sig"
        assert verified(folder, signers)
    assert "SHA256SUMS" not in (folder / "SHA256SUMS").read_text()
    (folder / "SHA256SUMS").write_text((folder / "SHA256SUMS").read_text().replace("a.whl", "b.whl"))
    assert not verified(folder, signers)


def test_a_key_of_somebody_else_is_not_taken(tmp_path, key) -> None:
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(tmp_path / "other")], check=True)
    signers = tmp_path / "keys" / "allowed_signers"
    signers.write_text(f"release@servotune {(tmp_path / 'other.pub').read_text()}")
    (tmp_path / "SHA256SUMS").write_text("0  a.whl\n")
    RELEASE["sign"](tmp_path / "SHA256SUMS", key)
    assert not verified(tmp_path, signers)


def test_what_is_no_key_is_refused(tmp_path) -> None:
    (tmp_path / "SHA256SUMS").write_text("0  a.whl\n")
    (tmp_path / "none").write_text("no key")
    with pytest.raises(SystemExit, match="the key must be an SSH key that signs"):
        RELEASE["sign"](tmp_path / "SHA256SUMS", tmp_path / "none")
