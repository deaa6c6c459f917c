"""A file system that refuses what Windows refuses, on the one that there is.

Of https://learn.microsoft.com/windows/win32/fileio: CreateFile (a file that is open without FILE_SHARE_DELETE is neither
renamed, replaced nor deleted: ERROR_SHARING_VIOLATION or ERROR_ACCESS_DENIED; a folder is not opened), Naming Files (reserved
characters and names, no dot or blank at the end), Maximum Path Length (259 characters).
"""

from __future__ import annotations

import io
import os
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from agent import spool

_DEVICES = re.compile(r"(con|prn|aux|nul|com[1-9]|lpt[1-9])(\..*)?", re.IGNORECASE)
_MOST = 259


def _refuse(code: int, text: str, path: object) -> None:
    error = PermissionError(13, text, str(path)) if code in {5, 32} else OSError(22, text, str(path))
    error.winerror = code  # type: ignore[attr-defined] # Windows alone has it
    raise error


class Windows:
    """Rules that hold until the test is over.

    Parameters
    ----------
    root : Path
        They hold in this folder alone.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, root: Path) -> None:
        self._root = str(root)
        self.held: dict[str, int] = {}
        """Path -> how often it is still refused: another program has it open for a while."""
        self.refused = 0
        monkeypatch.setattr(spool, "WINDOWS", True)
        monkeypatch.setattr(shutil, "_use_fd_functions", False)  # Windows has none
        for name in ("replace", "rename"):
            monkeypatch.setattr(os, name, self._moving(getattr(os, name)))
        for name in ("unlink", "remove", "rmdir"):
            monkeypatch.setattr(os, name, self._deleting(getattr(os, name)))
        monkeypatch.setattr(os, "mkdir", self._naming(os.mkdir))
        monkeypatch.setattr(os, "open", self._opening(os.open))
        monkeypatch.setattr(io, "open", self._naming(io.open))

    def hold(self, path: Path, times: int) -> None:
        """Let another program have a file open: it is refused so often."""
        self.held[str(path)] = times

    def _free(self, path: object) -> None:
        """Refuse a file that is open: in this process, or, as a test says, in another one."""
        told = str(path)
        if self.held.get(told, 0) > 0:
            self.held[told] -= 1
            self.refused += 1
            _refuse(32, "The process cannot access the file because it is being used by another process", told)
        for handle in Path("/proc/self/fd").iterdir():
            try:
                target = str(handle.readlink())
            except OSError:
                continue
            if target == told or target.startswith(f"{told}{os.sep}"):
                _refuse(32, "The process cannot access the file because it is being used by another process", told)

    def _named(self, path: object) -> None:
        if isinstance(path, int) or not str(path).startswith(self._root):
            return
        told = str(path)
        for part in Path(told).relative_to(self._root).parts:
            if re.search(r'[<>:"|?*\x00-\x1f]', part) or part[-1] in ". " or _DEVICES.fullmatch(part):
                _refuse(123, "The filename, directory name, or volume label syntax is incorrect", told)
        if len(told) > _MOST:
            _refuse(206, "The filename or extension is too long", told)

    def _moving(self, real: Any) -> Any:
        def move(source: Any, target: Any, **options: Any) -> Any:
            self._named(target)
            self._free(source)
            self._free(target)
            return real(source, target, **options)

        return move

    def _deleting(self, real: Any) -> Any:
        def delete(path: Any, **options: Any) -> Any:
            self._free(path)
            return real(path, **options)

        return delete

    def _naming(self, real: Any) -> Any:
        def make(path: Any, *rest: Any, **options: Any) -> Any:
            self._named(path)
            return real(path, *rest, **options)

        return make

    def _opening(self, real: Any) -> Any:
        def enter(path: Any, *rest: Any, **options: Any) -> Any:
            self._named(path)
            if not isinstance(path, int) and Path(path).is_dir():
                _refuse(5, "Access is denied", path)
            return real(path, *rest, **options)

        return enter
