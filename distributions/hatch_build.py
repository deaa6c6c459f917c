"""The folders of the repository in a wheel; and the browser client, without which no wheel of the server is built."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class FoldersHook(BuildHookInterface):
    """Take the `packages` that a distribution names from the root of the repository."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Name the files that are collected; an editable installation has a path to them instead (`dev-mode-dirs`)."""
        if version == "editable":
            return
        root = Path(self.root).parents[1]
        for package in self.config["packages"]:
            build_data["force_include"][str(root / package)] = package
        if "api" in self.config["packages"]:
            _build_pages(root)


def _build_pages(root: Path) -> None:
    """Build `api/static` when it is missing, or fail: a service without its pages must not be shipped."""
    index = root / "api" / "static" / "index.html"
    if not index.is_file() and shutil.which("npm"):
        for command in (["npm", "ci", "--no-audit", "--no-fund"], ["npm", "run", "build"]):
            subprocess.run(command, cwd=root / "web", check=True, stdout=sys.stderr)  # noqa: S603 -- fixed words
    if not index.is_file():
        raise RuntimeError(f"{index} must exist in a wheel, got none: run `make web` first")
