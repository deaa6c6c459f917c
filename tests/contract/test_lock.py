"""The locks: every version exact, every file hashed, no index address, and everything that we ask for; the image's is a part of the whole."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.support.distributions import declared, parts

ROOT = Path(__file__).parents[2]
LOCKS = {name: (ROOT / name).read_text() for name in ("requirements.lock", "requirements-image.lock")}
IMAGE = [
    "servotune",
    "servotune-server",
    *(f"servotune-server[{name}]" for name in ("cluster", "convex", "formats", "interop", "pareto", "telemetry")),
]


def entries(name: str) -> list[str]:
    joined = re.sub(r"\s*\\\n\s*", " ", LOCKS[name])
    return [line.strip() for line in joined.splitlines() if line and not line.lstrip().startswith("#")]


def locked(name: str) -> dict[str, Requirement]:
    """Return name -> requirement of every entry of a lock."""
    requirements = [Requirement(entry.split(" --hash")[0]) for entry in entries(name)]
    return {canonicalize_name(requirement.name): requirement for requirement in requirements}


@pytest.mark.parametrize("name", LOCKS)
def test_every_entry_is_one_exact_version_with_hashes(name) -> None:
    for line in entries(name):
        assert re.fullmatch(r"[a-z0-9.\-_\[\],]+==[^ ]+( ; [^-]+)?( --hash=sha256:[0-9a-f]{64})+", line), line


@pytest.mark.parametrize("name", LOCKS)
def test_no_address_of_an_index_or_file(name) -> None:
    assert not re.search(r"https?://|file:|--(extra-)?index-url|--find-links|@ ", LOCKS[name])


def test_the_image_runs_the_versions_that_are_tested_and_nothing_that_only_developers_need() -> None:
    whole, image = set(entries("requirements.lock")), set(entries("requirements-image.lock"))
    assert image < whole
    needed = {canonicalize_name(Requirement(text).name) for part in IMAGE for text in declared(part)}
    assert needed <= locked("requirements-image.lock").keys()
    assert (
        not {"pytest", "mypy", "ruff", "playwright", "zensical", "nidaqmx", "asyncua"}
        & locked("requirements-image.lock").keys()
    )


def test_everything_that_the_project_asks_for_is_locked_within_its_bounds() -> None:
    wanted = [text for part in parts() for text in declared(part)]
    have = locked("requirements.lock")
    for text in wanted:
        requirement = Requirement(text)
        pinned = have[canonicalize_name(requirement.name)]
        version = next(iter(pinned.specifier)).version
        assert requirement.specifier.contains(version, prereleases=True), (text, version)
