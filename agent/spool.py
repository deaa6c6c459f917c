"""Samples on disk until the service has them: a folder for each attempt, every file written whole or not at all.

::

    <folder>/instance                what this agent calls itself for ever
    <folder>/lock                    held by the process whose folder it is
    <folder>/runs/<acq>-<n>/
        run.json                     the claim
        begin.json                   what the recording is: rate, start, channels
        000000.f64, 000000.json      samples as the service keeps them, and their SHA-256
        end.json                     how it ended: facts, and the error
        room                         until then: what a full disk has left for the end
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from filelock import FileLock, Timeout

from agent.errors import AttemptError, SettingsError

Samples = npt.NDArray[np.float64]

MOST_BYTES = 8 * 1024 * 1024
"""In one segment; the service takes no more."""
USUAL_BYTES = 2 * 1024 * 1024
WINDOWS = os.name == "nt"
_SUFFIX = ".part"
_ROOM = 256 * 1024
"""Bytes that are kept for how an attempt ended: a disk that has become full must not hide that."""
_HELD = frozenset({5, 32, 33})
"""What Windows answers while another program (a virus scanner, an indexer, a backup) has a file open: ACCESS_DENIED,
SHARING_VIOLATION, LOCK_VIOLATION."""
_TRIES, _BETWEEN = 40, 0.05
"""How often something is tried that another program prevents, and the s between."""


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Keep a folder for this process: two agents with one spool would be the same agent to the service, on one rig.

    Raises
    ------
    SettingsError
        While another process has it, and for a folder that cannot be made or written.
    """
    lock = FileLock(folder / "lock", timeout=0, thread_local=False)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise SettingsError(f"spool.folder must be one agent's alone, another process has {folder}") from None
    except OSError as error:
        raise SettingsError(f"spool.folder must be a writable folder, got {folder}: {error.strerror}") from error
    try:
        yield
    finally:
        lock.release()


def write_whole(path: Path, data: bytes) -> None:
    """Write a file so that it is there whole or not at all, whenever the power goes off.

    Raises
    ------
    AttemptError
        `disk_full` and the like.
    """
    part = path.with_name(path.name + _SUFFIX)
    try:
        with part.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        patiently(lambda: part.replace(path))
        _flush_folder(path.parent)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        if getattr(error, "winerror", None) in _HELD:
            detail = (
                f"{path} is held by another program ({error.strerror}): leave the spool out of virus scans and backups"
            )
            raise AttemptError("file_held", detail) from error
        detail = f"{path.parent} must take the samples: {error.strerror}. Make room, or see to the disk"
        raise AttemptError("disk_full", detail) from error


def patiently(work: Callable[[], object]) -> None:
    """Do something to a file, again while another program has it open, as only Windows minds.

    Raises
    ------
    OSError
        That of the last try.
    """
    for number in range(_TRIES):
        try:
            work()
        except PermissionError as error:
            if getattr(error, "winerror", None) not in _HELD or number == _TRIES - 1:
                raise
            time.sleep(_BETWEEN)
        else:
            return


