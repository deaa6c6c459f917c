"""The browser client in the wheel: built from `web/` when it is missing, and no wheel without it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class PagesHook(BuildHookInterface):
    """Build `api/static`, or fail: a service without its pages must not be shipped."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Make sure that the pages are there before files are collected."""
        del build_data
        if self.target_name != "wheel" or version == "editable":
            return
        root = Path(self.root).parents[1]
        index = root / "api" / "static" / "index.html"
        if not index.is_file() and shutil.which("npm"):
            for command in (["npm", "ci", "--no-audit", "--no-fund"], ["npm", "run", "build"]):
                subprocess.run(command, cwd=root / "web", check=True, stdout=sys.stderr)  # noqa: S603 -- fixed words
        if not index.is_file():
            raise RuntimeError(f"{index} must exist in a wheel, got none: run `make web` first")
