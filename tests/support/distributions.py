"""What the distributions declare, as their pyproject.toml files say; and how their wheels are built."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "distributions"
#: Name -> what its pyproject.toml says of it.
PROJECTS: dict[str, dict[str, Any]] = {
    path.parent.name: tomllib.loads(path.read_text())["project"] for path in sorted(FOLDER.glob("*/pyproject.toml"))
}
_WHEELS = {
    name: tomllib.loads((FOLDER / name / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    for name in PROJECTS
}
#: Name -> its top-level packages.
PACKAGES: dict[str, list[str]] = {name: wheel["hooks"]["custom"]["packages"] for name, wheel in _WHEELS.items()}
OWNER = {package: name for name, packages in PACKAGES.items() for package in packages}
GROUPS: dict[str, list[str]] = tomllib.loads((ROOT / "pyproject.toml").read_text())["dependency-groups"]


def declared(part: str) -> list[str]:
    """Return the foreign requirements of a distribution, of one of its extras (``servotune[notebook]``), or of a group."""
    name, _, extra = part.removesuffix("]").partition("[")
    if name in GROUPS:
        return GROUPS[name]
    own = PROJECTS[name]["optional-dependencies"][extra] if extra else PROJECTS[name]["dependencies"]
    return [text for text in own if Requirement(text).name not in PROJECTS]


def parts() -> list[str]:
    """Return everything that declares requirements."""
    extras = [f"{name}[{extra}]" for name, one in PROJECTS.items() for extra in one.get("optional-dependencies", {})]
    return [*PROJECTS, *extras, *GROUPS]


def build(name: str, target: Path) -> Path:
    """Build the wheel of a distribution by the locked hatchling, without a network."""
    target.mkdir(parents=True, exist_ok=True)
    before = set(target.glob("*.whl"))
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(target)],
        cwd=FOLDER / name, check=True, capture_output=True,
    )  # fmt: skip
    (made,) = set(target.glob("*.whl")) - before
    return made
