"""How the functions of a folder are compiled: as the kernels are, kept under a name of their own that changes with their sources."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, TypeVar

import llvmlite.binding
import numba

from engine.batch.kernels import compiled as kernels

F = TypeVar("F", bound=Callable[..., Any])

_SETTINGS = vars(numba.config)


class Compiler:
    """Compiles the functions of one folder.

    Parameters
    ----------
    name : str
        Of what they are for.
    folder : Path
    below : Path
        Where the functions are kept that these call.
    """

    def __init__(self, name: str, folder: Path, below: Path) -> None:
        sources = [source.read_bytes() for source in sorted(folder.glob("*.py"))]
        own = b"".join(text for text in sources if b"\n@compiled\n" in text)
        content = hashlib.sha256(below.name.encode() + own).hexdigest()[:16]
        self.home: Final = below.parent / f"{name}-{content}"

    def compiled(self, function: F) -> F:
        """Return the function compiled at its first call; it makes no arrays."""
        return self._kept(kernels.compiled, function)

    def allocating(self, function: F) -> F:
        """Return the function compiled at its first call; it may make arrays."""
        return self._kept(kernels.allocating, function)

    def _kept(self, compile_: Callable[[F], F], function: F) -> F:
        before = _SETTINGS["CACHE_DIR"]
        _SETTINGS["CACHE_DIR"] = str(self.home)
        try:
            return compile_(function)
        finally:
            _SETTINGS["CACHE_DIR"] = before


class Mark:
    """A file that says that a process of this machine has compiled all that is kept in a folder, so that loading it takes about a second.

    Parameters
    ----------
    home : Path
        The folder, whose name changes with the sources; the file is for a version of the compiler and a processor.
    """

    def __init__(self, home: Path) -> None:
        self._file = home / f"compiled-{numba.__version__}-{llvmlite.binding.get_host_cpu_name()}"

    def __bool__(self) -> bool:
        return self._file.is_file()

    def make(self) -> None:
        """Say so."""
        with suppress(OSError):  # nothing can be kept there: every process compiles its own
            self._file.touch()


_COMPILER = Compiler("responses", Path(__file__).parent, Path(_SETTINGS["CACHE_DIR"]))
HOME: Final = _COMPILER.home
compiled, allocating = _COMPILER.compiled, _COMPILER.allocating
