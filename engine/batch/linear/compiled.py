"""How the functions of this folder are compiled: as the kernels are, kept under a name of their own that changes with their sources."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba

from engine.batch.kernels import compiled as kernels

F = TypeVar("F", bound=Callable[..., Any])

_SETTINGS = vars(numba.config)
_KERNELS = Path(_SETTINGS["CACHE_DIR"])  # what is compiled here calls kernels
_SOURCES = [source.read_bytes() for source in sorted(Path(__file__).parent.glob("*.py"))]
_CONTENT = hashlib.sha256(
    _KERNELS.name.encode() + b"".join(text for text in _SOURCES if b"\n@compiled\n" in text)
).hexdigest()[:16]
HOME = str(_KERNELS.parent / f"responses-{_CONTENT}")


def _kept(compile_: Callable[[F], F], function: F) -> F:
    before = _SETTINGS["CACHE_DIR"]
    _SETTINGS["CACHE_DIR"] = HOME
    try:
        return compile_(function)
    finally:
        _SETTINGS["CACHE_DIR"] = before


def compiled(function: F) -> F:
    """Return the function compiled at its first call; it makes no arrays."""
    return _kept(kernels.compiled, function)


def allocating(function: F) -> F:
    """Return the function compiled at its first call; it may make arrays."""
    return _kept(kernels.allocating, function)