def _flush_folder(folder: Path) -> None:
    """Let the new name of a file reach the disk, too; Windows opens no folder, and NTFS keeps names in its journal."""
    if WINDOWS:
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a document whole."""
    write_whole(path, json.dumps(document, allow_nan=False).encode())


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """A piece of a recording on disk."""

    path: Path
    sha256: str
    samples: int
    size: int


class Run:
    """The folder of one attempt."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def name(self) -> str:
        """Of the folder."""
        return self.folder.name

    def read(self, name: str) -> dict[str, Any] | None:
        """Return one of the documents, None where it was never written."""
        try:
            found: dict[str, Any] = json.loads((self.folder / f"{name}.json").read_bytes())
        except FileNotFoundError:
            return None
        return found

    def write(self, name: str, document: Mapping[str, Any]) -> None:
        """Write one of the documents."""
        if name == "end":
            (self.folder / "room").unlink(missing_ok=True)
        write_json(self.folder / f"{name}.json", document)

    @property
    def claim(self) -> dict[str, Any]:
        """What was asked for."""
        found = self.read("run")
        assert found is not None  # the first file of every folder
        return found

    @property
    def ended(self) -> bool:
        """Whether nothing more is recorded."""
        return (self.folder / "end.json").exists()

    def append(self, number: int, data: bytes, *, samples: int) -> Segment:
        """Put a piece on disk: first the samples, then what they must hash to."""
        path = self.folder / f"{number:06}.f64"
        digest = hashlib.sha256(data).hexdigest()
        write_whole(path, data)
        write_json(path.with_suffix(".json"), {"sha256": digest, "samples": samples, "size": len(data)})
        return Segment(path=path, sha256=digest, samples=samples, size=len(data))

    def segments(self) -> list[Segment]:
        """Return the pieces in their order; one without its sidecar is still being written."""
        found = []
        for path in sorted(self.folder.glob("[0-9]*.f64")):
            sidecar = path.with_suffix(".json")
            if sidecar.exists():
                told: dict[str, Any] = json.loads(sidecar.read_bytes())
                found.append(
                    Segment(path=path, sha256=told["sha256"], samples=int(told["samples"]), size=int(told["size"]))
                )
        return found

    def repair(self) -> None:
        """Give a piece its sidecar that the process before was not able to write any more; the piece itself is whole."""
        begin = self.read("begin") or {}
        width = 8 * len(begin.get("channels", ())) or 8
        for path in sorted(self.folder.glob("[0-9]*.f64")):
            sidecar = path.with_suffix(".json")
            if not sidecar.exists():
                data = path.read_bytes()
                digest = hashlib.sha256(data).hexdigest()
                write_json(sidecar, {"sha256": digest, "samples": len(data) // width, "size": len(data)})

    def replace_spoilt(self, segment: Segment, *, channels: int) -> Segment:
        """Put missing values in the place of a piece that the disk has spoilt, and keep the spoilt one beside it."""
        patiently(lambda: segment.path.replace(segment.path.with_suffix(".spoilt")))
        data = np.full(segment.samples * channels, np.nan, dtype="<f8").tobytes()
        return self.append(int(segment.path.stem), data, samples=segment.samples)

    def remove(self) -> None:
        """Forget it, because the service has confirmed every byte; what another program holds open goes at the next start.

        Raises
        ------
        AttemptError
            `file_held`, where it cannot even be forgotten yet.
        """
        try:
            patiently(lambda: (self.folder / "run.json").unlink(missing_ok=True))
        except OSError as error:
            detail = f"{self.folder} has arrived and must be removable: {error.strerror}"
            raise AttemptError("file_held", detail) from error
        shutil.rmtree(self.folder, ignore_errors=True)


class Spool:
    """All attempts that are on this disk.

    Parameters
    ----------
    folder : Path
    limit, reserve : float
        Bytes that may be used, and that must stay free.
    """

    def __init__(self, folder: Path, *, limit: float, reserve: float) -> None:
        self._folder = folder
        self._limit, self._reserve = limit, reserve
        (folder / "runs").mkdir(parents=True, exist_ok=True)
        for left in (folder / "runs").iterdir():
            if left.is_dir() and not (left / "run.json").exists():  # forgotten, or never begun
                shutil.rmtree(left, ignore_errors=True)
        for part in folder.rglob(f"*{_SUFFIX}"):
            with contextlib.suppress(OSError):  # still in another program's hands: the next start sees to it
                part.unlink(missing_ok=True)

    def instance(self) -> str:
        """Return what this agent calls itself for ever."""
        path = self._folder / "instance"
        if not path.exists():
            write_whole(path, uuid.uuid4().hex.encode())
        return path.read_text().strip()

    def runs(self) -> list[Run]:
        """Return the attempts on this disk, the oldest first."""
        folders = [path for path in (self._folder / "runs").iterdir() if (path / "run.json").exists()]
        return [Run(path) for path in sorted(folders, key=lambda path: (path / "run.json").stat().st_mtime)]

    def open(self, claim: Mapping[str, Any]) -> Run:
        """Make the folder of an attempt."""
        folder = self._folder / "runs" / f"{claim['acquisition']}-{claim['attempt']}"
        run = Run(folder)
        try:
            folder.mkdir(exist_ok=True)
            run.write("run", claim)
            write_whole(folder / "room", os.urandom(_ROOM))  # zeros may take no room
        except (AttemptError, OSError) as error:
            shutil.rmtree(folder, ignore_errors=True)
            if isinstance(error, AttemptError):
                raise
            raise AttemptError("disk_full", f"{folder.parent} must take a new folder: {error.strerror}") from error
        return run

    def used(self) -> int:
        """Return how many bytes lie here."""
        return sum(path.stat().st_size for path in self._folder.rglob("*.f64"))

    def admit(self, size: int) -> None:
        """Make sure that a recording of some bytes fits.

        Raises
        ------
        AttemptError
            `disk_full`.
        """
        used, free = self.used(), shutil.disk_usage(self._folder).free
        if used + size > self._limit:
            raise AttemptError(
                "disk_full",
                f"the spool must hold at most {self._limit:g} bytes, it has {used} and would get {size}: let the agent "
                "upload, or raise spool.limit",
            )
        if size + self._reserve > free:
            raise AttemptError(
                "disk_full", f"the disk must keep {self._reserve:g} bytes free beside the {size} to come, it has {free}"
            )


class Recorder:
    """Gathers blocks of samples into segments.

    Parameters
    ----------
    run : Run
    channels : int
    samples : int
        Of one segment.
    """

    def __init__(self, run: Run, *, channels: int, samples: int) -> None:
        self._run, self._channels = run, channels
        self._size = max(min(samples, MOST_BYTES // (8 * channels)), 1)
        self._blocks: list[Samples] = []
        self._waiting = self._number = 0
        self.samples = 0
        """That are on disk."""

    def add(self, block: Samples) -> None:
        """Take a block of shape (channels, n)."""
        self._blocks.append(block)
        self._waiting += block.shape[1]
        while self._waiting >= self._size:
            self._store(self._size)

    def close(self) -> None:
        """Put the rest on disk."""
        if self._waiting:
            self._store(self._waiting)

    def _store(self, count: int) -> None:
        whole = np.concatenate(self._blocks, axis=1) if len(self._blocks) > 1 else self._blocks[0]
        data = np.ascontiguousarray(whole[:, :count].T, dtype="<f8").tobytes()
        self._run.append(self._number, data, samples=count)
        self._blocks = [whole[:, count:]]
        self._waiting -= count
        self._number += 1
        self.samples += count
