"""Files that two programs give each other: whole or not there, because each is written under another name and renamed."""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from agent.errors import AttemptError

Samples = npt.NDArray[np.float64]

PART = ".part"
_LOOK = 0.01
_LARGEST = 256_000_000
"""Bytes of one file."""
_HEAD = 128
"""Bytes that an NPY file of a table of numbers has before them."""


def put(path: Path, document: Mapping[str, Any]) -> None:
    """Write a JSON file as a whole.

    Raises
    ------
    AttemptError
        `folder_refuses` where the folder cannot be written.
    """
    part = path.with_name(path.name + PART)
    try:
        part.write_text(json.dumps(document), encoding="utf-8")
        part.replace(path)
    except OSError as error:
        raise AttemptError("folder_refuses", f"{path} must be writable: {error.strerror}") from error


def get(path: Path) -> dict[str, Any] | None:
    """Return a JSON file, None where it is not there.

    Raises
    ------
    AttemptError
        `wrong_file` for anything else than a JSON object.
    """
    try:
        found = json.loads(path.read_bytes())
    except FileNotFoundError:
        return None
    except OSError as error:
        raise AttemptError("folder_refuses", f"{path} must be readable: {error.strerror}") from error
    except ValueError as error:
        raise AttemptError("wrong_file", f"{path} must be JSON, and renamed when it is complete: {error}") from error
    if not isinstance(found, dict):
        raise AttemptError("wrong_file", f"{path} must hold a JSON object, got {type(found).__name__}")
    return found


def wait(path: Path, *, within: float) -> dict[str, Any]:
    """Wait for the answer of the other program, or for what it complains about in `error.json` beside it.

    Raises
    ------
    AttemptError
        With its own word and sentence; `server_unreachable` when nothing comes in time.
    """
    give_up_at = time.monotonic() + within
    while True:
        found = get(path)
        if found is not None:
            return found
        complain(path.parent)
        if time.monotonic() > give_up_at:
            raise AttemptError(
                "server_unreachable",
                f"{path} must come within {within:g} s, it did not: see whether the other program runs and sees the folder",
            )
        time.sleep(_LOOK)


def complain(folder: Path) -> None:
    """Raise what the other program complains about, where it does."""
    error = get(folder / "error.json")
    if error is not None:
        code, detail = str(error.get("code") or "controller_error"), error.get("detail") or "it gave no reason"
        raise AttemptError(code, f"the other program: {detail}")


def save(path: Path, values: Samples) -> None:
    """Write samples as NPY, as a whole."""
    part = path.with_name(path.name + PART)
    try:
        with part.open("wb") as file:
            np.save(file, values)
        part.replace(path)
    except OSError as error:
        raise AttemptError("folder_refuses", f"{path} must be writable: {error.strerror}") from error


def load(path: Path, *, columns: int) -> Samples | None:
    """Return a file of samples, shape (n, columns); None where it is not there, or not complete yet.

    Raises
    ------
    AttemptError
        `wrong_file` for what is no table of numbers with so many columns.
    """
    try:
        if path.stat().st_size > _LARGEST:
            raise AttemptError("wrong_file", f"{path} must have at most {_LARGEST} bytes, it has {path.stat().st_size}")
        values = _npy(path) if path.suffix == ".npy" else _csv(path)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise AttemptError("folder_refuses", f"{path} must be readable: {error.strerror}") from error
    if values is not None and (values.ndim != 2 or values.shape[1] != columns or not values.shape[0]):
        raise AttemptError(
            "wrong_file",
            f"{path} must have rows of {columns} columns, one for each input, got the shape {values.shape}",
        )
    return values


def _npy(path: Path) -> Samples | None:
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        begins = file.read(len(np.lib.format.MAGIC_PREFIX))
        if size < _HEAD and np.lib.format.MAGIC_PREFIX.startswith(begins):
            return None
        file.seek(0)
        try:
            version = np.lib.format.read_magic(file)
            reader = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, fortran, kind = reader(file)
        except ValueError as error:
            raise AttemptError("wrong_file", f"{path} must be NPY: {error}") from error
        if kind.kind not in "fiu":
            raise AttemptError("wrong_file", f"{path} must hold numbers, got {kind}")
        wanted = int(np.prod(shape)) * kind.itemsize
        if size - file.tell() < wanted:
            return None
        return (
            np.frombuffer(file.read(wanted), dtype=kind)
            .reshape(shape, order="F" if fortran else "C")
            .astype(np.float64)
        )


def _csv(path: Path) -> Samples | None:
    text = path.read_text(encoding="utf-8", errors="replace")
    if not text.endswith("\n"):
        return None
    try:
        return np.array(np.loadtxt(text.splitlines(), delimiter=",", ndmin=2, dtype=np.float64))
    except ValueError as error:
        raise AttemptError("wrong_file", f"{path} must be numbers with commas between them: {error}") from error


def remove(folder: Path) -> None:
    """Delete a folder of this exchange and the files in it, as far as the other program lets go of them."""
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            path.unlink(missing_ok=True)
        folder.rmdir()
