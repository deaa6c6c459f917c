"""requirements.lock: every version exact, every file hashed, no index address, and everything that we ask for."""

from __future__ import annotations

import re
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.support.distributions import declared, parts

ROOT = Path(__file__).parents[2]
LOCK = (ROOT / "requirements.lock").read_text()


def locked() -> dict[str, Requirement]:
    """Return name -> requirement of every entry of the lock."""
    joined = re.sub(r"\s*\\\n\s*", " ", LOCK)
    entries = [line for line in joined.splitlines() if line and not line.lstrip().startswith("#")]
    requirements = [Requirement(entry.split(" --hash")[0]) for entry in entries]
    return {canonicalize_name(requirement.name): requirement for requirement in requirements}


def test_every_entry_is_one_exact_version_with_hashes() -> None:
    joined = re.sub(r"\s*\\\n\s*", " ", LOCK)
    for line in joined.splitlines():
        if line and not line.lstrip().startswith("#"):
            assert re.fullmatch(r"[a-z0-9.\-_\[\],]+==[^ ]+( ; [^-]+)?( --hash=sha256:[0-9a-f]{64})+", line.strip()), (
                line
            )


def test_no_address_of_an_index_or_file() -> None:
    assert not re.search(r"https?://|file:|--(extra-)?index-url|--find-links|@ ", LOCK)


def test_everything_that_the_project_asks_for_is_locked_within_its_bounds() -> None:
    wanted = [text for part in parts() for text in declared(part)]
    have = locked()
    for text in wanted:
        requirement = Requirement(text)
        pinned = have[canonicalize_name(requirement.name)]
        version = next(iter(pinned.specifier)).version
        assert requirement.specifier.contains(version, prereleases=True), (text, version)
